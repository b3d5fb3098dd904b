"""The shear that all engines are timed on: its case, its setup, and the step of the soft engines.

The case is `decks/shear.toml`.  The runs are `shear_reference.py`, `shear_lammps.py` and `shear_liggghts.py`,
what they return is `outcome.py`, and what is made of them `engines.py`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from benchmarks.shear_reference import shear
from cmpcheck.engines.protocol import Resolution
from cmpcheck.study import contact_settings
from reference.case import Case, load_case
from reference.process import build_setup
from reference.state import Setup

DECKS = Path(__file__).with_name("decks")
SURFACES = ("flat", "asperities")
PARTICLE_STEPS = 8_000_000  # of a run of a soft engine: about a second where it is slow
LEAST_STEPS = 1_500
# The shear is timed once contacts have developed, for this time, in steps of 0.5 nm at most.  Until then the
# particles are SWOLLEN, by 18 nm, so that after it none overlap: only springs would part them.
DEVELOPED, DEVELOPING_STEP, SWOLLEN = 5e-6, 0.5e-9, 1.02


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
    """The setup of `shear_case`, from which all engines start: the reference has sheared it for a while."""
    setup = build_setup(shear_case(count, surface, steps))
    swollen = replace(setup, state=replace(setup.state, diameter=SWOLLEN * setup.state.diameter))
    _, _, end = shear(swollen, DEVELOPING_STEP, round(DEVELOPED / DEVELOPING_STEP))
    return replace(setup, state=replace(setup.state, position=end.position, velocity=end.velocity))


def soft_resolution(case: Case) -> Resolution:
    """Step and contact duration of all soft engines, those of [engine.lammps]."""
    duration, steps = contact_settings(case, "lammps")
    return Resolution(duration / steps, duration, "soft")


def soft_steps(setup: Setup) -> int:
    """Steps of the soft engines to the end of the shear."""
    return round(setup.end_time / soft_resolution(setup.case).time_step)
