"""What contacts of finite duration make of a sphere that rests on a wall and is struck by an equal one.

Springs and dashpots have no scale of time but t_c, nor one of length but v t_c: the outcome in units of the
speed v does not depend on t_c, so it does not change as t_c -> 0.  It depends on the ratio of the two contact
durations.  Impacts in turn, which the model has: `reference.exact.resting_struck`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from cmpcheck.fixes.calibration import damping_ratio, spring

FINE = {"rtol": 1e-10, "atol": 1e-12}
LET_GO = 1e-9  # m v/t_c: a force below it is none
MOST_CONTACTS = 20
AFTERWARDS = 30.0  # contact durations in which everything has parted


class Outcome(NamedTuple):
    """Speeds after, positive away from the wall, and the wall's impulse, in units of v and m v."""

    lower: float
    upper: float
    approaches: tuple[float, ...]  # at which contacts with the wall begin
    normal_impulse: float


def struck_softly(ratio: float, restitution: float) -> Outcome:
    """Both contacts are springs and dashpots that never pull, each of them alone returns the restitution.

    Parameters: ratio of the wall's contact duration to that of the spheres, > 0; restitution of both, > 0.

    >>> outcome = struck_softly(1.0, 0.5)
    >>> round(outcome.lower, 3), round(outcome.upper, 3)
    (0.267, 0.561)
    """
    wall_spring, wall_damping = spring(restitution, ratio)
    pair = _pair_force(restitution)

    def wall(y: np.ndarray) -> float:
        return max(0.0, -wall_spring * y[0] - wall_damping * y[2]) if y[0] < 0.0 else 0.0

    def motion(_: float, y: np.ndarray) -> list[float]:
        return [y[2], y[3], wall(y) - pair(y), pair(y)]

    longer, shorter = max(1.0, ratio), min(1.0, ratio)
    end = AFTERWARDS * longer
    path = solve_ivp(motion, (0.0, end), [0.0, 0.0, 0.0, -1.0], max_step=shorter / 20, **FINE)
    approaches: list[float] = []
    touching = False
    for y in path.y.T:
        if not touching and y[0] < 0.0 and y[2] < 0.0:
            touching = True
            approaches.append(max(0.0, -float(y[2])) if approaches else 0.0)
        elif touching and wall(y) == 0.0:
            touching = False
    lower, upper = map(float, path.y[2:, -1])
    return Outcome(lower, upper, tuple(approaches), 1.0 + lower + upper)


def struck_by_impulses(restitution: float) -> Outcome:
    """The wall acts at once, but only after the contact of the spheres, a spring and dashpot, has let go.

    That contact ends before its overlap does (it never pulls).  When the wall throws the lower sphere back,
    the next contact therefore begins within an overlap, whose energy it returns in addition; and a contact
    that had let go pushes again where the wall has slowed the parting.
    Raises ValueError where this does not end: at small e.

    >>> outcome = struck_by_impulses(0.5)
    >>> round(outcome.lower, 3), round(outcome.upper, 3)
    (0.057, 0.275)
    """
    pair, approaches, impulse = _pair_force(restitution), [], 0.0

    def motion(_: float, y: np.ndarray) -> list[float]:
        return [y[2], y[3], -pair(y), pair(y)]

    y = np.array([0.0, 0.0, 0.0, -1.0])
    for _ in range(MOST_CONTACTS):
        if y[3] < y[2] or pair(y) > 2.0 * LET_GO:
            if y[1] > y[0]:
                y[:2] += (y[1] - y[0]) / (y[2] - y[3]) * y[2:]
            path = solve_ivp(motion, (0.0, 2.0), y, max_step=0.05, events=_let_go(pair), **FINE)
            y = path.y[:, -1].copy()
        elif y[2] < 0.0:
            y[:2] += max(0.0, y[0] / -y[2]) * y[2:]
            approaches.append(-float(y[2]))
            impulse += (1.0 + restitution) * -float(y[2])
            y[2] *= -restitution
        else:
            return Outcome(float(y[2]), float(y[3]), tuple(approaches), impulse)
    raise ValueError(f"e = {restitution}: the contacts do not end")


def pinned_restitution(restitution: float) -> float:
    """The rebound of the upper sphere where the wall is so stiff that the lower one does not move.

    Spring and dashpot are the pair's, calibrated for m/2, and now act on m: the damping ratio is lower by
    sqrt(2).  Valid for e > exp(-2), below critical damping.

    >>> round(pinned_restitution(0.5), 4)
    0.6005
    """
    z = damping_ratio(restitution) / math.sqrt(2.0)
    return math.exp(-2.0 * z * math.acos(z) / math.sqrt((1.0 - z) * (1.0 + z)))


def _pair_force(restitution: float) -> Callable[[np.ndarray], float]:
    """Force between the spheres per mass of one, from [z_lower, z_upper, v_lower, v_upper]; t_c = 1."""
    stiffness, damping = spring(restitution, 1.0)

    def force(y: np.ndarray) -> float:
        overlap = y[0] - y[1]  # heights are those above the first touch
        return 0.5 * max(0.0, stiffness * overlap + damping * (y[2] - y[3])) if overlap >= 0.0 else 0.0

    return force


def _let_go(pair: Callable[[np.ndarray], float]) -> Callable[[float, np.ndarray], float]:
    def event(_: float, y: np.ndarray) -> float:
        return pair(y) - LET_GO

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = -1.0  # type: ignore[attr-defined]
    return event
