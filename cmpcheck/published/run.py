"""One benchmark from beginning to end: every material in both models, in every engine, at every level."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.published.benchmark import Benchmark, Material, load_benchmark
from cmpcheck.published.judge import (
    Series,
    convergences_of,
    cross_rows,
    failed_row,
    find_limits,
    rows_of,
)
from cmpcheck.published.measure import measure
from cmpcheck.published.run_lammps import run_lammps
from cmpcheck.published.run_liggghts import run_liggghts
from cmpcheck.published.scene import LEVELS, MODELS, build_scene, contact_of
from cmpcheck.published.show import charts_of, notes_of, tables_of, write_curves
from cmpcheck.results import CaseResult

RUNNERS = {"lammps": run_lammps, "liggghts": run_liggghts}
NO_RETURN = (
    "Not run: e = 0. No dashpot returns 0: e falls to 0 as the damping becomes critical, and then the sphere "
    "never leaves (LIGGGHTS refuses e <= 0.05)."
)


@dataclass(frozen=True)
class BenchmarkTask:
    """One benchmark to be run."""

    name: str
    engines: tuple[str, ...]  # that are there and were asked for
    profile: str
    folder: Path  # for data
    decks: dict[str, Path] = field(default_factory=dict)  # LAMMPS decks by benchmark, in place of ours

    kind: ClassVar[str] = "benchmarks"  # under which its result is kept
    cost: ClassVar[float] = 0.0  # see `variant_task.Task.cost`: little beside the cases

    @property
    def label(self) -> str:
        """What tells it from other tasks."""
        return self.name


def failed_benchmark(task: BenchmarkTask, problem: str) -> CaseResult:
    """What is said of a benchmark that failed as a whole: an error of each of its engines."""
    benchmark = load_benchmark(task.name)
    rows = [failed_row(benchmark, "", engine, problem) for engine in task.engines]
    return CaseResult(task.name, benchmark.title, benchmark.sentence, "", rows, lost=True)


def run_benchmark(task: BenchmarkTask) -> CaseResult:
    """Run and judge one benchmark; whatever an engine does, the other series go on."""
    begin = time.perf_counter()
    benchmark = load_benchmark(task.name)
    result = CaseResult(benchmark.name, benchmark.title, benchmark.sentence, "", notes=notes_of(benchmark))
    if len(_restitutions(benchmark)) < len(benchmark.sweep.values) and benchmark.sweep.kind == "restitution":
        result.notes.append(NO_RETURN)
    found: list[Series] = []
    for engine in task.engines:
        if engine not in RUNNERS:
            result.notes.append(f"Not run in {engine}: benchmarks have decks for {', '.join(RUNNERS)}.")
            continue
        for model in MODELS:
            for material in benchmark.material:
                for restitution in _restitutions(benchmark):
                    try:
                        series = run_series(task, benchmark, engine, material, model, restitution)
                    except (EngineError, ValueError) as problem:
                        variant = f"{model}, {material.name}"
                        result.comparisons.append(failed_row(benchmark, variant, engine, str(problem)))
                        continue
                    found.append(series)
                    result.comparisons += rows_of(benchmark, series)
                    result.convergences += convergences_of(benchmark, series)
    for series in found:
        for other in found:
            same = (series.material, series.contact.model) == (other.material, other.contact.model)
            if same and (series.engine, other.engine) == ("lammps", "liggghts"):
                result.comparisons += cross_rows(benchmark, series, other)
    if found:
        result.charts = charts_of(benchmark, found)
        result.tables = tables_of(benchmark, found)
        write_curves(benchmark, found, task.folder / benchmark.name / "curves.csv")
    result.seconds = time.perf_counter() - begin
    return result


def _restitutions(benchmark: Benchmark) -> list[float]:
    """Those that are run; 0 is no contact law's."""
    if benchmark.sweep.kind == "restitution":
        return [value for value in benchmark.sweep.values if value > 0.0]
    return [benchmark.restitution]


def run_series(
    task: BenchmarkTask, benchmark: Benchmark, engine: str, material: Material, model: str, restitution: float
) -> Series:
    """One material in one model and engine at every level.

    Raises EngineError when the engine fails, ValueError when what comes out cannot be measured.
    """
    own = engine == "lammps" and benchmark.name in task.decks
    path = (
        task.decks[benchmark.name] if own else deck_path(benchmark.name, "" if engine == "lammps" else engine)
    )
    deck = Deck.read(path)
    contact = contact_of(benchmark, material, model, restitution)
    scenes = [build_scene(benchmark, material, contact, level) for level in range(LEVELS[task.profile])]
    measured = [measure(benchmark, scene, RUNNERS[engine](deck, scene)) for scene in scenes]
    steps = tuple(scene.time_step for scene in scenes)
    return Series(engine, material, contact, find_limits(scenes, measured), steps, tuple(measured))
