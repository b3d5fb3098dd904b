"""Laws of how many pairs a verdict needs, and of confidence bands: both by simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rates import ALPHA, agrees, lowest
from scipy import stats

from cmpcheck.statistics import (
    detectable_difference,
    difference_band,
    fewest_pairs,
    mean_band,
    power_of_equivalence,
    sample_size,
)
from cmpcheck.statistics.resampling import StudentizedMean


@pytest.mark.parametrize("n, spread, shift", [(5, 1.0, 0.0), (12, 1.0, 0.0), (24, 1.4, 0.1)])
def test_the_power_of_equivalence_is_that_of_two_simulated_t_tests(n, spread, shift):
    trials = 20_000
    d = np.random.default_rng(8).normal(shift, spread, (trials, n))
    half = stats.t.isf(ALPHA, n - 1) * d.std(axis=1, ddof=1) / math.sqrt(n)
    shown = np.count_nonzero(abs(d.mean(axis=1)) + half < 1.0)
    power = power_of_equivalence(spread, 1.0, n, true_difference=shift)
    assert agrees(shown, trials, power)
    assert not agrees(shown, trials, power_of_equivalence(spread, 1.0, n + 2, true_difference=shift))


@pytest.mark.parametrize("spread", [0.77, 1.4])
def test_as_many_pairs_as_asked_for_reach_the_power_by_the_bootstrap(spread):
    """One-sided: more power than asked for, by the whole number of pairs, is welcome."""
    rng, trials, n = np.random.default_rng(9), 1000, sample_size(spread, 1.0)
    shown = 0
    for _ in range(trials):
        low, high = StudentizedMean.of(rng.normal(0, spread, n), rng, 399).interval(ALPHA)
        shown += low > -1 and high < 1
    assert shown >= lowest(trials, 0.9)


def test_the_number_of_pairs_tends_to_that_of_known_spread_and_grows_with_what_is_asked():
    """n = (z_(1-alpha) + z_((1+power)/2))^2 (sigma/margin)^2 for many; Student's t adds about z^2/2 = 1.4."""
    known = (stats.norm.ppf(0.95) + stats.norm.ppf(0.95)) ** 2 * 5.5**2
    assert known < sample_size(0.11, 0.02) - 2 < known + 1.4 + 1  # 1: the next whole number
    assert sample_size(0.03, 0.02, power=0.95) > sample_size(0.03, 0.02) > sample_size(0.02, 0.02)
    assert sample_size(0.03, 0.02, true_difference=0.005) > sample_size(0.03, 0.02)
    with pytest.raises(ValueError, match="no n shows"):
        sample_size(0.01, 0.02, true_difference=0.02)


@pytest.mark.parametrize("n", [2, 8, 24])
def test_the_detectable_difference_is_found_with_the_power_asked_for(n):
    trials = 20_000
    shift = detectable_difference(3.0, n)
    d = np.random.default_rng(2).normal(shift, 3.0, (trials, n))
    assert agrees(np.count_nonzero(stats.ttest_1samp(d, 0, axis=1).pvalue <= ALPHA), trials, 0.9)
    assert detectable_difference(6.0, n) == pytest.approx(2 * shift, rel=1e-12, abs=0)


@pytest.mark.parametrize("quantities", [1, 8, 20])
def test_the_fewest_pairs_are_those_whose_smallest_p_survives_the_family(quantities):
    n = fewest_pairs(quantities)
    assert quantities * 2.0 ** (1 - n) <= ALPHA < quantities * 2.0 ** (2 - n)


def test_a_band_covers_the_mean_of_five_normal_curves_at_its_rate_and_one_with_normal_limits_does_not():
    curves = np.random.default_rng(0).normal(size=(5, 20_000))
    band = mean_band(curves, confidence=0.9)
    assert agrees(np.count_nonzero((band.lower < 0) & (band.upper > 0)), 20_000, 0.9)
    half = stats.norm.ppf(0.95) * curves.std(axis=0, ddof=1) / math.sqrt(5)
    assert not agrees(np.count_nonzero(abs(band.mean) < half), 20_000, 0.9)


def test_a_band_in_numbers():
    """Two values 0 and 2: mean 1, standard error 1, and t of one degree of freedom is tan(0.45 pi)."""
    band = mean_band([[0.0, 5.0], [2.0, 5.0]], confidence=0.9)
    half = math.tan(0.45 * math.pi)
    np.testing.assert_allclose(band, [[1, 5], [1 - half, 5], [1 + half, 5]], rtol=1e-9, atol=0)
    assert [*difference_band([[1.0], [4.0]], [[1.0], [2.0]]).upper] == pytest.approx([1 + half], rel=1e-9)
    with pytest.raises(ValueError, match="two or more curves"):
        mean_band([[1.0, 2.0]])
    with pytest.raises(ValueError, match="no pairs"):
        difference_band(np.zeros((2, 3)), np.zeros((2, 4)))
