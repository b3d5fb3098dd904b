"""The paper's example without acceleration, a whole second: the shape of Pi(t) against Fig. 6, and its cost.

One run of a quarter of an hour.  It lies in the folder `polish_full` of the runs that outlive the report,
where `cmpcheck run polish_full` puts it, and is read from there when it is whole.
"""

from __future__ import annotations

import math
from contextlib import suppress
from pathlib import Path

from cmpcheck.display import duration, number
from cmpcheck.results import Chart, Column, Curve, StudyResult, Table
from cmpcheck.studies.shape import shape_of
from reference import simulate
from reference.case import Case, CaseError, load_case
from reference.recording import Run, version_of_code

CASE = "polish_full"
PARTS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # t/T in the table


def study(profile: str, runs: Path) -> StudyResult:
    """The shape of flatness over a whole second, wall time, and particle-steps per second.

    Raises ValueError in the quick profile where the run is not there yet.
    """
    (case,) = load_case(CASE).variants()
    run = the_run(case, runs / CASE, profile == "full")
    history, particles = run.history, len(run.diameters)
    steps = int(run.provenance["steps"])
    seconds = float(run.provenance.get("timing", {}).get("wall_time", math.nan))
    shape = shape_of(history.time, history.flatness)
    table = []
    for part in PARTS:
        row = history.iloc[round(part * (len(history) - 1))]
        table.append(
            (row.time, row.flatness, row.pad_height, row.removals, row.removed_volume, row.mean_velocity_x)
        )
    work = steps * particles
    cost = f"{number(steps, 3)} steps of {particles} particles"
    if math.isfinite(seconds):
        cost += (
            f" took {duration(seconds)}, {number(work / seconds / 1e6, 3)} million particle-steps per second"
        )
    return StudyResult(
        name=CASE,
        title="The paper's example, a whole second",
        varied="Nothing: Fig. 6 of the paper, one sample at A = 1.",
        samples=f"The case {CASE} itself, seed {case.case.seed}; {cost}.",
        tables=(
            Table(
                "Polishing without acceleration",
                (Column("t", "s"), Column("Π"), Column("pad height", "m"), Column("removals"),
                 Column("removed volume", "m3"), Column("mean v_x", "m/s")),
                tuple(tuple(map(float, row)) for row in table),
            ),
        ),
        sentence=shape.words("s"),
        charts=(
            Chart(
                "Flatness over a whole second at A = 1, as in Fig. 6", Column("t", "s"), Column("Π"),
                (Curve("Π", tuple(history.time), tuple(history.flatness)),),
            ),
        ),
    )  # fmt: skip


def the_run(case: Case, folder: Path, may_run: bool) -> Run:
    """The run of the case in `folder`, by the reference as it is now; simulated if it is not there yet.

    A run that was killed goes on; one of another case, engine or version of the code is replaced.
    Raises ValueError where it is not there and may not be run.
    """
    try:
        run = Run.open(folder)  # its ledger, of a gigabyte, is not needed
    except CaseError:
        run = None
    whole = run is not None and run.provenance.get("complete") is True
    if run is not None and whole and _is_of(run, case):
        return run
    if not may_run:
        raise ValueError(
            f"no complete run of {case.name} by this version in {folder}; made by --profile full, or by: "
            f"cmpcheck run {case.name}"
        )
    if not whole:
        with suppress(CaseError):  # of a checkpoint that another case or version left, or a damaged one
            return simulate(case, out=folder, resume=True)
    return simulate(case, out=folder)


def _is_of(run: Run, case: Case) -> bool:
    """Whether the reference, as it is now, made this run of the case."""
    made_by = (run.provenance.get("engine"), run.provenance.get("code"))
    return run.case == case and made_by == ("reference", version_of_code())
