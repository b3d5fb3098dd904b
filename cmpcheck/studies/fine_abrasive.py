"""What each scheme makes of a step that is longer than the relaxation time (Section 3.1, Eqs 37-43).

Only short runs of the reference and what they show; the schemes are `reference/schemes.py`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.results import StudyResult
from cmpcheck.studies.tables import frame_table
from reference.case import Case, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import SimulationError, simulate_setup

CASE = "fine_abrasive"
SCHEMES = (("fixed_point", "printed"), ("fixed_point", "displacement"), ("point_implicit", ""))
PART = 0.02  # of the case's duration that is simulated
OUTPUTS = 101
HOLDS = "holds"
COLUMNS = (
    "scheme", "norm", "largest_speed", "steps", "rejected_steps", "time", "removals", "fluid_work", "outcome",
)  # fmt: skip


def study(profile: str, runs: Path) -> StudyResult:
    """The schemes beside each other, and what the setup of the case warns of."""
    (case,) = load_case(CASE).variants()
    found = table(case)
    return StudyResult(
        name=CASE,
        title="Steps longer than the relaxation time",
        varied="The scheme, and the norm by which its iteration is stopped; the initial state is the same.",
        samples=f"The case {CASE} itself, seed {case.case.seed}, the first {PART:.0%} of its duration.",
        tables=(frame_table("Each scheme from the same start", found, {"time": "s", "fluid_work": "J"}),),
        sentence=" ".join([sentence(found), *(f"{_capital(note)}." for note in build_setup(case).notes)]),
    )


def table(case: Case) -> pd.DataFrame:
    """One short run of a case with a pad for each scheme and norm, from the same initial state.

    Paper: Section 3.1, step 3(a), and Eqs. (37)-(43).
    Returns: scheme, norm, largest recorded speed over that of the pad (-), accepted and rejected steps, time
    reached (s), impacts that removed material, work of the fluid (J), and the outcome in words.  No fluid in
    such a case is faster than the pad, and impacts do not add to that: speeds beyond it are the scheme's.
    Raises CaseError for a case without a pad, or one that cannot be set up.
    """
    if case.pad is None:
        raise case.error("pad", None, "required: speeds are compared with that of the pad")
    rows = [_row(case, scheme, norm) for scheme, norm in SCHEMES]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def sentence(found: pd.DataFrame) -> str:
    """What the table shows, in one sentence."""
    rows = found.set_index(["scheme", "norm"]).to_dict("index")
    printed, moved, implicit = (rows[scheme] for scheme in SCHEMES)
    cost = (moved["steps"] + moved["rejected_steps"]) / implicit["steps"]
    return (
        f"Over {1e6 * implicit['time']:.3g} us fixed_point with the norm as printed {_verdict(printed)}; "
        f"with the norm of displacements it {_verdict(moved)}, after {moved['steps']} accepted and "
        f"{moved['rejected_steps']} rejected steps, {cost:.3g} times those of point_implicit, which "
        f"{_verdict(implicit)}."
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _verdict(row: dict[str, Any]) -> str:
    return f"{row['outcome']} (largest {row['largest_speed']:.3g} V_pad, {row['removals']} removals)"


def _row(case: Case, scheme: str, norm: str) -> dict[str, Any]:
    numerics = {"scheme": scheme} | ({"norm": norm} if norm else {})
    setup = build_setup(
        case.model_copy(update={"numerics": case.numerics.model_copy(update=numerics)})
    )  # of the whole duration, which sets the speed of the descent
    end = PART * setup.end_time
    outcome = ""
    try:
        run = simulate_setup(replace(setup, end_time=end, output_times=np.linspace(0.0, end, OUTPUTS)))
    except SimulationError as problem:
        run, outcome = problem.run, f"stops: {problem}"
    assert case.pad is not None
    speed = _largest_speed(run) / case.pad.speed
    last = run.history.iloc[-1]
    return {
        "scheme": scheme,
        "norm": norm,
        "largest_speed": speed,
        "steps": int(run.provenance["steps"]),
        "rejected_steps": int(run.provenance["rejected_steps"]),
        "time": float(run.times[-1]),
        "removals": int(last["removals"]),
        "fluid_work": float(last["fluid_work"]),
        "outcome": outcome or (HOLDS if speed <= 1.0 else "accepts speeds beyond that of the pad"),
    }


def _largest_speed(run: Run) -> float:
    return float(np.linalg.norm(run.velocities, axis=2).max())
