"""What a report holds beside the comparisons of cases: benchmarks, figures, studies, digests of decks.

Each part is found, or taken from what an unfinished comparison has kept.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.figures.report import report_illustrations
from cmpcheck.finished import Finished
from cmpcheck.published.run import RUNNERS, BenchmarkTask, run_benchmarks
from cmpcheck.records import settled
from cmpcheck.results import CaseResult, Illustration, StudyResult
from cmpcheck.studies.registry import STUDIES, run_studies
from cmpcheck.studies.tables import write_csv
from reference.case import Case

Progress = Callable[[str, int, int], None]  # case or study, tasks done, tasks in all


def find_benchmarks(
    tasks: list[BenchmarkTask], jobs: int, kept: Finished, told: Callable[[str], None] | None
) -> list[CaseResult]:
    """Every benchmark in order, from what is kept where it is."""
    found = {task.name: kept.get("benchmarks", task.name) for task in tasks}

    def done(result: CaseResult, lost: bool) -> None:
        if not lost:
            kept.put("benchmarks", result.name, result)
        if told is not None:
            told(result.name)

    new = run_benchmarks([task for task in tasks if found[task.name] is None], jobs, done)
    if told is not None:
        for name, result in found.items():
            if result is not None:
                told(name)
    found |= {result.name: result for result in new}
    return list(found.values())


def find_illustrations(
    cases: list[Case], profile: str, folder: Path, jobs: int, kept: Finished
) -> list[Illustration]:
    """The paper's figures, from what is kept where they are.  Raises CaseError or SimulationError."""
    found = kept.get("illustrations", "all")
    if found is None:
        found = report_illustrations(cases, profile, folder, jobs)
        kept.put("illustrations", "all", found)
    return list(found)


def find_studies(
    names: Sequence[str], profile: str, folder: Path, runs: Path, jobs: int, kept: Finished,
    progress: Progress | None,
) -> list[StudyResult]:  # fmt: skip
    """Every study in the registry's order, from what is kept where it is."""

    def keep(study: StudyResult) -> None:
        if not study.error:
            kept.put("studies", study.name, study)
        write_csv([study], folder / "data" / "studies")
        if progress is not None:
            progress(study.name, 1, 1)

    found = {name: kept.get("studies", name) for name in names}
    for study in found.values():
        if study is not None:
            keep(study)
    new = run_studies([name for name in names if found[name] is None], profile, runs, jobs, keep)
    found |= {study.name: study for study in new}
    return [settled(found[name]) for name in STUDIES if name in found]


def deck_digests(
    cases: list[Case], benchmarks: list[str], engines: tuple[str, ...], decks: dict[str, Path]
) -> dict[str, dict[str, str]]:
    """SHA-256 of the deck of each case that an engine reads one for."""
    found: dict[str, dict[str, str]] = {}
    for name in (*(case.name for case in cases if case.engine), *benchmarks):
        for engine in set(engines) & set(RUNNERS):
            with suppress(EngineError):  # the case has none
                own = decks.get(name) if engine == "lammps" else None
                path = own or deck_path(name, "" if engine == "lammps" else engine)
                found.setdefault(name, {})[engine] = Deck.read(path).digest
    return {name: dict(sorted(digests.items())) for name, digests in sorted(found.items())}
