"""Laws of the verdicts on ensembles: rates of false verdicts by simulation, invariance, what is refused."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rates import ALPHA, agrees, highest
from scipy import stats

from cmpcheck.statistics import (
    control_family,
    kolmogorov_smirnov,
    paired_difference,
    power_of_equivalence,
    relative_differences,
)
from cmpcheck.statistics.resampling import StudentizedMean, sign_flip_p

MARGIN = 0.02
SPREAD = 0.011  # of the paired difference of flatness in a prototype


def exponential(rng: np.random.Generator, n: int) -> np.ndarray:
    """Skewed to the right, mean 0, standard deviation 1."""
    return rng.exponential(size=n) - 1


def bootstrap_misses(
    draw: Callable[[np.random.Generator, int], np.ndarray], n: int, trials: int
) -> tuple[int, int]:
    """How often the mean 0 lies below and above the interval."""
    rng = np.random.default_rng(11)
    below = above = 0
    for _ in range(trials):
        low, high = StudentizedMean.of(draw(rng, n), rng, 399).interval(ALPHA)
        below, above = below + (low > 0), above + (high < 0)
    return below, above


def test_sign_flips_count_the_patterns_with_a_mean_as_far_from_zero():
    d = np.array([0.3, -0.1, 0.7, 0.2, 0.55, -0.05])
    means = [np.mean(d * signs) for signs in itertools.product((1, -1), repeat=len(d))]
    expected = np.mean(np.abs(means) >= abs(d.mean()) * (1 - 1e-12))  # ties up to rounding
    assert sign_flip_p(d, np.random.default_rng(0), 999) == expected
    assert sign_flip_p(np.array([1.0, 2.0, 3.0]), np.random.default_rng(0), 999) == 2 / 2**3


@pytest.mark.parametrize("shape", ["heavy tails", "two peaks"])
def test_a_difference_is_found_at_its_nominal_rate_where_there_is_none_whatever_the_shape(shape):
    """With n = 8 and no ties p <= 0.05 holds for 2 x 6 of 256 patterns, and all are equally likely."""
    rng, trials = np.random.default_rng(5), 1000
    d = rng.standard_cauchy((trials, 8))
    if shape == "two peaks":
        d = rng.choice([-1, 1], (trials, 8)) * (1 + 0.1 * rng.random((trials, 8)))
    found = sum(sign_flip_p(row, rng, 999) <= ALPHA for row in d)
    assert agrees(found, trials, 12 / 256)


def test_twin_normal_limits_at_8_pairs_find_too_many():
    d = np.random.default_rng(5).normal(size=(1000, 8))
    ratio = d.mean(axis=1) / (d.std(axis=1, ddof=1) / math.sqrt(8))
    assert not agrees(np.count_nonzero(abs(ratio) > stats.norm.isf(ALPHA / 2)), 1000, ALPHA)


@pytest.mark.parametrize("draw", [lambda rng, n: rng.normal(size=n), exponential], ids=["normal", "skewed"])
def test_each_limit_of_the_interval_misses_the_mean_at_its_nominal_rate(draw):
    below, above = bootstrap_misses(draw, n=16, trials=1000)
    assert agrees(below, 1000, ALPHA)
    assert agrees(above, 1000, ALPHA)


def test_twin_the_limits_of_student_and_of_bca_miss_the_mean_of_skewed_differences_too_often():
    rng, trials, n = np.random.default_rng(11), 1000, 16
    d = np.array([exponential(rng, n) for _ in range(trials)])
    student = d.mean(axis=1) + stats.t.isf(ALPHA, n - 1) * d.std(axis=1, ddof=1) / math.sqrt(n)
    assert not agrees(np.count_nonzero(student < 0), trials, ALPHA)
    bca = [
        stats.bootstrap((row,), np.mean, n_resamples=399, confidence_level=1 - 2 * ALPHA, rng=rng)
        for row in d
    ]
    assert not agrees(sum(b.confidence_interval.high < 0 for b in bca), trials, ALPHA)


@pytest.mark.parametrize("mean", [MARGIN, -MARGIN])
def test_a_difference_as_large_as_the_margin_is_called_equivalent_and_different_at_the_nominal_rate(mean):
    rng, trials = np.random.default_rng(3), 200
    verdicts = [
        paired_difference(rng.normal(mean, SPREAD, 16), MARGIN, seed=k, resamples=399).verdict
        for k in range(trials)
    ]
    assert agrees(verdicts.count("equivalent"), trials, ALPHA)
    assert agrees(verdicts.count("different"), trials, ALPHA)


def test_twin_no_significant_difference_is_no_equivalence():
    """Where 8 pairs scatter by five margins, p > 0.05 is usual for a difference of the margin."""
    rng = np.random.default_rng(4)
    results = [paired_difference(rng.normal(MARGIN, 5 * MARGIN, 8), MARGIN, resamples=399) for _ in range(40)]
    assert sum(not result.resolved for result in results) > 30
    assert not [result for result in results if result.verdict == "equivalent"]


STEADY = np.linspace(-1, 1, 8)  # a spread of 0.7 about a mean of zero


@pytest.mark.parametrize(
    "mean, spread, verdict, status, words",
    [
        (0.0, 0.001, "equivalent", "agree", "lies within"),
        (0.01, 0.001, "equivalent", "agree", "smaller than the margin was resolved"),
        (0.05, 0.001, "different", "disagree", "lies beyond"),
        (-0.05, 0.001, "different", "disagree", "lies beyond"),
        (0.0, 1.0, "inconclusive", "not_tested", "inconclusive, n = 8: .* n = [0-9]+ would settle it"),
        (0.02, 0.01, "inconclusive", "not_tested", "a difference was resolved .* not whether it exceeds"),
    ],
)
def test_an_interval_and_a_margin_give_one_of_three_verdicts(mean, spread, verdict, status, words):
    result = paired_difference(mean + spread * STEADY, MARGIN)
    assert (result.verdict, result.status) == (verdict, status)
    assert result.n == 8
    assert result.mean == pytest.approx(mean, rel=1e-12, abs=1e-12 * spread)
    assert result.standard_error == pytest.approx(spread * stats.sem(STEADY), rel=1e-12, abs=0)
    assert re.search(words, result.reason)


def test_limits_and_p_values_count_the_same_resamples():
    """Of 19 ratios -9, ..., 9 the second from each end limits a mean of 0 +- 1 at alpha = 2/20."""
    mean = StudentizedMean(0.0, 1.0, np.arange(-9.0, 10.0))
    assert mean.interval(0.1) == (-8.0, 8.0)
    assert [mean.p_not_below(bound) for bound in (7.5, 8.0, 8.5, 10.0)] == [3 / 20, 3 / 20, 2 / 20, 1 / 20]
    assert [mean.p_not_above(-bound) for bound in (7.5, 8.0, 8.5, 10.0)] == [3 / 20, 3 / 20, 2 / 20, 1 / 20]


def test_resamples_without_spread_count_as_far_away_but_for_those_that_equal_the_mean():
    ratios = StudentizedMean.of(np.array([-1.0, 0.0, 1.0]), np.random.default_rng(0), 1999).ratios
    assert agrees(np.count_nonzero(ratios == math.inf), 1999, 1 / 27)
    assert agrees(np.count_nonzero(ratios == -math.inf), 1999, 1 / 27)


def test_four_pairs_cannot_call_anything_different():
    """The smallest p of 4 sign flips is 1/8."""
    result = paired_difference([1.0, 1.01, 1.02, 1.03], MARGIN)
    assert result.p_different == 1 / 8
    assert result.verdict == "inconclusive"
    assert "n is too small for the test" in result.reason


@pytest.mark.parametrize("seed", range(30))
def test_equivalence_is_shown_just_where_both_one_sided_tests_reject(seed):
    d = np.random.default_rng(seed).normal((-1) ** seed * 0.008, 0.02, 12)
    result = paired_difference(d, MARGIN, resamples=399)
    assert (result.p_equivalent <= ALPHA) == (result.verdict == "equivalent")


def test_order_unit_and_sign_of_the_differences_do_not_matter():
    d = np.random.default_rng(1).normal(0.01, SPREAD, 12)
    result = paired_difference(d, MARGIN)
    assert paired_difference(d[::-1], MARGIN) == result
    scaled = paired_difference(1024 * d, 1024 * MARGIN)  # a power of two: exact
    assert (scaled.verdict, scaled.p_equivalent, scaled.p_different) == (
        result.verdict,
        result.p_equivalent,
        result.p_different,
    )
    assert scaled.interval == tuple(1024 * limit for limit in result.interval)
    mirrored = paired_difference(-d, MARGIN)
    assert mirrored.p_different == result.p_different
    # 500 of 9999 resamples lie beyond a limit, give or take sqrt(500): 1/22 of them, hence of the half-width
    half = 0.5 * (result.interval[1] - result.interval[0])
    np.testing.assert_allclose([-x for x in mirrored.interval[::-1]], result.interval, rtol=0, atol=half / 4)


def test_the_same_seed_gives_the_same_result_and_another_one_another_interval():
    d = np.random.default_rng(1).normal(0.01, SPREAD, 16)
    assert paired_difference(d, MARGIN, seed=3) == paired_difference(d, MARGIN, seed=3)
    assert paired_difference(d, MARGIN, seed=3).interval != paired_difference(d, MARGIN, seed=4).interval


def test_differences_without_spread_are_judged_by_their_value_and_say_so():
    same = paired_difference(np.zeros(8), MARGIN)
    assert (same.verdict, same.interval, same.p_different) == ("equivalent", (0.0, 0.0), 1.0)
    assert "all differences are equal: fewer than 31 % of all pairs" in same.reason  # 1 - 0.05^(1/8)
    assert paired_difference(np.full(8, 0.1), MARGIN).verdict == "different"
    assert paired_difference(np.full(8, MARGIN), MARGIN).verdict == "inconclusive"


def test_two_pairs_bound_nothing():
    """Half of their resamples have no spread."""
    result = paired_difference([0.001, 0.002], MARGIN)
    assert result.interval == (-math.inf, math.inf)
    assert result.verdict == "inconclusive"


@pytest.mark.parametrize(
    "differences, margin, alpha, words",
    [
        ([0.1], MARGIN, ALPHA, "two or more pairs"),
        ([[0.1, 0.2]], MARGIN, ALPHA, "one-dimensional"),
        ([0.1, math.nan], MARGIN, ALPHA, "finite"),
        ([0.1, 0.2], 0.0, ALPHA, "margin"),
        ([0.1, 0.2], MARGIN, 0.6, "alpha"),
        ([0.1, 0.2], MARGIN, 1e-6, "resamples"),
    ],
)
def test_what_cannot_be_judged_is_refused(differences, margin, alpha, words):
    with pytest.raises(ValueError, match=words):
        paired_difference(differences, margin, alpha)
    with pytest.raises(ValueError, match="one pair shows no spread"):
        power_of_equivalence(1.0, 1.0, 1)


def test_the_published_example_of_benjamini_and_hochberg_finds_four_differences_of_fifteen():
    p = [0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240, 0.4262, 0.5719]
    p += [0.6528, 0.7590, 1.0]
    bare = paired_difference(0.05 + 0.001 * STEADY, MARGIN)
    family = control_family([replace(bare, p_different=value) for value in p])
    assert [result.verdict for result in family] == ["different"] * 4 + ["inconclusive"] * 11
    assert [result.p_different for result in family] == p
    assert sum(value <= ALPHA for value in p) == 9  # the twin: without control, nine
    assert control_family([]) == []


def test_a_family_of_equal_engines_raises_a_false_alarm_at_most_at_its_rate():
    """All null, so the false discovery rate is the rate of any discovery; unadjusted, 1 - 0.95^8 = 0.34."""
    rng, trials = np.random.default_rng(6), 200
    bare = paired_difference(STEADY, margin=10.0)
    alarms = unadjusted = 0
    for _ in range(trials):
        p = [sign_flip_p(rng.normal(size=10), rng, 399) for _ in range(8)]
        alarms += any(r.resolved for r in control_family([replace(bare, p_different=x) for x in p]))
        unadjusted += min(p) <= ALPHA
    limit = highest(trials, ALPHA)
    assert alarms <= limit < unadjusted


def test_equal_distributions_are_told_apart_at_most_at_the_nominal_rate_and_correlated_values_too_often():
    """The twin pools 20 values each of 10 samples, which differ from each other more than within."""
    rng, trials = np.random.default_rng(7), 400
    limit = highest(trials, ALPHA)  # an upper limit: the exact test is conservative
    single = rng.normal(size=(trials, 2, 10))
    alarms = sum(kolmogorov_smirnov(a, b).p_different <= ALPHA for a, b in single)
    pooled = np.repeat(single, 20, axis=2) + 0.3 * rng.normal(size=(trials, 2, 200))
    assert alarms <= limit
    assert sum(kolmogorov_smirnov(a, b).p_different <= ALPHA for a, b in pooled) > limit


def test_the_distance_of_two_distributions_is_that_of_their_steps():
    assert kolmogorov_smirnov([1, 2, 3, 4], [3.5, 5, 6, 7]).distance == 0.75
    assert kolmogorov_smirnov(np.arange(20), np.arange(20) + 30).p_different < 1e-9
    with pytest.raises(ValueError, match="finite"):
        kolmogorov_smirnov([], [1.0])


def test_relative_differences_need_pairs_and_a_reference_that_is_not_zero():
    with pytest.raises(ValueError, match="no pairs"):
        relative_differences([1, 2], [1, 2, 3])
    with pytest.raises(ValueError, match="zero"):
        relative_differences([1, 2], [1, -1])
