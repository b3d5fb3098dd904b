"""Other methods of search: the same budget, strings within the bounds, the same result when they go on."""

from __future__ import annotations

import design_example as example
import numpy as np
import pytest

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.front import find_front, front_table, not_dominated
from cmpcheck.optimise.methods import METHODS, OWN, compare_methods, methods_table, strings_at
from cmpcheck.optimise.search import MAIN, search
from cmpcheck.optimise.store import Store


@pytest.fixture
def prepared(tmp_path):
    """A finished search, and what evaluates more strings."""
    pytest.importorskip("pymoo")
    problem = example.problem()
    store = Store.create(tmp_path, problem.case, True)
    store._sql.execute("PRAGMA synchronous = OFF")
    with example.Threads(2) as workers:
        evaluator = Evaluator(problem, store, workers, evaluate=example.quick)
        search(problem, evaluator)
        yield problem, evaluator
    store.close()


def test_every_method_has_the_same_budget_and_never_spends_more(prepared):
    problem, evaluator = prepared
    trials = compare_methods(problem, evaluator, 150, 2)
    assert [(trial.method, trial.seed) for trial in trials] == [(m, s) for s in (0, 1) for m in METHODS]
    low, high = problem.bounds.T
    for trial in trials:
        assert 150 - problem.rule.maximum < trial.used[-1] <= 150
        assert list(trial.best) == sorted(trial.best, reverse=True)
        assert ((low <= trial.string) & (trial.string <= high)).all()
        assert trial.string[1] == round(trial.string[1])
        assert len(trial.fresh) == problem.settings.distribution_samples
    assert len({trial.string for trial in trials}) == len(trials)
    table = methods_table(problem, trials)
    assert table["fresh_cost"].between(-0.1, 0.6).all()
    again = compare_methods(problem, evaluator, 150, 2)
    assert methods_table(problem, again).equals(table)


def test_fresh_samples_are_none_that_a_string_was_chosen_by(prepared):
    problem, evaluator = prepared
    (own, *_) = compare_methods(problem, evaluator, 60, 1)
    first = problem.rule.maximum
    expected = [example.quick(problem, own.string, first + k).cost for k in range(len(own.fresh))]
    np.testing.assert_array_equal(own.fresh, expected)


def test_the_first_trial_of_the_paper_s_algorithm_is_the_search_itself(prepared):
    problem, evaluator = prepared
    asked = evaluator.store.asked(MAIN)
    new: list = []
    evaluator._on_sample = new.append
    compare_methods(problem, evaluator, sum(ask.found.samples for ask in asked), 1)
    own = [ask.found for ask in evaluator.store.asked(f"{OWN}, seed 0")]
    assert own == [ask.found for ask in asked][: len(own)]


def test_points_of_the_unit_cube_reach_every_string_within_the_bounds():
    problem = example.problem()
    assert (strings_at(problem, np.zeros(4)) == problem.bounds[:, 0]).all()
    assert (strings_at(problem, np.ones(4)) == problem.bounds[:, 1]).all()
    counts = strings_at(problem, np.random.default_rng(0).random((36000, 4)))[:, 1]
    values, often = np.unique(counts, return_counts=True)
    assert values.tolist() == list(range(5, 41))
    assert (abs(often - 1000) < 5 * np.sqrt(1000)).all()


def test_no_point_of_a_front_is_worse_than_another_in_both_objectives(prepared):
    problem, evaluator = prepared
    front = find_front(problem, evaluator, "abrasive_mass")
    points = np.array([(mean.flatness, mean.abrasive_mass) for mean in front.means])
    for point in points[front.on_front]:
        assert not ((points <= point).all(axis=1) & (points < point).any(axis=1)).any()
    for point in points[~front.on_front]:
        assert ((points <= point).all(axis=1) & (points < point).any(axis=1)).any()
    table = front_table(problem, front)
    assert table["flatness"].is_monotonic_increasing
    assert table["abrasive_mass"].is_monotonic_decreasing
    rate = find_front(problem, evaluator, "removal_rate")
    assert front_table(problem, rate)["removal_rate"].is_monotonic_increasing  # more removed, less flat


def test_equal_points_do_not_dominate_each_other():
    assert not_dominated(np.array([[1.0, 1.0], [1.0, 1.0]])).all()
