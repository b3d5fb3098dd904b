"""Cases x engines -> results: which tasks are run, in how many processes, and what becomes of failures.

A task is one variant of one case in every engine (`variant_task.py`), one benchmark of the field, or the
components.  A task that fails becomes rows with the status `error`; the others go on.  Which cases may be
compared is `suite_cases.py`; what a report holds beside comparisons is `suite_parts.py`.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from cmpcheck import provenance
from cmpcheck.departures import apply_departures
from cmpcheck.engines import engine_names, make_engine
from cmpcheck.finished import Finished
from cmpcheck.places import contact_places
from cmpcheck.pool import problem_of, run_tasks
from cmpcheck.published import benchmark_names, load_benchmark
from cmpcheck.published.run import BenchmarkTask, failed_benchmark, run_benchmark
from cmpcheck.records import settled
from cmpcheck.results import CaseResult, Comparison, EngineInfo, Outcome, SuiteResult
from cmpcheck.suite_cases import check_case, check_decks, is_ensemble
from cmpcheck.suite_parts import (
    ComponentTask,
    Progress,
    deck_digests,
    failed_components,
    find_illustrations,
    find_studies,
)
from cmpcheck.trajectories import ENGINE as TRAJECTORY
from cmpcheck.trajectories import Trajectories
from cmpcheck.variant_task import ENSEMBLE_FORMS, Task, failed_variant, run_task
from reference.case import Case, CaseError, load_case

Work = Task | BenchmarkTask | ComponentTask


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
    for case in loaded:
        check_case(case, others, files)
    check_decks(loaded, decks or {}, others)
    tasks = [
        Task(case, k, others, profile, folder / "data", decks or {}, form, files, engines is not None)
        for case in loaded
        for k, variant in enumerate(case.variants())
        for form in (ENSEMBLE_FORMS if is_ensemble(variant) else ("",))
    ]
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
        return failed_variant(task, reason)
    return failed_benchmark(task, reason) if isinstance(task, BenchmarkTask) else failed_components(reason)
