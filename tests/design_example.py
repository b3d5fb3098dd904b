"""A design problem in which samples cost nothing: what the tests of `cmpcheck.optimise` run."""

from __future__ import annotations

import math
import os
import time
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from cmpcheck.optimise.problem import Problem, Sample, String
from cmpcheck.optimise.workers import Workers
from reference.case import Case, load_case

SMALL = {"population": 8, "parents": 2, "generations": 3, "minimum_samples": 4, "maximum_samples": 9}


def design_case(**settings: Any) -> Case:
    """polish_design with other keys of [optimise], on the smallest surface that polishes."""
    raw = load_case("polish_design").model_dump(by_alias=True, exclude_none=True)
    raw["optimise"] |= SMALL | settings
    raw["case"]["duration"] = 2e-6
    raw["surface"] |= {"size": 5e-6, "nodes": 10, "asperity_density": 0.05}
    return Case.model_validate({name: part for name, part in raw.items() if part})


def problem(**settings: Any) -> Problem:
    return Problem(design_case(**settings))


def quick(problem: Problem, string: String, k: int) -> Sample:
    """A bowl with its bottom in the middle, and noise that is the sample's own, the same for every string."""
    low, high = problem.bounds.T
    place = (np.array(string) - low) / (high - low)
    noise = np.random.default_rng(k).normal()
    cost = float(((place - 0.5) ** 2).sum() + (0.01 + 0.1 * place[3]) * noise)
    return Sample(cost, cost, 1e-9 * (1.0 + place[0]), 1e-12 * (1.0 + place[1]), 0.01)


def slow(problem: Problem, string: String, k: int) -> Sample:
    """The same, so slowly that one can interrupt it."""
    time.sleep(0.05)
    return quick(problem, string, k)


def shuffled(problem: Problem, string: String, k: int) -> Sample:
    """The same, finished in another order than begun."""
    time.sleep(0.01 if k % 3 == 0 else 0.0)
    return quick(problem, string, k)


def crowded(problem: Problem, string: String, k: int) -> Sample:
    """Strings with many particles have no place for them in sample 2 and later ones."""
    if string[1] > 20 and k >= 2:
        return Sample(
            math.nan, math.nan, math.nan, math.nan, 0.0, f"no place for {string[1]:g} particles in {k}"
        )
    return quick(problem, string, k)


def deadly_once(problem: Problem, string: String, k: int) -> Sample:
    """The third sample of a string kills its worker, the first time that it is run."""
    mark = Path(os.environ["CMPCHECK_TEST_MARK"])
    if k == 2 and not mark.exists():
        mark.touch()
        os._exit(3)
    return quick(problem, string, k)


def deadly(problem: Problem, string: String, k: int) -> Sample:
    """Strings in the upper half of the first gene kill every worker that runs their sample 1."""
    low, high = problem.bounds[0]
    if k == 1 and string[0] > (low + high) / 2:
        os._exit(3)
    return quick(problem, string, k)


def always_deadly(problem: Problem, string: String, k: int) -> Sample:
    """No worker survives."""
    os._exit(3)


class Threads(Workers):
    """Workers that start at once, for samples that cost nothing."""

    def __init__(self, jobs: int = 1) -> None:
        super().__init__()
        self._jobs = jobs

    def size(self) -> int:
        return self._jobs

    def stop(self) -> None:
        if self._executor is not None:
            self._executor.shutdown()
            self._executor = None

    def _start(self) -> Executor:
        return ThreadPoolExecutor(self._jobs)
