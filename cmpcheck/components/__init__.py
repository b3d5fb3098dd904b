"""Checks of what no case reaches: equations that no kernel calls, setting up, random numbers, methods.

Each gives a row as the cases do, under the name `components`.  They cost a few seconds, and are part of every
`cmpcheck compare` without names of cases; those of the fast stepper's loop for many particles, which takes a
minute to compile, in the full profile only.
"""

from __future__ import annotations

import time
from collections.abc import Collection

from cmpcheck.components import equations, methods, runs, samples, setup, steppers
from cmpcheck.components.row import CASE, failed
from cmpcheck.results import CaseResult, Comparison

__all__ = ["CASE", "check_components", "component_result"]

PARTS = (equations.checks, setup.checks, runs.checks, steppers.checks, methods.checks, samples.checks)
FULL_PARTS = (steppers.checks_of_many,)  # of the full profile
ENGINES = ("reference", "lammps")


def check_components(
    changed: str = "",
    engines: Collection[str] = ENGINES,
    in_process: bool = False,
    profile: str = "quick",
) -> list[Comparison]:
    """Every row; a part that fails is one row with the status `error`.

    Parameters: changed, a file of the model: parts that do not depend on it are left out; engines, whose
    parts are checked; in_process, whether LAMMPS runs in this process, as in `LammpsEngine`; profile
    quick | full.
    """
    rows: list[Comparison] = []
    for part in (*PARTS, *(FULL_PARTS if profile == "full" else ())):
        if ("lammps" if part is samples.checks else "reference") not in engines:
            continue
        if part is methods.checks and changed.startswith("reference/") and changed not in methods.MODEL_FILES:
            continue
        try:
            rows += samples.checks(in_process) if part is samples.checks else part()
        except Exception as problem:  # the other parts go on
            rows.append(failed(part.__module__.rpartition(".")[2], problem))
    return rows


def component_result(engines: Collection[str] = ENGINES, profile: str = "quick") -> CaseResult:
    """All rows of the engines as a case of the report."""
    begin = time.perf_counter()
    rows = check_components(engines=engines, profile=profile)
    return CaseResult(
        name=CASE,
        title="Components",
        sentence="What no case reaches: single equations, setting up, random numbers, methods of search and "
        "of statistics, the fast stepper beside the plain one, and how trajectories are sampled.",
        equations="9, 20-22, 29, 32-36, 40-43",
        comparisons=rows,
        seconds=time.perf_counter() - begin,
    )
