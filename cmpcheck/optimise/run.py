"""A design run from beginning to end: search, methods, front, and the files that show what came out.

Options and exit codes are `command.py`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cmpcheck.display import duration, number
from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.front import find_front, front_table
from cmpcheck.optimise.methods import compare_methods, methods_table
from cmpcheck.optimise.problem import Problem, Sample
from cmpcheck.optimise.results import Design, collect, write_tables
from cmpcheck.optimise.search import MAIN, asked_before, search
from cmpcheck.optimise.store import Store
from cmpcheck.optimise.workers import Workers
from reference.genetic import GeneticAlgorithm

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


@dataclass(frozen=True)
class Plan:
    """What is asked for beside the search itself."""

    seeds: int = 0  # of the comparison of methods; 0 for none
    front: str = ""  # the second objective

    @classmethod
    def kept(cls, store: Store, seeds: int, front: str) -> Plan:
        """What is asked for now, or else was asked for when the run was started."""
        found = cls(seeds or int(store.recall("seeds") or 0), front or store.recall("front"))
        store.remember("seeds", str(found.seeds))
        store.remember("front", found.front)
        return found


class Watch:
    """What a person sees while samples run: a bar on a terminal, a line for each stage elsewhere."""

    def __init__(self, problem: Problem, store: Store, bars: Progress) -> None:
        self._problem, self._store, self._bars = problem, store, bars
        self._task: TaskID | None = None
        self._samples, self._stage = 0, ""

    def stage(self, text: str, samples: float, done: int = 0) -> None:
        """A stage begins, which takes about so many samples, of which some are there."""
        if self._task is not None:
            self._bars.remove_task(self._task)
        self._stage, self._samples = text, done
        self._task = self._bars.add_task(self._text(), total=max(samples, 1), completed=done)
        if self._bars.disable:
            typer.echo(f"cmpcheck: {self._text()}", err=True)

    def generation(self, ga: GeneticAlgorithm) -> None:
        """A generation of the search begins, or the last has ended."""
        part, asked = self._problem.settings, self._store.asked(MAIN)
        done = sum(one.found.samples for one in asked)
        each = done / len(asked) if asked else part.minimum_samples
        text = f"generation {min(ga.generation + 1, part.generations)}/{part.generations}"
        if ga.generation:
            text += f", best {self._problem.cost_name} {number(ga.best[1], 3)}"
        self.stage(text, each * asked_before(self._problem, part.generations), done)

    def sample(self, sample: Sample) -> None:
        """A sample has come in."""
        self._samples += 1
        if self._task is not None:
            self._bars.update(self._task, completed=self._samples, description=self._text())

    def _text(self) -> str:
        return f"{self._stage}, {self._samples} samples"


def run_design(
    problem: Problem,
    store: Store,
    workers: Workers,
    plan: Plan,
    bars: Progress,
    evaluator: Callable[..., Evaluator] = Evaluator,
) -> Design:
    """Run everything that the plan asks for, or go on with it.

    The files are written after the search, and again with what the plan asks for beside it.
    Raises WorkersError when the workers are gone for good.
    """
    watch, part = Watch(problem, store, bars), problem.settings
    evaluate = evaluator(problem, store, workers, watch.sample)
    search(problem, evaluate, watch.generation)
    watch.stage("distributions of Fig. 7", 2 * part.distribution_samples)
    design = collect(problem, evaluate)
    write_files(design, store.folder)
    if math.isinf(design.ranked[0].cost) or not (plan.seeds or plan.front):
        return design
    trials, front = [], None
    if plan.seeds:
        budget = sum(max(one.found.samples, 1) for one in design.asked)

        def on_trial(method: str, seed: int) -> None:
            watch.stage(f"{method}, seed {seed}", budget)

        trials = compare_methods(problem, evaluate, budget, plan.seeds, on_trial)
        text = methods_table(problem, trials).to_csv(index=False)
        (store.folder / "methods.csv").write_text(text, "utf-8", newline="\n")
    if plan.front:
        size = part.population * part.minimum_samples

        def on_generation(generation: int) -> None:
            watch.stage(f"NSGA-II, generation {generation}/{part.generations}", size)

        front = find_front(problem, evaluate, plan.front, on_generation)
        text = front_table(problem, front).to_csv(index=False)
        (store.folder / "front.csv").write_text(text, "utf-8", newline="\n")
    design = collect(problem, evaluate, trials, front)
    write_files(design, store.folder)
    return design


def write_files(design: Design, folder: Path) -> None:
    """Tables, figures and the page."""
    from cmpcheck.optimise import figures, page

    write_tables(design, folder)
    figures.write_figures(design, folder)
    (folder / "index.html").write_text(page.render(design), "utf-8", newline="\n")


def summary(design: Design) -> list[str]:
    """What a terminal shows at the end."""
    from cmpcheck.optimise import findings, page

    lines = [page.headline(design)]
    if math.isfinite(design.ranked[0].cost):
        lines += [findings.conclusion(design), findings.importance(design), findings.stopping(design)]
        lines += [findings.selection(design), findings.best_method(design.trials)]
    lines.append(
        f"{design.samples} samples, {duration(design.seconds)} of computing on all workers together."
    )
    return [line for line in lines if line]
