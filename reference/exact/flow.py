"""A sphere in a flow, away from walls: Stokes relaxation, shear, and drag through all regimes of Reynolds.

Closed forms where they exist, else integration at round-off level with a restart where the drag
coefficient jumps.  Repeated bounces under drag are in `train.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

# Drag coefficient = a Re^b up to each Reynolds number (the paper's table after Eq 20).
REGIMES = (
    (1.0, 24.0, -1.0),
    (400.0, 24.0, -0.646),
    (3e5, 0.5, 0.0),
    (2e6, 0.000366, 0.4275),
    (np.inf, 0.18, 0.0),
)


class DragMotion(NamedTuple):
    """Motion of a sphere relaxing to a uniform flow."""

    positions: np.ndarray  # (T, 3), m
    velocities: np.ndarray  # (T, 3), m/s
    crossings: tuple[float, ...]  # s, when the Reynolds number fell past a limit of the table


def drag_coefficient(reynolds: float) -> float:
    """Drag coefficient of a sphere, read from the table row by row.

    >>> drag_coefficient(0.5), drag_coefficient(1000.0)
    (48.0, 0.5)
    """
    if not reynolds > 0:
        raise ValueError(f"the Reynolds number must be positive, not {reynolds}")
    a, b = next((a, b) for limit, a, b in REGIMES if reynolds <= limit)
    return a * reynolds**b


def stokes_time(mass: float, diameter: float, viscosity: float) -> float:
    """Time in which a slow sphere adopts the velocity of the fluid, mass over Stokes's drag per speed.

    >>> round(stokes_time(3 * np.pi, 1.0, 0.5), 12)
    2.0
    """
    return mass / (3 * np.pi * viscosity * diameter)


def stokes_motion(
    times: ArrayLike, position: ArrayLike, velocity: ArrayLike, flow: ArrayLike, tau: float
) -> DragMotion:
    """Motion in a uniform flow while Re <= 1.

    Parameters: times (T,), s; position, velocity, flow (3,), m and m/s; tau, s, see `stokes_time`.

    >>> float(stokes_motion([0.0, 1.0], [0, 0, 0], [1.0, 0, 0], [0, 0, 0], 1.0).velocities[1, 0].round(3))
    0.368
    """
    t = np.asarray(times, float)[:, None]
    flow, slip = np.asarray(flow, float), np.asarray(velocity, float) - np.asarray(flow, float)
    velocities = flow + slip * np.exp(-t / tau)
    positions = np.asarray(position, float) + flow * t - slip * tau * np.expm1(-t / tau)
    return DragMotion(positions, velocities, ())


def implicit_euler_speed(
    steps: ArrayLike, speed: float, flow: float, time_step: float, tau: float
) -> np.ndarray:
    """Speed after n steps of implicit Euler on Stokes drag: each step divides the slip by 1 + dt/tau.

    >>> float(implicit_euler_speed(2, 4.0, 0.0, 1.0, 1.0))
    1.0
    """
    return flow + (speed - flow) * (1 + time_step / tau) ** (-np.asarray(steps, float))


def fixed_point_ratio(time_step: float, tau: float) -> float:
    """Ratio of successive errors of the position when implicit Euler with Stokes drag is iterated.

    The iterate r gives the velocity (r - r0)/dt; drag turns a change of it by c into -c dt/tau.

    >>> fixed_point_ratio(1.0, 4.0)
    -0.25
    """
    return -time_step / tau


def couette_motion(
    times: ArrayLike, position: ArrayLike, velocity: ArrayLike, wall_speed: float, gap: float, tau: float
) -> DragMotion:
    """Motion in the shear flow u = (V z/H, 0, 0) while Re <= 1; vertical motion carries it to other speeds.

    Parameters: times (T,), s; position, velocity (3,); wall_speed, V, m/s; gap, H, m; tau, s.
    With s = t/tau: across the flow the velocity decays as exp(-s), so the fluid's speed at the sphere is
    that at the final height minus a decaying part, which drives the resonant term s exp(-s).

    >>> motion = couette_motion([50.0], [0, 0, 2.0], [0, 0, 1.0], 6.0, 3.0, 1.0)
    >>> float(motion.positions[0, 2]), float(motion.velocities[0, 0].round(12))
    (3.0, 6.0)
    """
    position, velocity = np.asarray(position, float), np.asarray(velocity, float)
    motion = stokes_motion(times, position, velocity, np.zeros(3), tau)
    t = np.asarray(times, float)
    s, decay = t / tau, np.exp(-t / tau)
    shear = wall_speed / gap
    rise = shear * velocity[2] * tau
    final = shear * position[2] + rise
    motion.velocities[:, 0] = final + (velocity[0] - final - rise * s) * decay
    motion.positions[:, 0] = position[0] + final * t - (velocity[0] - final) * tau * np.expm1(-s)
    motion.positions[:, 0] += rise * tau * ((1 + s) * decay - 1)
    return motion


def drag_motion(
    times: ArrayLike,
    position: ArrayLike,
    velocity: ArrayLike,
    flow: ArrayLike,
    mass: float,
    diameter: float,
    fluid_density: float,
    viscosity: float,
) -> DragMotion:
    """Motion in a uniform flow with the drag coefficient of every regime.

    The slip keeps its direction, so its logarithm and the distance slipped are integrated (relative
    tolerance 1e-12), one table row at a time, up to the event at which the next row begins.
    Parameters: times (T,), s, ascending; position, velocity, flow (3,); SI.

    >>> motion = drag_motion([0.0, 9.0], [0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], 1.0, 1.0, 1.0, 1.0)
    >>> motion.positions[1].tolist()
    [9.0, 0.0, 0.0]
    """
    t = np.asarray(times, float)
    position, flow = np.asarray(position, float), np.asarray(flow, float)
    slip = np.asarray(velocity, float) - flow
    speed = float(np.linalg.norm(slip))
    if speed == 0.0:
        return DragMotion(position + flow * t[:, None], np.tile(flow, (len(t), 1)), ())

    # in units of the initial slip and of the time that its drag would take to stop the sphere
    reynolds = fluid_density * speed * diameter / viscosity
    force = 0.5 * fluid_density * speed**2 * drag_coefficient(reynolds) * 0.25 * np.pi * diameter**2
    unit = mass * speed / force
    now, state, crossings = 0.0, np.zeros(2), []
    row = next(k for k, (limit, _, _) in enumerate(REGIMES) if reynolds <= limit)
    logs, distances = np.empty(len(t)), np.empty(len(t))
    for k, target in enumerate(t / unit):
        while now < target:
            now, state, crossed = _slow_down(now, target, state, reynolds, row)
            if crossed:
                row -= 1
                crossings.append(now * unit)
        logs[k], distances[k] = state
    positions = position + flow * t[:, None] + slip * unit * distances[:, None]
    return DragMotion(positions, flow + slip * np.exp(logs)[:, None], tuple(crossings))


def _slow_down(
    start: float, end: float, state: np.ndarray, reynolds: float, row: int
) -> tuple[float, np.ndarray, bool]:
    """Integrate (log of slip, distance slipped) within one row of the table, up to its lower limit."""
    _, a, b = REGIMES[row]
    scale = a * reynolds**b / drag_coefficient(reynolds)
    floor = np.log(REGIMES[row - 1][0] / reynolds) if row else -np.inf

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [-scale * np.exp((1 + b) * y[0]), np.exp(y[0])]

    def leaves_row(_: float, y: np.ndarray) -> float:
        return float(y[0] - floor) if row else 1.0

    leaves_row.terminal = True  # type: ignore[attr-defined]
    path = solve_ivp(rate, (start, end), state, "DOP853", events=leaves_row, rtol=1e-12, atol=1e-14)
    if path.status < 0:
        raise RuntimeError(f"the drag equation was not integrated: {path.message}")
    state = path.y[:, -1]
    crossed = path.status == 1
    if crossed:
        state[0] = floor
    return float(path.t[-1]), state, crossed


def terminal_slips(force: float, diameter: float, fluid_density: float, viscosity: float) -> list[float]:
    """Slips at which the drag balances a constant force, ascending: one per regime that has a balance.

    The drag coefficient jumps down past some limits, so a force can have more than one balance.
    Parameters: force, N; diameter, m; density, kg/m3; viscosity, Pa s.  Returns m/s.

    >>> terminal_slips(3 * np.pi, 1.0, 1.0, 2.0)
    [0.5]
    """
    reynolds_per_speed = fluid_density * diameter / viscosity
    slips, lower = [], 0.0
    for limit, a, b in REGIMES:
        area = 0.25 * np.pi * diameter**2
        reynolds = (force * reynolds_per_speed**2 / (0.5 * fluid_density * area * a)) ** (1 / (2 + b))
        if lower < reynolds <= limit:
            slips.append(float(reynolds / reynolds_per_speed))
        lower = limit
    return slips
