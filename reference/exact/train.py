"""A sphere pressed on a flat wall by a flow through it: the sequence of its impacts.

Between impacts the motion is Stokes relaxation, solved for the time of return; each impact is that of
`wall.py`.
"""

from __future__ import annotations

from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from reference.exact.wall import Wall, WallImpact, removing_impact, wall_impact


class BounceTrain(NamedTuple):
    """Successive impacts of one sphere on a flat wall."""

    times: np.ndarray  # (n,), s
    approach_speeds: np.ndarray  # (n,), m/s, > 0
    external_forces: np.ndarray  # (n,), N, drag along the normal when the impact begins (< 0 presses)
    impacts: tuple[WallImpact, ...]

    @property
    def removed_volume(self) -> float:
        """Volume removed by all impacts, m3."""
        return sum(impact.removal.volume for impact in self.impacts)


def arrival(distance: float, speed: float, flow_speed: float, tau: float) -> tuple[float, float]:
    """When, and how fast, a sphere under Stokes drag reaches a wall towards which the fluid flows.

    Parameters: distance, m, from touch; speed, m/s, towards the wall (negative: away); flow_speed, m/s,
    towards the wall, positive; tau, s.  Returns (time, s; speed on arrival, m/s).
    From the wall itself (distance 0, moving away) it is the time of return.
    Raises ValueError for a negative distance or a flow that does not point to the wall.

    >>> arrival(4.0, 2.0, 2.0, 1.0)
    (2.0, 2.0)
    """
    if distance < 0 or not flow_speed > 0:
        raise ValueError("needs distance >= 0 and a flow towards the wall")
    if distance == 0 and speed >= 0:
        return 0.0, speed

    def gap(s: float) -> float:  # beyond the wall, in units of tau
        return -speed * np.expm1(-s) + flow_speed * _lag(s) - distance / tau

    turn = np.log1p(-speed / flow_speed) if speed < 0 else 0.0
    latest = (distance / tau + abs(flow_speed - speed)) / flow_speed + 1.0
    s = brentq(gap, turn, latest, xtol=1e-300, rtol=1e-15, maxiter=1000)
    return float(s * tau), float(speed * np.exp(-s) - flow_speed * np.expm1(-s))


def bounce_train(
    distance: float,
    speed: float,
    flow_speed: float,
    mass: float,
    radius: float,
    drag_factor: float,
    wall: Wall,
    impacts: int,
    removes: bool = True,
) -> BounceTrain:
    """Impacts of a sphere that a flow normal to a wall presses on it.

    Paper: Eqs. (20)-(31) in sequence, and (32)-(36) if it removes.  At each impact the drag along the
    normal is that of the moment before it, held for the duration of the impact.  The flow alone loads the
    wall at vanishing speed, so the removed volume is finite only with a threshold speed.
    Parameters: distance, m, from touch at time 0; speed, flow_speed, m/s, towards the wall; mass, kg;
    radius, m; drag_factor, N s/m, drag per slip (3 pi mu d); wall; impacts, their number.

    >>> hard = Wall(0.5, 1.0, 0.3, 1.0, 0.0, duration=1e-9)
    >>> train = bounce_train(0.0, 0.5, 0.5, 1.0, 1.0, 1.0, hard, 5, removes=False)
    >>> train.approach_speeds.round(3).tolist()
    [0.5, 0.187, 0.083, 0.039, 0.019]
    """
    up = np.array([0.0, 0.0, 1.0])
    clock, times, speeds, forces, hits = 0.0, [], [], [], []
    for _ in range(impacts):
        flight, approach = arrival(distance, speed, flow_speed, mass / drag_factor)
        clock += flight
        force = -drag_factor * (flow_speed - approach)
        if removes:
            hit = removing_impact(mass, radius, -approach * up, up, wall, force)
        else:
            hit = wall_impact(mass, -approach * up, up, wall.restitution, 0.0, force, wall.duration)
        times.append(clock)
        speeds.append(approach)
        forces.append(force)
        hits.append(hit)
        distance, speed, mass = 0.0, -float(hit.velocity[2]), hit.mass
    return BounceTrain(np.array(times), np.array(speeds), np.array(forces), tuple(hits))


def _lag(s: float) -> float:
    """Return s - 1 + exp(-s), by its series where the difference would cancel."""
    if s > 1:
        return float(s + np.expm1(-s))
    return sum((-s) ** k / factorial(k) for k in range(2, 20))
