"""Cases x engines -> results: which studies are run, in how many processes, and what becomes of failures.

A task is one variant of one case in every engine, one benchmark of the field, or the components.  A task that
fails becomes rows with the status `error`; the others go on.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from cmpcheck import provenance
from cmpcheck.compare import compare_study, convergences, limits
from cmpcheck.departures import apply_departures
from cmpcheck.engines import engine_names, make_engine
from cmpcheck.engines.child import Child, ChildError, ChildLost
from cmpcheck.engines.lammps_contract import check_deck
from cmpcheck.engines.protocol import Engine, NotSupported, Resolution, timeout_of
from cmpcheck.finished import Finished
from cmpcheck.horizon import compare_ledgers, study_horizon
from cmpcheck.judges import judge_of
from cmpcheck.judges.protocol import observes_contacts
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.places import contact_places
from cmpcheck.pool import problem_of, run_tasks
from cmpcheck.published import benchmark_names, load_benchmark
from cmpcheck.published.run import RUNNERS, BenchmarkTask, failed_benchmark, run_benchmark
from cmpcheck.records import settled
from cmpcheck.results import CaseResult, Comparison, EngineInfo, Outcome, SuiteResult
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
from cmpcheck.suite_parts import (
    ComponentTask,
    Progress,
    deck_digests,
    failed_components,
    find_illustrations,
    find_studies,
)
from cmpcheck.trajectories import ENGINE as TRAJECTORY
from cmpcheck.trajectories import Trajectories, compare_file
from reference.case import Case, CaseError, available_cases, load_case
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


Work = Task | BenchmarkTask | ComponentTask


def comparable_cases(profile: str, engines: Sequence[str] = ()) -> list[str]:
    """The cases that ship and say, by an `[engine.NAME]` table, how another engine resolves them.

    With `engines`, those that say so for one of them.  Ensembles, whose verdict needs minutes of samples, are
    compared by default in the full profile only.  Benchmarks of the field, which engines alone run, follow.
    """
    others = set(engines) - {"reference"}
    cases = [load_case(name) for name in available_cases()]
    names = [
        case.name
        for case in cases
        if case.engine
        and (not others or any(has_settings(case, name) for name in others))
        and (profile == "full" or not is_ensemble(case))
    ]
    return names + (benchmark_names() if not engines or others & set(RUNNERS) else [])


def variants_by_case(names: Sequence[str]) -> dict[str, list[str]]:
    """Each case's own name and its variants, a benchmark being one.  Raises CaseError for what is no case."""
    found = {}
    for name in names:
        if name in benchmark_names():
            found[name] = [""]
        else:
            case = load_case(name)
            found[case.name] = [variant.variant for variant in case.variants()]
    return found


def is_ensemble(case: Case) -> bool:
    """Whether trajectories of a case part too early to be compared: many particles wear a surface."""
    alone = len(case.particle) == 1 and case.removal is None and case.fluid is None
    return (case.pad is not None and not alone) or (
        case.particles is not None and case.surface.kind != "none"
    )


