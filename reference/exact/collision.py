"""Two spheres: first touch in free flight, the collision, and the flight after it.

The collision is solved from momentum and restitution as a linear system, and in the frame of the centre
of mass; walls are in `wall.py`.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from reference.exact.touch import broken_line, quadratic_touch


class Sphere(NamedTuple):
    """One sphere at time 0."""

    mass: float  # kg
    radius: float  # m
    position: np.ndarray  # (3,), m
    velocity: np.ndarray  # (3,), m/s


class SphereTouch(NamedTuple):
    """First touch of two spheres."""

    time: float  # s
    centre_i: np.ndarray  # (3,), m, unwrapped
    centre_j: np.ndarray  # (3,), m, of the image that is touched
    normal: np.ndarray  # (3,), from i to j
    point: np.ndarray  # (3,), m


class NormalImpact(NamedTuple):
    """Two bodies on a line after an impact in two phases."""

    velocity_i: float  # m/s
    velocity_j: float
    compression_impulse: float  # N s, up to the common velocity
    recovery_impulse: float  # N s, restitution times the former


class PairCollision(NamedTuple):
    """Outcome of an instantaneous collision of two spheres that do not spin."""

    velocity_i: np.ndarray  # (3,), m/s
    velocity_j: np.ndarray
    normal_impulse: float  # N s, >= 0
    friction_impulse: np.ndarray  # (3,), N s, on i
    energy_lost: float  # J
    sticks: bool  # no tangential slip is left


class PairTrajectory(NamedTuple):
    """Free flight of two spheres with one collision."""

    positions: np.ndarray  # (T, 2, 3), m, unwrapped
    velocities: np.ndarray  # (T, 2, 3), m/s
    touch: SphereTouch
    collision: PairCollision


def normal_impact(
    mass_i: float,
    mass_j: float,
    v_i: float,
    v_j: float,
    restitution: float,
    compression_i: float = 0.0,
    compression_j: float = 0.0,
    recovery_i: float = 0.0,
    recovery_j: float = 0.0,
) -> NormalImpact:
    """Impact on a line with external impulses, phase by phase.

    Paper: Eqs. (5)-(7), solved as a linear system.  Compression ends in a common velocity; the impulse of
    recovery is `restitution` times that of compression.
    Parameters: masses, kg; v_i, v_j, m/s, along the normal from i to j; the last four are impulses of the
    external forces along that normal over each phase, N s.

    >>> normal_impact(1.0, 1.0, 1.0, 0.0, 1.0)[:2]
    (0.0, 1.0)
    """
    # in the frame of i before the impact; unknowns: impulse of compression, common velocity
    system = np.array([[1.0, mass_i], [-1.0, mass_j]])
    known = np.array([compression_i, mass_j * (v_j - v_i) + compression_j])
    compression, common = np.linalg.solve(system, known)
    recovery = restitution * compression
    after_i = v_i + common + (recovery_i - recovery) / mass_i
    after_j = v_i + common + (recovery_j + recovery) / mass_j
    return NormalImpact(float(after_i), float(after_j), float(compression), float(recovery))


def pair_collision(
    mass_i: float,
    mass_j: float,
    velocity_i: ArrayLike,
    velocity_j: ArrayLike,
    normal: ArrayLike,
    restitution: float,
    static_friction: float = 0.0,
    dynamic_friction: float | None = None,
) -> PairCollision:
    """Collision of two spheres without external force, seen from their centre of mass.

    Paper: Eqs. (3)-(19).  Along the normal each velocity is reversed and multiplied by the restitution;
    across it both stop if the impulse for that is within static friction, else friction is dynamic.
    Parameters: masses, kg; velocities (3,), m/s; normal (3,), from i to j, any length; dynamic_friction:
    as static_friction if None.  Raises ValueError when the spheres do not approach.

    >>> hit = pair_collision(1.0, 3.0, [4.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], 1.0)
    >>> hit.velocity_i.tolist(), hit.velocity_j.tolist(), hit.normal_impulse
    ([-2.0, 0.0, 0.0], [2.0, 0.0, 0.0], 6.0)
    """
    velocity_i, velocity_j = np.asarray(velocity_i, float), np.asarray(velocity_j, float)
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    centre = (mass_i * velocity_i + mass_j * velocity_j) / (mass_i + mass_j)
    c_i, c_j = velocity_i - centre, velocity_j - centre
    if c_i @ n <= 0:
        raise ValueError("the spheres do not approach each other along the normal")

    after_normal = -restitution * (c_i @ n)
    impulse = mass_i * ((c_i @ n) - after_normal)
    across = c_i - (c_i @ n) * n
    stopping = -mass_i * across
    sticks = bool(np.linalg.norm(stopping) <= static_friction * impulse)
    mu = static_friction if dynamic_friction is None else dynamic_friction
    friction = stopping if sticks else mu * impulse * stopping / np.linalg.norm(stopping)

    after_i = after_normal * n + across + friction / mass_i
    after_j = -mass_i / mass_j * after_i
    lost = 0.5 * mass_i * (c_i @ c_i - after_i @ after_i) + 0.5 * mass_j * (c_j @ c_j - after_j @ after_j)
    return PairCollision(centre + after_i, centre + after_j, float(impulse), friction, float(lost), sticks)


def first_touch(
    i: Sphere, j: Sphere, periods: ArrayLike = (0.0, 0.0, 0.0), until: float = np.inf
) -> SphereTouch | None:
    """First touch of two spheres in free flight, over all periodic images reached before `until`.

    Parameters: periods (3,), m, 0 where not periodic; until, s, must be finite with periods.
    Returns None if there is no touch before `until`.
    Raises ValueError when they overlap at the start or `until` is infinite in a periodic box.

    >>> i = Sphere(1.0, 1.0, np.array([0.0, 0, 0]), np.array([1.0, 0, 0]))
    >>> j = Sphere(1.0, 1.0, np.array([5.0, 0, 0]), np.array([-2.0, 0, 0]))
    >>> touch = first_touch(i, j)
    >>> touch.time, touch.point.tolist()
    (1.0, [2.0, 0.0, 0.0])
    """
    distance = i.radius + j.radius
    position_i, velocity_i = np.asarray(i.position, float), np.asarray(i.velocity, float)
    position_j, velocity_j = np.asarray(j.position, float), np.asarray(j.velocity, float)
    separation, velocity = position_j - position_i, velocity_j - velocity_i
    periods = np.asarray(periods, float)
    if np.any(periods > 0) and not np.isfinite(until):
        raise ValueError("a periodic box needs a finite `until`")
    images = np.zeros(3, int)
    for k in np.flatnonzero(periods):
        reach = abs(separation[k]) + abs(velocity[k]) * until + distance
        images[k] = int(np.ceil(reach / periods[k]))
    shifts = np.array(list(product(*(range(-count, count + 1) for count in images)))) * periods
    times = quadratic_touch(separation + shifts, velocity, distance)
    first = int(np.argmin(times))
    time = float(times[first])
    if not time < until:
        return None
    centre_i = position_i + velocity_i * time
    centre_j = position_j + shifts[first] + velocity_j * time
    normal = (centre_j - centre_i) / distance
    return SphereTouch(time, centre_i, centre_j, normal, centre_i + i.radius * normal)


def pair_trajectory(
    times: ArrayLike,
    i: Sphere,
    j: Sphere,
    restitution: float,
    static_friction: float = 0.0,
    dynamic_friction: float | None = None,
    periods: ArrayLike = (0.0, 0.0, 0.0),
) -> PairTrajectory:
    """Free flight of two spheres through their first collision, and straight on after it.

    Parameters: times (T,), s, ascending from 0; see `first_touch` and `pair_collision`.
    Raises ValueError when they do not touch before the last time.

    >>> i = Sphere(1.0, 1.0, np.array([0.0, 0, 0]), np.array([1.0, 0, 0]))
    >>> j = Sphere(1.0, 1.0, np.array([5.0, 0, 0]), np.array([-2.0, 0, 0]))
    >>> pair_trajectory([2.0], i, j, 1.0).positions[0, :, 0].tolist()
    [-1.0, 4.0]
    """
    times = np.asarray(times, float)
    touch = first_touch(i, j, periods, until=float(times[-1]))
    if touch is None:
        raise ValueError(f"the spheres do not touch within {times[-1]} s")
    hit = pair_collision(
        i.mass, j.mass, i.velocity, j.velocity, touch.normal, restitution, static_friction, dynamic_friction
    )
    path_i = broken_line(times, i.position, i.velocity, touch.time, hit.velocity_i)
    path_j = broken_line(times, j.position, j.velocity, touch.time, hit.velocity_j)
    positions = np.stack([path_i[0], path_j[0]], axis=1)
    velocities = np.stack([path_i[1], path_j[1]], axis=1)
    return PairTrajectory(positions, velocities, touch, hit)
