"""What a timed run returns, and whether its speed may be believed: a broken set-up is often the fastest."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.state import Setup

# An engine may differ from the reference by this much: at N = 5000, where few trajectories have parted,
# restitution 1 instead of 0.5 does by 3 %, and steps of 9 ns do by 1 %;
DIFFERENCE = 0.05
# or by so many standard errors of the mean difference of a particle: equal starts part after some collisions,
# and then differ as two samples do.  With about 100 comparisons, 4 is a false alarm in 150 benchmarks.
ERRORS = 4.0


class Timed(NamedTuple):
    """A run: how long its steps took, and where it has ended; K particles are left, SI."""

    seconds: float  # wall-clock time of the steps alone
    steps: int
    time_step: float  # s
    index: np.ndarray  # (K,) of the particles, in any order
    position: np.ndarray  # (K, 3), m
    velocity: np.ndarray  # (K, 3), m/s


class Outcome(NamedTuple):
    """The end of a run beside that of the reference."""

    kept: int  # particles between surface and lid
    energy: float  # kinetic energy per particle, over that of the reference
    shift: float  # mean change of height, over that of the reference
    problem: str  # why the speed is not to be believed, "" if it is


def outcome(setup: Setup, timed: Timed, usual: Timed) -> Outcome:
    """The end of a run judged by that of the reference with the same step, `usual`."""
    z, n = timed.position[:, 2], len(setup.state.mass)
    inside = np.isfinite(timed.velocity).all(axis=1) & (z > 0.0) & (z < setup.state.pad_height)
    kept = len(np.unique(timed.index[inside]))
    if kept != n:
        return Outcome(kept, math.nan, math.nan, f"kept {kept} of {n} particles")
    ratios, problems = [], []
    for name, mine, theirs in zip(
        ("kinetic energy", "change of height"),
        _particles(setup, timed),
        _particles(setup, usual),
        strict=True,
    ):
        apart, mean = mine - theirs, float(theirs.mean())
        ratios.append(float(mine.mean()) / mean)
        allowed = max(DIFFERENCE * mean, ERRORS * float(apart.std()) / math.sqrt(n))
        if not abs(float(apart.mean())) <= allowed:
            problems.append(f"{name} {ratios[-1]:.3g} times the reference's")
    return Outcome(kept, ratios[0], ratios[1], ", ".join(problems))


def _particles(setup: Setup, timed: Timed) -> tuple[np.ndarray, np.ndarray]:
    """Kinetic energy, J, and change of height, m, of each particle, (N,)."""
    order = np.argsort(timed.index)
    kinetic = 0.5 * setup.state.mass * (timed.velocity[order] ** 2).sum(axis=1)
    return kinetic, abs(timed.position[order, 2] - setup.state.position[:, 2])
