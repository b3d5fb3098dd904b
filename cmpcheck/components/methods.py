"""Methods on which verdicts and designs rest: extrapolation, equivalence, and the genetic algorithm."""

from __future__ import annotations

import numpy as np
from scipy import stats

from cmpcheck.components.row import count, row, worst
from cmpcheck.convergence import (
    SAFETY_CREDIBLE,
    extrapolate,
    grid_convergence_index,
    phase_error,
)
from cmpcheck.results import Comparison
from cmpcheck.statistics import paired_difference
from reference.ensemble import adaptive_mean
from reference.genetic import GeneticAlgorithm

NASA_LEVELS, NASA_VALUES = (1.0, 2.0, 4.0), (0.97050, 0.96854, 0.96178)
NASA_ORDER, NASA_LIMIT, NASA_INDEX = 1.786170, 0.971300, 0.00103083  # as published, the index relative
ALPHA, TRIALS, RESAMPLES = 0.05, 400, 399
CHANCE = 1e-4  # of a false alarm of the rate of verdicts, were its seeds not fixed

MODEL_FILES = ("reference/ensemble.py", "reference/genetic.py")  # all of the model that is imported here


def checks() -> list[Comparison]:
    """Published or exact outcomes of each method."""
    return [*_nasa(), _phases(), *_verdicts(), *_genetic(), _adaptive_mean()]


def nasa_example() -> tuple[float, float, float]:
    """Order, limit and relative index of the grid convergence that NASA publishes as an example."""
    found = extrapolate(NASA_LEVELS, NASA_VALUES, formal_order=2.0)
    assert found.order is not None
    index = grid_convergence_index(*NASA_VALUES[:2], 2.0, found.order, SAFETY_CREDIBLE) / NASA_VALUES[0]
    return found.order, found.value, index


def _nasa() -> list[Comparison]:
    """The pressure recovery of an inlet on three grids (NASA, "Examining Spatial (Grid) Convergence")."""
    order, limit, index = nasa_example()
    digits = "the digits that are published"
    oscillating = extrapolate(NASA_LEVELS, (1.0, 1.1, 1.0), formal_order=1.0)
    return [
        row("order", "", order, NASA_ORDER, 1e-6, digits, kind="precision", variant="NASA"),
        row("extrapolated", "", limit, NASA_LIMIT, 1e-6, digits, kind="precision", variant="NASA"),
        row("grid_convergence_index", "", index, NASA_INDEX, 2e-8, digits, kind="precision", variant="NASA"),
        worst(
            "grid_convergence_index", "", np.array([oscillating.uncertainty]), np.array([3.0 * 0.1]),
            relative=1e-9, reason="three times the largest change of two levels, order 1",
            variant="oscillating levels",
        ),
    ]  # fmt: skip


def _phases() -> Comparison:
    """The mean of n samples of a sawtooth misses that of all phases by half the bound."""
    n = 16
    values = np.arange(n) / n  # of a sawtooth that rises from 0 to 1 over the phase
    bound = phase_error(float(np.ptp(values)) / 2.0, n)
    missed = 0.5 - float(values.mean())
    return row("phase_error", "", bound, 2.0 * missed, 1e-12, "twice what the mean of the sawtooth misses")


def _verdicts() -> list[Comparison]:
    """Differences that are as large as the margin are called equivalent, and different, at the rate alpha."""
    rng, names = np.random.default_rng(20), []
    for k in range(TRIALS):
        sample = rng.normal(1.0, 0.5, 16)
        names.append(paired_difference(sample, 1.0, ALPHA, seed=k, resamples=RESAMPLES).verdict)
    low, high = (float(x) for x in stats.binom.interval(1.0 - CHANCE, TRIALS, ALPHA))
    half = 0.5 * (high - low) / TRIALS
    reason = f"binomial, {TRIALS} trials, {CHANCE:g}"
    return [
        row(
            f"false_{verdict}", "", names.count(verdict) / TRIALS, ALPHA, half, reason, kind="precision",
            variant="a difference of one margin",
        )
        for verdict in ("equivalent", "different")
    ]  # fmt: skip


def _genetic() -> list[Comparison]:
    """The best never worsens, offspring lie between their parents, and M = S - 2K strings are new."""
    bounds, parents, population = [[-1.0, 2.0], [0.5, 3.0]], 4, 12
    search = GeneticAlgorithm(bounds, population, parents, rng=np.random.default_rng(3))
    worse = outside = 0
    fresh = []
    for _ in range(25):
        strings = search.ask()
        if search.generation:
            fresh.append(len(strings) - parents)
            pairs = search.strings[:parents].reshape(parents // 2, 2, 2)
            children = strings[:parents].reshape(parents // 2, 2, 2)
            low, high = pairs.min(axis=1, keepdims=True), pairs.max(axis=1, keepdims=True)
            outside += int(((children < low - 1e-12) | (children > high + 1e-12)).sum())
        search.tell(strings, ((strings - [0.3, 1.4]) ** 2).sum(axis=1))
        worse += len(search.history) > 1 and search.history[-1] > search.history[-2]
    new = population - 2 * parents
    return [
        count("worse_generations", "", worse, 0, "parents keep their place and cost", "genetic algorithm"),
        count(
            "genes_outside", "", outside, 0, "Phi A + (1 - Phi) B lies between A and B", "genetic algorithm"
        ),
        count("new_strings", "", max(fresh, key=lambda n: abs(n - new)), new, "S - 2K", "genetic algorithm"),
    ]


def _adaptive_mean() -> Comparison:
    """Of 0, 1, 0, 1, ... the means of 14 and 15 samples differ by 1/30, and those of 25 and 26 by 1/50."""
    found = adaptive_mean(lambda k: k % 2, minimum=15, tolerance=0.025)
    return count(
        "samples", "", len(found.values), 21, "7/15 - 1/2 = 1/30; 10/21 - 1/2 = 1/42", "adaptive mean"
    )