def run_suite(
    cases: list[str],
    engines: list[str] | None,
    profile: str,
    folder: Path,
    jobs: int,
    decks: dict[str, Path] | None = None,
    progress: Progress | None = None,
    studies: Sequence[str] = (),
    runs: Path = Path("runs"),
    trajectories: Trajectories | None = None,
    components: bool = False,
    finished: Finished | None = None,
) -> SuiteResult:
    """Run every variant of the cases in every engine and compare; then the studies.

    Parameters: names or files of cases; names of engines, or None for all that are there; profile
    quick | full; the folder that gets data/; number of processes; LAMMPS decks by case; a callback for
    progress; names of studies, and the folder for runs of theirs that outlive the report; trajectories of
    other codes; whether to check the components too, as a last case; where results are kept as they come,
    and those that are there already are taken from.
    Raises CaseError for a case that cannot be set up or compared, before anything is run.
    """
    begin = time.perf_counter()
    published = [name for name in cases if name in benchmark_names()]
    loaded = [load_case(name) for name in cases if name not in published]
    for name, count in Counter(case.name for case in loaded).items():
        if count > 1:
            raise CaseError(f"{name}: {count} files with this case.name; allowed: a name of its own for each")
    infos = [
        make_engine(name).info()
        for name in engine_names()
        if engines is None or name in ("reference", *engines)
    ]
    files = trajectories or Trajectories()
    for name, _ in files.files:
        if name in published:
            raise CaseError(f"{name}: a sweep of impacts, which one trajectory does not hold")
    others = tuple(info.name for info in infos if info.available and info.name != "reference")
    tasks = []
    for case in loaded:
        for k, variant in enumerate(case.variants()):
            setup = build_setup(variant)
            if is_ensemble(variant) and files.of(variant):
                raise CaseError(
                    f"{case.name}: ensembles of samples are compared; one trajectory says nothing"
                )
            if not is_ensemble(variant):
                judge_of(setup)
                files.check(setup)
            elif not variant.engine:
                raise CaseError(f"{case.name}: nothing to compare with: the case has no [engine.NAME] table")
            for name in others:
                if has_settings(variant, name):
                    _check_settings(variant, name)
                    timeout_of(variant, name)
            tasks += [
                Task(case, k, others, profile, folder / "data", decks or {}, form, files, engines is not None)
                for form in (ENSEMBLE_FORMS if is_ensemble(variant) else ("",))
            ]
    _check_decks(loaded, decks or {}, others)
    benchmarks = [BenchmarkTask(name, others, profile, folder / "data", decks or {}) for name in published]
    rest: list[BenchmarkTask | ComponentTask] = [*benchmarks]
    rest += [ComponentTask(("reference", *others), profile)] if components else []
    keys = [(task.case.name, task.variant, task.form) for task in tasks]
    totals = Counter([name for name, _, _ in keys] + [task.name for task in rest])
    done: Counter[str] = Counter()
    outcomes: dict[tuple[str, int, str], Outcome] = {}
    whole: dict[str, CaseResult] = {}  # what is one task
    kept = finished or Finished()
    for task, found in _outcomes([*tasks, *rest], jobs, kept):
        if isinstance(task, Task):
            outcomes[task.case.name, task.variant, task.form] = found
        else:
            whole[task.name] = found
        done[task.name] += 1
        if progress is not None:
            progress(task.name, done[task.name], totals[task.name])
    results = [_case_result(case, [outcomes[key] for key in keys if key[0] == case.name]) for case in loaded]
    results += [whole[task.name] for task in rest]
    versions = {info.name: info.version for info in infos if info.available}
    if files.files:
        names = ", ".join(path.name for path in files.files.values())
        infos.append(EngineInfo(TRAJECTORY, names, True))
    for found in results:
        found.comparisons = apply_departures(found.comparisons, versions)
        found.tables += contact_places(found.comparisons) if found.name not in published else []
    origin = provenance.collect(loaded) | {"decks": deck_digests(loaded, published, others, decks or {})}
    if published:
        origin["benchmarks"] = {name: {"digest": load_benchmark(name).digest} for name in published}
    result = SuiteResult(profile, infos, results, origin)
    try:
        result.illustrations = find_illustrations(loaded, profile, folder / "data", jobs, kept)
    except Exception as problem:  # pictures must not cost the comparisons
        results[0].notes.append(f"The paper's figures could not be drawn: {problem}")
    result.studies = find_studies(studies, profile, folder, runs, jobs, kept, progress)
    result.seconds = time.perf_counter() - begin
    return result


def _outcomes(tasks: list[Work], jobs: int, kept: Finished) -> Iterator[tuple[Work, Any]]:
    """What is kept, then the others as they come: Outcomes of variants, CaseResults of what is one task."""
    left = []
    for task in tasks:
        found = kept.get(task.kind, task.label)
        if found is None:
            left.append(task)
        else:
            yield task, found
    for task, found in _in_processes(left, jobs):
        if not found.lost:
            kept.put(task.kind, task.label, found)
        yield task, settled(found)


