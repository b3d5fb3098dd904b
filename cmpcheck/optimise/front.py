"""Two objectives at once: flatness against removal rate or abrasive mass, by pymoo's NSGA-II.

The weighted sum of the three is the cost of `problem.py`; here no weights are needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.methods import HUGE, run_pymoo, strings_at
from cmpcheck.optimise.problem import Problem, Sample, String, paper_columns
from cmpcheck.optimise.search import search_rng
from cmpcheck.optimise.store import Evaluated

SECOND = {"removal_rate": -1.0, "abrasive_mass": 1.0}  # the other objective, and its sign when minimised


@dataclass(frozen=True)
class Front:
    """The strings that were tried, with the means of their samples, and which of them are on the front."""

    second: str
    strings: list[String]
    means: list[Sample]
    on_front: np.ndarray  # (m,) bool


def find_front(
    problem: Problem, evaluator: Evaluator, second: str, on_generation: Callable[[int], None] = lambda n: None
) -> Front:
    """Flatness and a second objective by NSGA-II, with the population and generations of the case.

    `second` is a key of SECOND.  Strings that cannot be run are left out.
    """
    from pymoo.algorithms.moo.nsga2 import NSGA2

    part, run = problem.settings, f"front, {second}"
    asked: list[Evaluated] = []
    generation = 0

    def values(unit: np.ndarray) -> np.ndarray:
        nonlocal generation
        generation += 1
        on_generation(generation)
        strings = strings_at(problem, unit)
        found = evaluator.costs(strings, run, len(asked), generation, ["NSGA-II"] * len(strings))
        asked.extend(found)
        return np.array([_objectives(evaluator, one, second) for one in found])

    algorithm = NSGA2(pop_size=part.population)
    run_pymoo(algorithm, values, (len(problem.keys), 2), search_rng(problem).spawn(2)[1], part.generations)
    unique = {one.string: one for one in asked if math.isfinite(one.cost)}
    means = [evaluator.means(one) for one in unique.values()]
    points = np.array([_objectives(evaluator, one, second) for one in unique.values()]).reshape(-1, 2)
    return Front(second, list(unique), means, not_dominated(points))


def not_dominated(points: np.ndarray) -> np.ndarray:
    """Which of the points (m, n) no other one is at least as good as in all columns and better in one.

    >>> not_dominated(np.array([[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])).tolist()
    [True, True, False]
    """
    as_good = (points[:, np.newaxis] <= points).all(axis=2)  # [i, j]: i is at least as good as j
    better = (points[:, np.newaxis] < points).any(axis=2)
    return np.logical_not((as_good & better).any(axis=0))


def front_table(problem: Problem, front: Front) -> pd.DataFrame:
    """The strings on the front, flattest first."""
    rows = [
        paper_columns(problem, string)
        | {"flatness": mean.flatness, "removal_rate": mean.removal_rate, "abrasive_mass": mean.abrasive_mass}
        for string, mean, on_it in zip(front.strings, front.means, front.on_front, strict=True)
        if on_it
    ]
    return pd.DataFrame(rows).sort_values("flatness", kind="stable") if rows else pd.DataFrame()


def _objectives(evaluator: Evaluator, found: Evaluated, second: str) -> tuple[float, float]:
    """Both to be minimised."""
    if not math.isfinite(found.cost):
        return HUGE, HUGE
    mean = evaluator.means(found)
    return mean.flatness, SECOND[second] * getattr(mean, second)
