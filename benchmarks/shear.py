"""The shear that all engines are timed on: its setups, what a timed run returns, and when it may be believed.

The case is `decks/shear.toml`; the runs are `shear_reference.py`, `shear_lammps.py` and `shear_liggghts.py`,
what is made of them is `engines.py`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmpcheck.engines.protocol import Resolution
from cmpcheck.study import contact_settings
from reference.case import Case, load_case
from reference.process import build_setup
from reference.state import Setup

DECKS = Path(__file__).with_name("decks")
SURFACES = ("flat", "asperities")
PARTICLE_STEPS = 8_000_000  # of a run at the step of the soft engines: about a second where they are slow
LEAST_STEPS = 1_500
ENERGY_FACTOR, SHIFT_FACTOR = 1.2, 2.0  # between an engine and the median of all; `complaint` says why


class Timed(NamedTuple):
    """A run of the shear: how long its steps took, and where it has ended; K particles are left, SI."""

    seconds: float  # wall-clock time of the steps alone
    steps: int
    index: np.ndarray  # (K,) of the particles, in any order
    position: np.ndarray  # (K, 3), m
    velocity: np.ndarray  # (K, 3), m/s


class Outcome(NamedTuple):
    """What must be alike in all engines at the end of a run."""

    kept: int  # particles between surface and lid
    energy: float  # kinetic energy per particle, J
    shift: float  # mean change of height, m: the flow is level, so that contacts alone do it


def shear_case(count: int, surface: str, steps: int | None = None) -> Case:
    """The shear of `count` particles over a surface "flat" or with "asperities", always equally dense.

    It lasts `steps` steps of the soft engines, by default so many that all sizes cost about the same.
    """
    case = load_case(DECKS / "shear.toml")
    assert case.particles is not None
    assert case.surface.nodes is not None
    nodes = round(case.surface.nodes * math.sqrt(count / case.particles.count))
    steps = steps or max(LEAST_STEPS, round(PARTICLE_STEPS / count))
    values: dict[str, object] = {
        "particles.count": count,
        "surface.nodes": nodes,
        "surface.size": case.surface.size / case.surface.nodes * nodes,
        "case.duration": steps * soft_resolution(case).time_step,
    }
    if surface == "flat":
        values |= {"surface.kind": "flat", "surface.asperity_height": None, "surface.asperity_density": None}
    return case.replaced(values)


def shear_setup(count: int, surface: str, steps: int | None = None) -> Setup:
    """The setup of `shear_case`."""
    return build_setup(shear_case(count, surface, steps))


def soft_resolution(case: Case) -> Resolution:
    """Step and contact duration of all soft engines, those of [engine.lammps]."""
    duration, steps = contact_settings(case, "lammps")
    return Resolution(duration / steps, duration, "soft")


def soft_steps(setup: Setup) -> int:
    """Steps of the soft engines to the end of the shear."""
    return round(setup.end_time / soft_resolution(setup.case).time_step)


def outcome(setup: Setup, timed: Timed) -> Outcome:
    """Where a run has ended, as three numbers."""
    start, z = setup.state.position[timed.index, 2], timed.position[:, 2]
    inside = (z > 0.0) & (z < setup.state.pad_height)
    kinetic = 0.5 * setup.state.mass[timed.index] * (timed.velocity**2).sum(axis=1)
    return Outcome(len(np.unique(timed.index[inside])), float(kinetic.mean()), float(abs(z - start).mean()))


def complaint(setup: Setup, found: Outcome, usual: Outcome) -> str:
    """Why the speed of a run is not to be believed, "" if it is; `usual` are the medians of all engines.

    Equal starts part after some collisions, so that ends agree as two samples of one process do.  Energy is
    that of the flow, which the heights decide: factor ENERGY_FACTOR.  Without contacts the shift is 0 and
    without drag several times as large, and that of 73 particles scatters by a fifth: SHIFT_FACTOR.
    """
    n = len(setup.state.mass)
    if found.kept != n:
        return f"kept {found.kept} of {n} particles"
    for name, value, middle, factor in (
        ("kinetic energy", found.energy, usual.energy, ENERGY_FACTOR),
        ("change of height", found.shift, usual.shift, SHIFT_FACTOR),
    ):
        if not middle / factor <= value <= middle * factor:
            return f"{name} {value:.3g}, {value / middle:.2g} times the median of the engines"
    return ""
