"""Wear by Finnie's law, as LIGGGHTS has it, beside the paper's removal: single impacts by angle and speed.

One sphere, a flat wall, no friction: what one impact removes by the paper's Eqs. 30-36, through the
reference's kernel; by Finnie's law of 1960; by LIGGGHTS; and by the integral that LIGGGHTS's sum stands for.
Without LIGGGHTS the laws are compared all the same.  Here are the impacts and the study; the laws are
`wear_laws.py`, tables, charts and sentence `wear_shown.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cmpcheck.display import number
from cmpcheck.engines.liggghts_library import available
from cmpcheck.engines.liggghts_wear import FinnieDeck
from cmpcheck.results import StudyResult
from cmpcheck.studies import wear_shown
from cmpcheck.studies.sampling import changed
from cmpcheck.studies.wear_laws import SPEED, SPEED_ANGLE, Laws, Worn, exponents, judged
from reference.case import load_case

CASE = "wall_bounce"
COPPER = {"soft_copper": {"yield_stress": "0.3 GPa"}}  # what copper has; the case's is far softer
ANGLES = {"quick": (5, 10, 15, 20, 30, 45, 60, 75, 90), "full": tuple(range(5, 95, 5))}
SPEEDS = {"quick": (0.05, 0.1, 1.0, 10.0), "full": (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)}
STEPS = {"quick": (100, 200, 400), "full": (100, 200, 400, 800)}  # per contact


def study(profile: str, runs: Path) -> StudyResult:
    """Removed volume of single impacts by angle and by speed, by four laws."""
    (case,) = changed(load_case(CASE).variants()[0], material=COPPER).variants()
    laws = Laws(case)
    angles, speeds, steps = ANGLES[profile], SPEEDS[profile], STEPS[profile]
    threshold = float(np.rad2deg(np.arcsin(laws.model.threshold_velocity / SPEED)))
    zeros = {
        "head-on": (SPEED, 90.0),
        "grazing, just below the paper's threshold": (SPEED, threshold * (1 - 1e-9)),
        "grazing, just above it": (SPEED, threshold * (1 + 1e-9)),
    }
    impacts = [(SPEED, float(a)) for a in angles] + [(v, SPEED_ANGLE) for v in speeds] + [*zeros.values()]
    found, reason = available()
    worn = _run(laws, impacts, steps) if found else {}
    fits = exponents(laws, speeds, worn)
    absent = "" if found else f" LIGGGHTS was not tested: {reason}."
    return StudyResult(
        name="wear",
        title="Finnie's wear beside the paper's removal",
        varied="Impact angle, from the wall, and speed. A rigid sphere without friction strikes a flat wall; "
        f"k_finnie = 1/(4 σ_y) = {number(laws.coefficient, 3)} 1/Pa is Finnie's constant for a flow stress "
        "σ_y, a factor on all his volumes that a fit would change. LIGGGHTS adds up 2 k f(γ) |v| |F| Δt "
        "while the sphere approaches, with speed v, angle γ and force F of each step; the integral that this "
        "tends to is found by quadrature and in closed form. Its finest three levels of "
        f"{steps[0]} to {steps[-1]} steps per contact give order and limit; near 90° the angle turns within "
        "the last steps of the approach, and the order shows only at smaller ones.",
        samples=f"Single impacts of the sphere of {CASE} on copper (σ_y = 0.3 GPa), no random numbers.",
        tables=(
            wear_shown.angle_table(laws, angles, worn), wear_shown.levels_table(laws, angles, steps, worn),
            wear_shown.speed_table(laws, speeds, worn), wear_shown.exponents_table(fits),
            wear_shown.zeros_table(laws, zeros, worn),
        ),
        sentence=wear_shown.sentence(laws, angles, fits, threshold, worn) + absent,
        charts=wear_shown.charts(laws, angles, speeds, worn),
    )  # fmt: skip


def _run(
    laws: Laws, impacts: Sequence[tuple[float, float]], steps: Sequence[int]
) -> dict[tuple[float, float], Worn]:
    """What LIGGGHTS finds, by speed and angle."""
    deck = FinnieDeck()
    try:
        values = {
            impact: tuple(float(deck.removed(laws.impact(*impact, n)).sum()) for n in steps)
            for impact in impacts
        }
    finally:
        deck.close()
    return {impact: judged(laws, impact, steps, volumes) for impact, volumes in values.items()}
