"""Which studies there are, and running them; what a study finds is its own file's.

A study is a function `(profile: str, runs: Path) -> StudyResult` at the top level of a file of its own, so
that a worker process can import it.  It gets

- profile, "quick" or "full": how many samples it takes.  Its numbers of samples are constants of its file;
- runs, a folder that outlives the report, for run folders too dear to lose; most studies need none.

It runs its samples one after the other through `reference.ensemble.run_samples`, and returns a record of
plain numbers: no page, no file, no clock.  Studies run side by side, one process each, so a study finds the
same for any number of workers.  What it raises becomes a result with `error` set; the others go on.

A table that exists as a data frame becomes one of its tables by `tables.frame_table`.
To add one: write `cmpcheck/studies/NAME.py` with a function `study`, and enter it in `STUDIES`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cmpcheck.pool import problem_of, run_tasks
from cmpcheck.results import StudyResult
from cmpcheck.studies import (
    acceleration,
    fine_abrasive,
    particle_speed,
    polish_full,
    preston,
    remeshing,
    spacing,
    stepper,
    threshold,
    time_step,
    wear,
)

StudyFunction = Callable[[str, Path], StudyResult]
STUDIES: dict[str, StudyFunction] = {  # as they stand in the report
    "preston": preston.study,
    "particle_speed": particle_speed.study,
    "time_step": time_step.study,
    "spacing": spacing.study,
    "acceleration": acceleration.study,
    "threshold": threshold.study,
    "fine_abrasive": fine_abrasive.study,
    "stepper": stepper.study,
    "wear": wear.study,
    "remeshing": remeshing.study,
    "polish_full": polish_full.study,
}
LONGEST_FIRST = (
    "polish_full",
    "remeshing",
    "time_step",
    "particle_speed",
)  # begun in this order, before the others


@dataclass(frozen=True)
class StudyTask:
    """One study to be run."""

    name: str
    profile: str
    runs: Path


def run_studies(
    names: Sequence[str],
    profile: str,
    runs: Path,
    jobs: int,
    done: Callable[[StudyResult], None] | None = None,
) -> list[StudyResult]:
    """What these studies found, in the registry's order.

    Parameters: profile quick | full; runs, the folder of run folders that outlive the report; jobs,
    processes; done, called with each study's result as it comes.
    """
    order = dict.fromkeys((*LONGEST_FIRST, *STUDIES))
    tasks = [StudyTask(name, profile, runs) for name in order if name in names]
    results = {}
    for task, future in run_tasks(run_study, tasks, jobs):
        problem = problem_of(future)
        results[task.name] = failed(task.name, problem) if problem else future.result()
        if done is not None:
            done(results[task.name])
    return [results[name] for name in STUDIES if name in results]


def run_study(task: StudyTask) -> StudyResult:
    """Run one study here and say how long it took."""
    begin = time.perf_counter()
    result = STUDIES[task.name](task.profile, task.runs)
    return replace(result, seconds=time.perf_counter() - begin)


def failed(name: str, reason: str) -> StudyResult:
    """The entry of a study that could not be finished."""
    return StudyResult(name, name.replace("_", " "), "", "", (), "", error=reason)
