"""What is done with one variant of a case: it is run in every engine, judged, compared, and kept.

An engine that fails becomes a row with the status `error`; the others go on.  Which variants there are is
`suite_cases.py`; how tasks run side by side is `suite.py`.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from cmpcheck.compare import compare_study, convergences, limits
from cmpcheck.engines import make_engine
from cmpcheck.engines.protocol import Engine, NotSupported
from cmpcheck.horizon import compare_ledgers, study_horizon
from cmpcheck.judges import judge_of
from cmpcheck.judges.protocol import observes_contacts
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.results import Comparison, Outcome
from cmpcheck.study import (
    Study,
    align_outputs,
    contact_forms,
    contact_settings,
    engine_study,
    has_settings,
    reference_study,
    unobserved,
)
from cmpcheck.suite_cases import is_ensemble
from cmpcheck.trajectories import ENGINE as TRAJECTORY
from cmpcheck.trajectories import Trajectories, compare_file
from reference.case import Case
from reference.process import build_setup

REFERENCE_TRACES = ("exact", "reference")
ENSEMBLE_FORMS = ("impulse", "soft")  # of the contacts with surface and pad
NO_TABLE = "the case has no [engine.{0}] with contact_duration and steps_per_contact"


@dataclass(frozen=True)
class Task:
    """One variant of one case, in the reference and other engines."""

    case: Case
    variant: int  # index among the case's variants
    engines: tuple[str, ...]
    profile: str
    folder: Path  # for run folders
    decks: dict[str, Path]
    form: str = ""  # of ensembles: one of ENSEMBLE_FORMS, a task each
    trajectories: Trajectories = field(default_factory=Trajectories)
    asked: bool = False  # the engines were asked for by name

    kind: ClassVar[str] = "tasks"  # under which its result is kept

    @property
    def name(self) -> str:
        """Name of the case."""
        return self.case.name

    @property
    def label(self) -> str:
        """Case, variant and form: what tells it from other tasks."""
        return "/".join((self.case.name, self.case.variants()[self.variant].variant, self.form))

    @property
    def cost(self) -> float:
        """Rough measure of the work, to begin with the longest: what the engines visit in all their steps.

        That is the particles of all copies, and for LIGGGHTS the triangles of the surface with them.
        """
        variant = self.case.variants()[self.variant]
        if self.form:
            return math.inf
        setup = build_setup(variant)
        judge = judge_of(setup)
        particles, nodes = len(setup.state.mass), setup.state.heights.size
        found = particles * setup.end_time / setup.time_step
        for name in self.engines:
            if has_settings(variant, name):
                duration, steps = contact_settings(variant, name)
                triangles = 2 * nodes if name == "liggghts" and judge.has_surface_contact else 0
                found += judge.copies * (particles + triangles) * setup.end_time / duration * steps
        return found


def run_task(task: Task) -> Outcome:
    """Run and compare one variant in every engine; the run folders of the finest levels are kept."""
    begin = time.perf_counter()
    case, outcome = task.case.variants()[task.variant], Outcome()
    if is_ensemble(case):
        _run_ensembles(task, case, outcome)
        outcome.seconds = time.perf_counter() - begin
        return outcome
    setup = align_outputs(build_setup(case))
    judge = judge_of(setup)
    engine: Engine = make_engine("reference")
    try:
        ours = reference_study(engine, judge, setup, task.profile)
    except RuntimeError as problem:
        outcome.comparisons.append(_failed(task, "reference", str(problem)))
        return outcome
    swarm = isinstance(judge, SwarmJudge)
    horizon = study_horizon(engine, ours) if swarm else None
    outcome.comparisons += compare_study(case, ours, None)
    finest = ours.finest
    for name in REFERENCE_TRACES:
        outcome.traces += judge.traces(finest.setup, finest.run, name)
    outcome.notes += setup.notes
    _keep(task, ours)
    for name in task.engines:
        if not has_settings(case, name):
            _leave_out(task, name, outcome)
            continue
        other = make_engine(name, task.decks)
        for form in contact_forms(other, judge, case):
            try:
                theirs = engine_study(other, judge, setup, task.profile, form)
                if horizon is not None and observes_contacts(theirs.finest.run):
                    ledgers = compare_ledgers(case, (ours, horizon), (theirs, study_horizon(other, theirs)))
                    outcome.comparisons.append(ledgers[0])
                    outcome.notes.append(ledgers[1])
            except Exception as problem:  # whatever an engine does, the other comparisons go on
                status = "not_tested" if isinstance(problem, NotSupported) else "error"
                outcome.comparisons.append(_failed(task, name, f"{form}: {problem}", status))
                continue
            outcome.comparisons += compare_study(case, theirs, limits(ours))
            outcome.notes += unobserved(theirs, ours)
            outcome.traces += (
                judge.traces(theirs.finest.setup, theirs.finest.run, name) if form != "impulse" else []
            )
            outcome.convergences += convergences(case, theirs, limits(theirs))
            _keep(task, theirs)
    _compare_trajectory(task, case, outcome)
    outcome.convergences += convergences(case, ours, limits(ours))
    outcome.seconds = time.perf_counter() - begin
    return outcome


def _compare_trajectory(task: Task, case: Case, outcome: Outcome) -> None:
    """Compare the trajectory that the user has given for this variant, if any."""
    path = task.trajectories.of(case)
    if path is None:
        return
    try:
        rows, traces, notes, run = compare_file(case, build_setup(case), path, task.trajectories.options)
    except Exception as problem:  # the other comparisons are made
        outcome.comparisons.append(_failed(task, TRAJECTORY, f"{path.name}: {problem}"))
        return
    told = {row.quantity for row in outcome.comparisons if row.engine == "reference"}
    untold = sorted(told - {row.quantity for row in rows})
    outcome.comparisons += rows
    outcome.traces += traces
    outcome.notes += notes
    if untold:
        outcome.notes.append(f"{path.name} is a trajectory, which does not tell {', '.join(untold)}.")
    run.save(task.folder / case.name / case.variant / TRAJECTORY)


def _leave_out(task: Task, engine: str, outcome: Outcome) -> None:
    """Say that a case does not tell how to resolve it; a row only for an engine that was asked for."""
    reason = NO_TABLE.format(engine)
    if task.asked:
        outcome.comparisons.append(_failed(task, engine, reason, "not_tested"))
    else:
        outcome.notes.append(f"Not compared with {engine}: {reason}.")


def _run_ensembles(task: Task, case: Case, outcome: Outcome) -> None:
    """Compare samples of a polishing case, whose trajectories part too early to be compared, in one form."""
    from cmpcheck.ensembles import compare_ensembles
    from cmpcheck.soft_study import compare_soft

    for name in task.engines:
        if name not in case.engine:
            if task.form == ENSEMBLE_FORMS[0]:
                _leave_out(task, name, outcome)
            continue
        engines = make_engine("reference"), make_engine(name, task.decks)
        folder = task.folder / case.name / case.variant
        try:
            if task.form == "soft":
                rows, records, notes = compare_soft(case, engines, task.profile)
                outcome.convergences += records
                outcome.notes += notes
            else:
                rows, ensemble = compare_ensembles(case, engines, task.profile, task.form, folder)
                outcome.ensembles.append(ensemble)
        except Exception as problem:  # whatever an engine does, the other comparisons go on
            outcome.comparisons.append(_failed(task, name, f"{task.form}: {problem}"))
            continue
        outcome.comparisons += rows


def _keep(task: Task, study: Study) -> None:
    """Save the run of the finest level."""
    case = study.finest.setup.case
    name = "-".join(part for part in (study.engine, study.form) if part)
    study.finest.run.save(task.folder / case.name / case.variant / name)


def failed_variant(task: Task, reason: str) -> Outcome:
    """What is said of a task whose process failed: an error of each of its engines."""
    return Outcome([_failed(task, name, reason) for name in task.engines or ("reference",)], lost=True)


def _failed(task: Task, engine: str, reason: str, status: str = "error") -> Comparison:
    case = task.case.variants()[task.variant]
    nan = float("nan")
    return Comparison(
        case.name, case.variant, engine, "run", "", "1", nan, nan, nan, nan, "precision", reason, status
    )
