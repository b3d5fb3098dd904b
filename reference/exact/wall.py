"""A sphere striking a wall that takes mass off it, phase by phase, and how long Hertz says it lasts.

What the load removes is in `indent.py`; when and where the wall is met is in `touch.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import quad

from reference.exact.indent import Removal, removal

HERTZ_COEFFICIENT = 2.87  # the model's definition; the integral in `hertz_integral` gives 2.868


class WallImpact(NamedTuple):
    """Outcome of one impact on a wall at rest."""

    velocity: np.ndarray  # (3,), m/s, after
    mass: float  # kg, after
    normal_impulse: float  # N s, of the wall on the sphere
    energy_lost: float  # J, kinetic energy before minus after, of all that moves with the sphere
    duration: float  # s
    load: float  # N, mean force of the wall; 0 if no duration is given
    removal: Removal


class Wall(NamedTuple):
    """A wall that yields, and the law of restitution on it."""

    restitution: float
    effective_modulus: float  # E* of sphere and wall, Pa
    poisson_ratio: float
    yield_stress: float  # Pa
    density: float  # kg/m3
    duration: float = 0.0  # s; 0: Hertz's
    threshold_velocity: float = 0.0  # slower impacts remove nothing, m/s
    mass_pickup: bool = True


def hertz_duration(mass: float, radius: float, effective_modulus: float, speed: float) -> float:
    """Duration of an elastic impact, from the deepest approach that the kinetic energy pays for.

    Paper: the time of impact of Section 2.1, given by Hertz.  The greatest approach d obeys
    m v^2/2 = (8/15) E* sqrt(R) d^(5/2), and the duration is a fixed multiple of d/v.
    Parameters: effective mass, kg; effective radius, m; effective modulus, Pa; speed of approach, m/s.
    Departure: the coefficient is the rounded 2.87 that the model defines, not the integral's 2.868.

    >>> round(hertz_duration(1.0, 1.0, 1.0, 1.0), 12)
    2.87
    """
    deepest = (0.5 * mass * speed**2 / (8 / 15 * effective_modulus * np.sqrt(radius))) ** 0.4
    multiple = HERTZ_COEFFICIENT / (0.5 / (8 / 15)) ** 0.4
    return float(multiple * deepest / speed)


def hertz_integral(mass: float, radius: float, effective_modulus: float, speed: float) -> float:
    """Duration of an elastic impact by quadrature of dt = dx/v(x) over compression and recovery.

    >>> round(hertz_integral(1.0, 1.0, 1.0, 1.0), 3)
    2.868
    """
    deepest = (0.5 * mass * speed**2 / (8 / 15 * effective_modulus * np.sqrt(radius))) ** 0.4

    def smooth(q: float) -> float:  # x = deepest (1 - q^2) removes the root singularity at the turning point
        return 2 * q / np.sqrt(-np.expm1(2.5 * np.log1p(-q * q)))

    return float(2 * deepest / speed * quad(smooth, 0.0, 1.0, epsrel=1e-12)[0])


def wall_impact(
    mass: float,
    velocity: ArrayLike,
    normal: ArrayLike,
    restitution: float,
    mass_gained: float = 0.0,
    external_force: float = 0.0,
    duration: float = 0.0,
) -> WallImpact:
    """Impact on a smooth wall, momentum balanced through compression, pick-up of mass, and recovery.

    Paper: Eqs. (23)-(31).  The wall stops the normal motion in duration/(1+e) against a constant external
    force; mass at rest joins; recovery gives back `restitution` times the first impulse.
    Parameters: mass, mass_gained, kg; velocity (3,), m/s; normal (3,), into the fluid; external_force, N,
    along the normal; duration, s.  Raises ValueError when the sphere does not approach.
    Departure: the tangential momentum is kept, so that the mass picked up slows the sphere along the wall.

    >>> hit = wall_impact(2.0, [1.0, 0.0, -4.0], [0.0, 0.0, 1.0], 0.5)
    >>> hit.velocity.tolist(), hit.normal_impulse, hit.energy_lost
    ([1.0, 0.0, 2.0], 12.0, 12.0)
    """
    velocity = np.asarray(velocity, float)
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    v_n = float(velocity @ n)
    if v_n >= 0:
        raise ValueError("the sphere does not approach the wall")
    tangential_momentum = mass * (velocity - v_n * n)

    compression_time = duration / (1 + restitution)
    stopping = -(mass * v_n + external_force * compression_time)
    returned = restitution * stopping
    mass_after = mass + mass_gained
    leaving_momentum = returned + external_force * (duration - compression_time)
    after = (tangential_momentum + leaving_momentum * n) / mass_after

    impulse = stopping + returned
    lost = 0.5 * mass * (velocity @ velocity) - 0.5 * mass_after * (after @ after)
    load = impulse / duration if duration > 0 else 0.0
    return WallImpact(after, mass_after, impulse, float(lost), duration, load, Removal(0.0, 0.0, 0.0))


def removing_impact(
    mass: float,
    radius: float,
    velocity: ArrayLike,
    normal: ArrayLike,
    wall: Wall,
    external_force: float = 0.0,
) -> WallImpact:
    """Impact on a wall that yields: impulse, load, cap removed, and the rebound with what was picked up.

    Paper: Eqs. (23)-(36).  Parameters as in `wall_impact`; radius, m, of the sphere.

    >>> soft = Wall(0.5, 1e9, 0.3, 1e6, 1000.0)
    >>> hit = removing_impact(1e-15, 5e-7, [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], soft)
    >>> round(float(hit.velocity[2]) * hit.mass / 1e-15, 12)
    0.5
    """
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    approach = -float(np.asarray(velocity, float) @ n)
    duration = wall.duration or hertz_duration(mass, radius, wall.effective_modulus, approach)
    hit = wall_impact(mass, velocity, n, wall.restitution, 0.0, external_force, duration)
    cut = Removal(0.0, 0.0, 0.0)
    if approach >= wall.threshold_velocity:
        cut = removal(hit.load, radius, wall.poisson_ratio, wall.yield_stress)
    gained = wall.density * cut.volume if wall.mass_pickup else 0.0
    hit = wall_impact(mass, velocity, n, wall.restitution, gained, external_force, duration)
    return hit._replace(removal=cut)
