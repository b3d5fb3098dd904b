"""What a report holds beside comparisons: figures, studies, digests of decks.

Each part is found, or taken from what an unfinished comparison has kept.  What a part needs is imported with
it, for the processes that run cases import this file too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.finished import Finished
from cmpcheck.published.run import RUNNERS
from cmpcheck.records import settled
from cmpcheck.results import COMPONENTS, CaseResult, Illustration, StudyResult
from reference.case import Case

Progress = Callable[[str, int, int], None]  # case or study, tasks done, tasks in all


@dataclass(frozen=True)
class ComponentTask:
    """The components, to be checked."""

    engines: tuple[str, ...]
    profile: str

    kind: ClassVar[str] = COMPONENTS  # under which its result is kept
    name: ClassVar[str] = COMPONENTS
    cost: ClassVar[float] = 0.0  # see `variant_task.Task.cost`: little
    label: ClassVar[str] = COMPONENTS


def failed_components(problem: str) -> CaseResult:
    """What is said of the components when the process that checked them died."""
    from cmpcheck.components.row import failed

    rows = [failed("", RuntimeError(problem))]
    return CaseResult(COMPONENTS, "Components", "", "", rows, lost=True)


def find_illustrations(
    cases: list[Case], profile: str, folder: Path, jobs: int, kept: Finished
) -> list[Illustration]:
    """The paper's figures, from what is kept where they are.  Raises CaseError or SimulationError."""
    found = kept.get("illustrations", "all")
    if found is None:
        from cmpcheck.figures.report import report_illustrations

        found = report_illustrations(cases, profile, folder, jobs)
        kept.put("illustrations", "all", found)
    return list(found)


def find_studies(
    names: Sequence[str], profile: str, folder: Path, runs: Path, jobs: int, kept: Finished,
    progress: Progress | None,
) -> list[StudyResult]:  # fmt: skip
    """Every study in the registry's order, from what is kept where it is."""
    if not names:
        return []
    from cmpcheck.studies.registry import STUDIES, run_studies
    from cmpcheck.studies.tables import write_csv

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
