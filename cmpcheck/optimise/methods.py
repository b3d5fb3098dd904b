"""Side by side: the paper's genetic algorithm, random search, differential evolution, pymoo's algorithm.

Every method gets the same evaluation, the same surfaces, the same number of samples and several seeds.  The
best strings are compared on fresh samples, which none of them was chosen by.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.problem import Problem, String, paper_columns
from cmpcheck.optimise.search import new_algorithm, search_rng

HUGE = 1e6  # what a method is told for an infinite cost, of which differences cannot be formed
OWN = "genetic algorithm"


class BudgetSpent(Exception):
    """The samples of a method are used up."""


@dataclass(frozen=True)
class Trial:
    """One method with one seed."""

    method: str
    seed: int
    used: tuple[int, ...]  # samples used up to each of its strings
    best: tuple[float, ...]  # least cost up to it
    string: String  # with the least cost
    fresh: np.ndarray  # costs of that string on samples that no string was chosen by


class Budgeted:
    """The costs of strings in the unit cube, until the samples of one method and seed are used up.

    Strings are charged for all samples of their ensembles, also for those that another method has paid for.
    """

    def __init__(self, problem: Problem, evaluator: Evaluator, run: str, budget: int) -> None:
        self.problem, self._evaluator, self._run, self._left = problem, evaluator, run, budget
        self.size = len(problem.keys)
        self.used: list[int] = []
        self.best: list[float] = []
        self.string: String = ()

    def costs(self, strings: np.ndarray) -> np.ndarray:
        """Costs (m,) of strings (m, n); raises BudgetSpent after those that can be paid for."""
        rule = self.problem.rule
        payable = strings[: math.ceil(self._left / rule.minimum)]
        origins = [self._run] * len(payable)
        found = self._evaluator.costs(payable, self._run, len(self.used), 0, origins)
        for one in found:
            self._left -= max(one.samples, 1)
            if self._left < 0:
                raise BudgetSpent
            if one.cost < min(self.best, default=math.inf):
                self.string = one.string
            self.used.append((self.used[-1] if self.used else 0) + max(one.samples, 1))
            self.best.append(min(one.cost, min(self.best, default=math.inf)))
        if len(payable) < len(strings):
            raise BudgetSpent
        return np.array([min(one.cost, HUGE) for one in found])


def strings_at(problem: Problem, unit: ArrayLike) -> np.ndarray:
    """Strings (m, n) of points (m, n) of the unit cube; whole numbers are equally wide."""
    low, high = problem.bounds.T
    half = 0.5 * np.array(problem.integer)
    strings = low - half + (high - low + 2.0 * half) * np.atleast_2d(np.asarray(unit, float))
    return np.clip(np.where(problem.integer, np.round(strings), strings), low, high)


def genetic_algorithm(task: Budgeted, seed: int) -> None:
    """The paper's; seed 0 is the search of the main table."""
    ga = new_algorithm(task.problem, seed)
    while True:
        strings = ga.ask()
        ga.tell(strings, task.costs(strings))


def random_search(task: Budgeted, seed: int) -> None:
    """Strings anywhere within the bounds."""
    rng, size = _rng(task.problem, seed), task.problem.settings.population
    while True:
        task.costs(strings_at(task.problem, rng.random((size, task.size))))


def differential_evolution(task: Budgeted, seed: int) -> None:
    """SciPy's, with its own defaults but for the size of the population and whole-number genes."""
    from scipy.optimize import differential_evolution as evolve

    rng = _rng(task.problem, seed)
    first = rng.random((task.problem.settings.population, task.size))

    def costs(unit: np.ndarray) -> np.ndarray:
        return task.costs(strings_at(task.problem, unit.T))

    while True:  # it may stop by itself before the budget is spent
        evolve(
            costs,
            [(0.0, 1.0)] * task.size,
            init=first,
            maxiter=10**6,
            tol=0.0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=rng,
        )


def pymoo_ga(task: Budgeted, seed: int) -> None:
    """pymoo's, with its own defaults but for the size of the population."""
    from pymoo.algorithms.soo.nonconvex.ga import GA

    def costs(unit: np.ndarray) -> np.ndarray:
        return task.costs(strings_at(task.problem, unit))[:, np.newaxis]

    algorithm = GA(pop_size=task.problem.settings.population)
    run_pymoo(algorithm, costs, (task.size, 1), _rng(task.problem, seed), 10**6)


def run_pymoo(
    algorithm: Any,
    values: Callable[[np.ndarray], np.ndarray],
    shape: tuple[int, int],
    rng: np.random.Generator,
    generations: int,
) -> None:
    """Minimise values(points), (m, objectives), over points (m, n) of the unit cube.

    Parameters: shape, (n, objectives).
    """
    from pymoo.core.problem import Problem as Objectives
    from pymoo.optimize import minimize

    class Told(Objectives):
        """What pymoo calls."""

        def __init__(self) -> None:
            super().__init__(n_var=shape[0], n_obj=shape[1], xl=0.0, xu=1.0)

        def _evaluate(self, x: np.ndarray, out: dict, *_: object, **__: object) -> None:
            out["F"] = values(x)

    seed = int(rng.integers(2**31))
    minimize(Told(), algorithm, ("n_gen", generations), seed=seed, copy_algorithm=False, verbose=False)


def _rng(problem: Problem, seed: int) -> np.random.Generator:
    """Random numbers of a method, independent of those of the paper's algorithm with the same seed."""
    return search_rng(problem, seed).spawn(1)[0]


METHODS: dict[str, Callable[[Budgeted, int], None]] = {
    OWN: genetic_algorithm,
    "random search": random_search,
    "differential evolution (SciPy)": differential_evolution,
    "genetic algorithm (pymoo)": pymoo_ga,
}


def compare_methods(
    problem: Problem,
    evaluator: Evaluator,
    budget: int,
    seeds: int,
    on_trial: Callable[[str, int], None] = lambda method, seed: None,
) -> list[Trial]:
    """Every method with each of the seeds 0, 1, ..., and the best string of each on fresh samples.

    A trial that meets no string that can be run is left out.

    Parameters: budget, samples for each method and seed; `on_trial` is called before each.
    """
    trials = []
    for seed in range(seeds):
        for name, method in METHODS.items():
            on_trial(name, seed)
            task = Budgeted(problem, evaluator, f"{name}, seed {seed}", budget)
            with contextlib.suppress(BudgetSpent), warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of methods that meet equal or huge costs
                method(task, seed)
            if not task.string:  # it met none that can be run
                continue
            part = problem.settings
            (fresh,) = evaluator.samples([task.string], part.distribution_samples, part.maximum_samples)
            costs = np.array([sample.cost for sample in fresh])
            trials.append(Trial(name, seed, tuple(task.used), tuple(task.best), task.string, costs))
    return trials


def methods_table(problem: Problem, trials: Sequence[Trial]) -> pd.DataFrame:
    """One row for each method and seed, with the best string on fresh samples."""
    rows = [
        {
            "method": trial.method,
            "seed": trial.seed,
            "samples": trial.used[-1],
            "strings": len(trial.used),
            "cost": trial.best[-1],
            "fresh_cost": trial.fresh.mean(),
            "fresh_standard_error": trial.fresh.std(ddof=1) / math.sqrt(len(trial.fresh)),
        }
        | paper_columns(problem, trial.string)
        for trial in trials
    ]
    return pd.DataFrame(rows)
