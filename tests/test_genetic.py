"""The genetic algorithm of Section 3.2: what is kept, mated and renewed, and that nothing is lost."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference.genetic import GeneticAlgorithm

BOUNDS = [[0.0, 1.0], [-2.0, 5.0], [10.0, 90.0]]
WHOLE = (False, False, True)


def sphere(strings: np.ndarray) -> np.ndarray:
    low, high = np.array(BOUNDS).T
    return (((strings - low) / (high - low) - 0.3) ** 2).sum(axis=1)


def algorithm(seed: int = 0, **options) -> GeneticAlgorithm:
    return GeneticAlgorithm(BOUNDS, **{"rng": np.random.default_rng(seed), "integer": WHOLE, **options})


def evolve(ga: GeneticAlgorithm, generations: int) -> GeneticAlgorithm:
    for _ in range(generations):
        strings = ga.ask()
        ga.tell(strings, sphere(strings))
    return ga


def test_a_generation_is_k_parents_k_offspring_and_the_rest_new():
    ga = algorithm(population=20, parents=4)
    assert len(ga.ask()) == 20
    evolve(ga, 1)
    assert len(ga.ask()) == 4 + 12  # the parents keep their cost: M = S - 2K = 12
    assert ga.strings.shape == (20, 3)
    evolve(ga, 1)
    assert ga.strings.shape == (20, 3)


def test_offspring_lie_between_the_two_parents_next_to_each_other_in_rank_gene_by_gene():
    ga = algorithm(population=20, parents=4, integer=(False,) * 3)
    evolve(ga, 1)
    offspring, parents = ga.ask()[:4], ga.strings[:4]
    for pair in range(2):
        two = parents[2 * pair : 2 * pair + 2]
        for child in offspring[2 * pair : 2 * pair + 2]:
            phi = (child - two[1]) / (two[0] - two[1])
            assert ((phi >= 0.0) & (phi <= 1.0)).all()
            assert len(np.unique(phi)) == 3  # a fresh Phi for every gene
    assert not (offspring[0] == offspring[1]).any()  # and for every offspring


def test_the_mean_offspring_is_the_mean_of_its_parents():
    """Phi is uniform: mean 1/2 and variance 1/12, both within five of their standard errors."""
    phis = []
    for seed in range(400):
        ga = evolve(algorithm(seed, population=4, parents=2, integer=(False,) * 3), 1)
        first, second = ga.strings[:2]
        phis += ((ga.ask()[:2] - second) / (first - second)).ravel().tolist()
    assert abs(np.mean(phis) - 0.5) < 5.0 / np.sqrt(12 * len(phis))
    assert abs(np.var(phis) - 1 / 12) < 5.0 * np.sqrt((1 / 80 - 1 / 144) / len(phis))


@given(st.integers(0, 2**32), st.sampled_from([(4, 2), (8, 4), (20, 4), (21, 10)]))
def test_the_best_cost_never_rises_and_every_string_respects_its_bounds(seed, sizes):
    ga = algorithm(seed, population=sizes[0], parents=sizes[1])
    noise = np.random.default_rng(seed)
    low, high = np.array(BOUNDS).T
    for _ in range(5):
        strings = ga.ask()
        assert ((strings >= low) & (strings <= high)).all()
        assert (strings[:, 2] == np.round(strings[:, 2])).all()
        ga.tell(strings, noise.random(len(strings)))
    assert all(after <= before for before, after in pairwise(ga.history))
    assert ga.best[1] == ga.history[-1] == ga.costs.min()


def test_whole_numbers_are_equally_likely():
    """Each of 5 values: 400 +- 5 sqrt(400 * 0.8) among 2000."""
    ga = GeneticAlgorithm([[1, 5]], population=2000, parents=2, rng=np.random.default_rng(1), integer=[True])
    values, counts = np.unique(ga.ask(), return_counts=True)
    assert values.tolist() == [1, 2, 3, 4, 5]
    assert (abs(counts - 400) < 5 * np.sqrt(400 * 0.8)).all()


def test_costs_may_be_told_in_parts_and_in_any_order():
    whole, parts = algorithm(3), algorithm(3)
    for _ in range(3):
        evolve(whole, 1)
        while (generation := parts.generation) < whole.generation:
            strings = parts.ask()[::-1][:7]
            parts.tell(strings, sphere(strings))
            assert parts.generation in (generation, generation + 1)
    assert (whole.ask() == parts.ask()).all()
    assert (whole.strings == parts.strings).all()


def test_a_restored_algorithm_goes_on_with_the_same_strings():
    straight = evolve(algorithm(5), 6)
    stopped = evolve(algorithm(5), 2)
    half = stopped.ask()[:5]
    stopped.tell(half, sphere(half))
    resumed = algorithm(99)
    resumed.restore(json.loads(json.dumps(stopped.state())))
    assert len(resumed.ask()) == len(stopped.ask())
    rest = resumed.ask()
    resumed.tell(rest, sphere(rest))
    evolve(resumed, 3)
    assert (resumed.strings == straight.strings).all()
    assert resumed.history == straight.history


def test_a_fresh_algorithm_can_be_saved_and_restored():
    fresh = algorithm(2)
    other = algorithm(7)
    other.restore(fresh.state())
    assert (evolve(other, 2).strings == evolve(fresh, 2).strings).all()


def test_a_string_that_cannot_be_run_ranks_last():
    ga = algorithm(population=4, parents=2)
    strings = ga.ask()
    ga.tell(strings, [np.inf, 2.0, np.inf, 1.0])
    assert ga.best[1] == 1.0
    assert (ga.strings[0] == strings[3]).all()


def test_it_beats_as_many_random_strings():
    """By chance 123 or more of 200 seeds would be won with a probability of 0.07 %."""
    wins = 0
    for seed in range(200):
        ga = evolve(algorithm(seed), 15)
        random = algorithm(1000 + seed, population=20 + 14 * 16)
        wins += ga.best[1] < sphere(random.ask()).min()
    assert wins >= 123


@pytest.mark.parametrize(
    ("bounds", "options", "word"),
    [
        ([], {}, "bounds"),
        ([[1.0, 0.0]], {}, "lower first"),
        ([[0.0, np.inf]], {}, "finite"),
        ([[0.0, 1.0]], {"parents": 3}, "even"),
        ([[0.0, 1.0]], {"parents": 0}, "even"),
        ([[0.0, 1.0]], {"population": 6, "parents": 4}, "half"),
        ([[0.0, 1.0]], {"integer": [True, False]}, "one for each gene"),
        ([[0.5, 3.0]], {"integer": [True]}, "whole numbers"),
    ],
)
def test_what_makes_no_sense_is_refused(bounds, options, word):
    with pytest.raises(ValueError, match=word):
        GeneticAlgorithm(bounds, rng=np.random.default_rng(0), **options)


def test_costs_that_are_no_numbers_and_foreign_strings_are_refused_and_change_nothing():
    ga = algorithm(population=4, parents=2)
    strings = ga.ask()
    with pytest.raises(ValueError, match="NaN"):
        ga.tell(strings, [1.0, 2.0, np.nan, 3.0])
    with pytest.raises(ValueError, match="not asked for"):
        ga.tell(strings + 1e-9, [1.0, 2.0, 3.0, 4.0])
    with pytest.raises(ValueError, match="one cost"):
        ga.tell(strings, [1.0])
    with pytest.raises(ValueError, match="no generation"):
        _ = ga.best
    assert len(ga.ask()) == 4