def _check_settings(variant: Case, engine: str) -> None:
    """Refuse a case whose `[engine.NAME]` table lacks what the comparison needs.  Raises CaseError."""
    if is_ensemble(variant):
        from cmpcheck.ensembles import check_settings

        check_settings(variant, engine)
    else:
        contact_settings(variant, engine)


def _check_decks(cases: list[Case], decks: dict[str, Path], engines: tuple[str, ...]) -> None:
    """Refuse a user's deck that lacks what the engine needs; LAMMPS reads it in a process of its own.

    Raises CaseError naming all of it.
    """
    tasks = [(case, decks[case.name]) for case in cases if case.name in decks and "lammps" in engines]
    if not tasks:
        return
    child = Child()
    try:
        for case, path in tasks:
            limit = timeout_of(case.variants()[0], "lammps")
            try:
                child.call(_check_deck, (case, path), timeout=limit)
            except ChildLost as problem:
                raise CaseError(f"{path}: cannot be checked: {problem}") from None
            except ChildError as problem:
                raise CaseError(str(problem)) from None
    finally:
        child.stop()


def _check_deck(task: tuple[Case, Path]) -> None:
    case, path = task
    variant = case.variants()[0]
    duration, steps = contact_settings(variant, "lammps")
    check_deck(path, build_setup(variant), Resolution(duration / steps, duration))


def _case_result(case: Case, outcomes: list[Outcome]) -> CaseResult:
    rows = [row for outcome in outcomes for row in outcome.comparisons]
    return CaseResult(
        name=case.name,
        title=case.case.title,
        sentence=case.case.description,
        equations=_equations(rows),
        comparisons=rows,
        convergences=[record for outcome in outcomes for record in outcome.convergences],
        traces=[trace for outcome in outcomes for trace in outcome.traces],
        notes=list(dict.fromkeys(note for outcome in outcomes for note in outcome.notes)),
        seconds=sum(outcome.seconds for outcome in outcomes),
        ensembles=[record for outcome in outcomes for record in outcome.ensembles],
    )


def _equations(rows: list[Comparison]) -> str:
    """Every equation that the rows name, in the paper's order."""
    parts = {part for row in rows for part in row.equations.split(", ") if part}
    return ", ".join(sorted(parts, key=lambda part: [int(number) for number in part.split("-")]))


def _in_processes(tasks: Sequence[Work], jobs: int) -> Iterator[tuple[Work, Any]]:
    """What they find, as it comes."""
    for task, future in run_tasks(run_work, sorted(tasks, key=lambda task: -task.cost), jobs):
        yield task, _found(task, future)


def run_work(task: Work) -> Outcome | CaseResult:
    """Run one task of whatever kind."""
    if isinstance(task, Task):
        return run_task(task)
    if isinstance(task, BenchmarkTask):
        return run_benchmark(task)
    from cmpcheck.components import component_result

    return component_result(task.engines, task.profile)


def _found(task: Work, future: Future) -> Outcome | CaseResult:
    """What a task found; one that failed as a whole is an error of each of its engines."""
    reason = problem_of(future)
    if not reason:
        found: Outcome | CaseResult = future.result()
        return found
    if isinstance(task, Task):
        return Outcome([_failed(task, name, reason) for name in task.engines or ("reference",)], lost=True)
    return failed_benchmark(task, reason) if isinstance(task, BenchmarkTask) else failed_components(reason)


def _failed(task: Task, engine: str, reason: str, status: str = "error") -> Comparison:
    case = task.case.variants()[task.variant]
    nan = float("nan")
    return Comparison(
        case.name, case.variant, engine, "run", "", "1", nan, nan, nan, nan, "precision", reason, status
    )


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
