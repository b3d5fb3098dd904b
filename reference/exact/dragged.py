"""Two spheres that collide while a uniform flow drags them: Eqs 3-18 where the external force matters.

Each sphere relaxes by Stokes's drag until they touch; the collision is solved phase by phase with the impulse
of the drag at touch over each phase; after it each relaxes again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from reference.exact.collision import Sphere, normal_impact
from reference.exact.flow import stokes_motion, stokes_time


class NoTouch(ValueError):
    """Spheres that do not meet."""


class DraggedCollision(NamedTuple):
    """One collision of two dragged spheres."""

    time: float  # s, of touch
    normal: np.ndarray  # (3,), from i to j
    approach_speed: float  # m/s
    normal_impulse: float  # N s
    friction_impulse: np.ndarray  # (3,), N s, on i
    velocities: np.ndarray  # (2, 3), m/s, just after it, while the drag has yet to act
    sticks: bool


def dragged_collision(
    i: Sphere, j: Sphere, flow: ArrayLike, viscosity: float, duration: float, restitution: float,
    friction: float, until: float,
) -> DraggedCollision:  # fmt: skip
    """First collision of two spheres in a uniform flow at Re <= 1.

    Paper: Eqs. (3)-(18); the drag E of each at touch acts over the duration delta t, over compression for
    delta t/(1+e) of it.  Impulses are what the contact gives, without that of the drag.
    Parameters: spheres; flow (3,), m/s; viscosity, Pa s; duration, s, of the contact; friction, both
    coefficients; until, s.  Raises NoTouch, a ValueError, when they do not touch until then.

    >>> i = Sphere(1.0, 1.0, np.array([0.0, 0, 0]), np.array([1.0, 0, 0]))
    >>> j = Sphere(1.0, 1.0, np.array([3.0, 0, 0]), np.array([0.0, 0, 0]))
    >>> hit = dragged_collision(i, j, [0.0, 0, 0], 1e-9, 1e-9, 1.0, 0.0, 5.0)
    >>> round(hit.time, 6), round(hit.normal_impulse, 6)
    (1.0, 1.0)
    """
    u = np.asarray(flow, float)
    taus = [stokes_time(s.mass, 2 * s.radius, viscosity) for s in (i, j)]

    def state(time: float) -> tuple[np.ndarray, np.ndarray]:
        motions = [
            stokes_motion([time], s.position, s.velocity, u, tau) for s, tau in zip((i, j), taus, strict=True)
        ]
        return np.array([m.positions[0] for m in motions]), np.array([m.velocities[0] for m in motions])

    def gap(time: float) -> float:
        r, _ = state(time)
        return float(np.linalg.norm(r[1] - r[0])) - i.radius - j.radius

    times = np.linspace(0.0, until, 2001)
    met = np.flatnonzero(np.array([gap(time) for time in times]) < 0.0)
    if not len(met) or met[0] == 0:
        raise NoTouch(f"the spheres do not touch within {until} s")
    time = float(brentq(gap, times[met[0] - 1], times[met[0]], xtol=1e-25, rtol=1e-15))
    r, v = state(time)
    masses, radii = (i.mass, j.mass), (i.radius, j.radius)
    return impact_in_flow(masses, radii, r, v, u, viscosity, duration, restitution, friction, time)


def impact_in_flow(
    masses: tuple[float, float], radii: tuple[float, float], positions: np.ndarray, velocities: np.ndarray,
    flow: np.ndarray, viscosity: float, duration: float, restitution: float, friction: float,
    time: float = 0.0,
) -> DraggedCollision:  # fmt: skip
    """The collision of two spheres that touch, as `dragged_collision` solves it.

    Parameters: masses, kg; radii, m; positions and velocities (2, 3), m and m/s; the rest as there.
    """
    r, v, u = positions, velocities, flow
    taus = [stokes_time(m, 2 * radius, viscosity) for m, radius in zip(masses, radii, strict=True)]
    normal = (r[1] - r[0]) / np.linalg.norm(r[1] - r[0])
    force = (np.array(masses) / taus)[:, None] * (u - v)
    along, speeds = force @ normal, v @ normal
    shares = np.array([1.0, restitution]) * duration / (1.0 + restitution)  # compression, recovery
    hit = normal_impact(
        *masses, float(speeds[0]), float(speeds[1]), restitution,
        *(float(along[k] * share) for share in shares for k in (0, 1)),
    )  # fmt: skip
    impulse = hit.compression_impulse + hit.recovery_impulse
    # over the contact, drag alone would change the slip by this; friction stops what is there at its end
    mass = np.array(masses)[:, None]
    across = (v + force * duration / mass) - ((v + force * duration / mass) @ normal)[:, None] * normal
    reduced = masses[0] * masses[1] / sum(masses)
    stopping = reduced * (across[1] - across[0])
    sticks = bool(np.linalg.norm(stopping) <= friction * impulse)
    given = stopping if sticks else friction * impulse * stopping / np.linalg.norm(stopping)
    after = v + np.outer([-1.0, 1.0], impulse * normal) / mass + np.outer([1.0, -1.0], given) / mass
    approach = float(speeds[0] - speeds[1])
    return DraggedCollision(time, normal, approach, impulse, given, after, sticks)
