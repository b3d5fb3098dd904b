"""The genetic algorithm of Section 3.2 on a design problem, generation by generation, from where it stood.

The algorithm itself is `reference/genetic.py`; other methods of search are `methods.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.problem import Problem
from reference.genetic import GeneticAlgorithm

MAIN = "search"  # the run of the store that the table shows
SEARCH = 0x53454152  # first word of the spawn key of a search; `ensemble.SAMPLES` is that of the samples


def search_rng(problem: Problem, number: int = 0) -> np.random.Generator:
    """The random numbers of search number 0, 1, ... of a case: its seed's, and independent of all samples."""
    seed = problem.case.case.seed
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(SEARCH, number)))


def new_algorithm(problem: Problem, number: int = 0) -> GeneticAlgorithm:
    """The genetic algorithm of the case's [optimise], before its first generation."""
    part = problem.settings
    rng = search_rng(problem, number)
    return GeneticAlgorithm(problem.bounds, part.population, part.parents, rng=rng, integer=problem.integer)


def origins(ga: GeneticAlgorithm, count: int) -> list[str]:
    """Where the `count` strings of a fresh generation come from: offspring first, then random ones."""
    offspring = ga.parents if ga.generation else 0
    return ["offspring" if n < offspring else "random" for n in range(count)]


def search(
    problem: Problem,
    evaluator: Evaluator,
    on_generation: Callable[[GeneticAlgorithm], None] = lambda ga: None,
) -> GeneticAlgorithm:
    """Run the generations that are still to be run; every one is kept in the evaluator's store.

    `on_generation` is called before each generation and at the end.
    """
    ga, store = new_algorithm(problem), evaluator.store
    state = store.last_state()
    if state is not None:
        ga.restore(state)
    while ga.generation < problem.settings.generations:
        on_generation(ga)
        strings = ga.ask()
        first = asked_before(problem, ga.generation)
        found = evaluator.costs(strings, MAIN, first, ga.generation + 1, origins(ga, len(strings)))
        ga.tell(strings, [result.cost for result in found])
        store.save_state(ga.generation, ga.state())
    on_generation(ga)
    return ga


def asked_before(problem: Problem, generation: int) -> int:
    """How many strings earlier generations asked for: S, then S - K each, as parents keep their cost."""
    part = problem.settings
    return generation and part.population + (generation - 1) * (part.population - part.parents)
