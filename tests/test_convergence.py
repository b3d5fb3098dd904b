"""Observed order, extrapolated value and its uncertainty: a published example, known series, failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpcheck.convergence import (
    SAFETY_CREDIBLE,
    Extrapolation,
    add_corrections,
    agreement,
    exact,
    extrapolate,
    grid_convergence_index,
    observed_order,
    phase_error,
)

EPS = float(np.finfo(float).eps)
NASA_LEVELS = [1.0, 2.0, 4.0]
NASA_VALUES = [0.97050, 0.96854, 0.96178]

signed = st.floats(0.01, 100).flatmap(lambda x: st.sampled_from([x, -x]))
levels_of_three = st.sampled_from([(1.0, 2.0, 4.0), (1.0, 1.5, 3.0), (1.0, 2.0, 3.0), (3e-10, 6e-10, 1.2e-9)])


def true_value_is_inside(result: Extrapolation, value: float) -> bool:
    return abs(result.value - value) <= result.uncertainty


def test_order_extrapolation_and_indices_of_the_published_nasa_example():
    """NASA's tutorial on grid convergence prints 1.786170, 0.97130, 0.103083 %, 0.356249 % and 0.997980.

    Tolerances: half a unit of the last printed digit.  The last number, near 1 in the asymptotic range, is
    printed as the inverse of the formula beside it.
    """
    result = extrapolate(NASA_LEVELS, NASA_VALUES, formal_order=2)
    assert result.credible
    assert result.order == pytest.approx(1.786170, rel=0, abs=5e-7)
    assert result.value == pytest.approx(0.97130, rel=0, abs=5e-6)

    f1, f2, f3 = NASA_VALUES
    fine = grid_convergence_index(f1, f2, 2, result.order, SAFETY_CREDIBLE) / f1
    coarse = grid_convergence_index(f2, f3, 2, result.order, SAFETY_CREDIBLE) / f2
    assert 100 * fine == pytest.approx(0.103083, rel=0, abs=5e-7)
    assert 100 * coarse == pytest.approx(0.356249, rel=0, abs=5e-7)
    assert (2**result.order * fine) / coarse == pytest.approx(0.997980, rel=0, abs=5e-7)
    # The rest of the uncertainty is rounding: 1000 eps per value, amplified by less than 10.
    assert result.uncertainty == pytest.approx(fine * f1, rel=0, abs=1e4 * EPS)


@given(levels=levels_of_three, order=st.floats(0.6, 4), coefficient=signed)
def test_the_order_of_a_pure_power_is_found_for_equal_and_unequal_ratios(levels, order, coefficient):
    """The differences here are of the size of the values and keep 12 digits or more: 1e-9 is generous."""
    relative = [h / levels[0] for h in levels]
    values = [coefficient * h**order for h in relative]
    assert observed_order(levels, values) == pytest.approx(order, rel=1e-9, abs=0)


@given(
    levels=levels_of_three,
    formal=st.sampled_from([1, 2, 3]),
    limit=st.floats(-100, 100),
    coefficient=signed,
    next_term=st.floats(-3, 3),
)
def test_the_true_value_is_inside_for_a_leading_term_and_the_next(
    levels, formal, limit, coefficient, next_term
):
    """f = f0 + c h^p (1 + b h): with any b the order is either credible or given up."""
    relative = [h / levels[0] for h in levels]
    values = [limit + coefficient * h**formal * (1 + next_term * h) for h in relative]
    assert true_value_is_inside(extrapolate(levels, values, formal), limit)


@given(limit=st.floats(-100, 100), coefficient=signed, next_term=st.floats(-0.2, 10))
def test_the_true_value_is_inside_for_two_levels(limit, coefficient, next_term):
    """Two levels cannot see a next term that cancels the leading one: b >= -0.2 leaves enough of it."""
    values = [limit + coefficient * h * (1 + next_term * h) for h in (1, 2)]
    result = extrapolate([1, 2], values, 1)
    assert not result.credible
    assert true_value_is_inside(result, limit)


@given(coefficient=signed, limit=st.floats(-1, 1))
def test_twin_a_limit_that_is_off_by_more_than_the_correction_is_outside(coefficient, limit):
    values = [limit + coefficient * h for h in (1, 2, 4)]
    result = extrapolate([1, 2, 4], values, 1)
    assert not true_value_is_inside(result, limit + 1.3 * coefficient)
    assert not true_value_is_inside(result, limit - 1.3 * coefficient)


def test_twin_an_observed_order_that_is_always_believed_would_have_missed():
    """With f = h^2 (1 - 0.64 h) the finest two levels are closer than the error: hence a band of orders."""
    values = [h**2 * (1 - 0.64 * h) for h in (1, 2, 4)]
    order = observed_order([1, 2, 4], values)
    assert order == pytest.approx(4.0, abs=0.05)
    naive_value = values[0] + (values[0] - values[1]) / (2**order - 1)
    naive_index = grid_convergence_index(values[0], values[1], 2, order, SAFETY_CREDIBLE)
    assert abs(naive_value) > naive_index
    result = extrapolate([1, 2, 4], values, 2)
    assert not result.credible
    assert true_value_is_inside(result, 0.0)


def test_finest_levels_that_agree_by_accident_do_not_narrow_the_uncertainty():
    """f = h - 0.33 h^2 turns between h = 1 and 2: these two differ by 0.01, and both are 0.67 off."""
    values = [h - 0.33 * h**2 for h in (1, 2, 4)]
    result = extrapolate([1, 2, 4], values, 1)
    assert 3 * abs(values[1] - values[0]) < abs(result.value)
    assert true_value_is_inside(result, 0.0)


def test_an_oscillating_sequence_gets_the_larger_factor_and_no_order():
    result = extrapolate([1, 2, 4], [1.001, 0.999, 1.003], 1)
    assert not result.credible
    assert result.order is None
    assert "oscillate" in result.reason
    assert result.uncertainty >= 3 * 0.002


def test_an_order_far_from_the_formal_one_is_shown_but_not_used():
    values = [1 + h**0.3 for h in (1, 2, 4)]
    result = extrapolate([1, 2, 4], values, 1)
    assert result.order == pytest.approx(0.3, rel=1e-9)
    assert not result.credible
    assert "0.30" in result.reason


def test_two_levels_use_the_formal_order_and_the_factor_three():
    result = extrapolate([2, 1], [1.2, 1.1], 1)
    assert result.value == pytest.approx(1.0, rel=4 * EPS, abs=0)
    assert result.uncertainty == pytest.approx(3 * 0.1, rel=1e-10, abs=0)
    assert "two levels" in result.reason


@pytest.mark.parametrize("value", [0.5, -3e-15, 1e20])
def test_values_equal_to_rounding_keep_an_uncertainty(value):
    result = extrapolate([1, 2, 4], [value, value * (1 + 4 * EPS), value], 1)
    assert result.value == value
    assert 1000 * EPS * abs(value) <= result.uncertainty <= 1e4 * EPS * abs(value)
    assert result.order is None
    assert "rounding" in result.reason


def test_zero_on_all_levels_has_the_uncertainty_of_its_scale_and_never_none():
    zeros = [0.0, 0.0, 0.0]
    assert extrapolate([1, 2, 4], zeros, 1, scale=2.0).uncertainty >= 2000 * EPS
    bare = extrapolate([1, 2, 4], zeros, 1)
    assert bare.uncertainty > 0
    assert "zero" in bare.reason


def test_a_rounding_sized_difference_is_not_taken_for_convergence():
    """Differences of 3e-14 in a number built from magnitudes of 1 are rounding, whatever order they mimic."""
    values = [1 + 1e-14, 1 + 2e-14, 1 + 4e-14]
    assert observed_order([1, 2, 4], values) is not None
    assert extrapolate([1, 2, 4], values, 1).order is None


@given(
    phase=st.floats(0, 1),
    knee=st.floats(0.01, 0.99),
    phases=st.integers(2, 32),
    end=st.floats(-1, 1),
)
def test_the_mean_over_equally_spaced_phases_is_within_its_bound(phase, knee, phases, end):
    """A rise from 0 to 1 at the knee, a fall to `end`, and a jump back: the range is 1 - min(0, end)."""
    x = np.mod(phase + np.arange(phases) / phases, 1.0)
    samples = np.where(x < knee, x / knee, 1 + (end - 1) * (x - knee) / (1 - knee))
    true_mean = knee / 2 + (1 - knee) * (1 + end) / 2
    half_range = (1 - min(0.0, end)) / 2
    assert abs(samples.mean() - true_mean) <= phase_error(half_range, phases) + 100 * EPS


@given(phase=st.floats(0, 1), phases=st.integers(2, 32))
def test_the_bound_holds_with_the_range_of_the_samples_of_a_sawtooth(phase, phases):
    """What a sub-step phase does first: the overlap at detection grows linearly and starts anew."""
    samples = np.mod(phase + np.arange(phases) / phases, 1.0)
    assert abs(samples.mean() - 0.5) <= phase_error(np.ptp(samples) / 2, phases) + 100 * EPS


def test_twin_a_mean_over_too_few_phases_is_outside_the_bound_of_many():
    """Two phases of a sawtooth of range 1 can miss its mean by 0.25; sixteen are trusted to 1/15."""
    two = np.mod(0.0 + np.arange(2) / 2, 1.0).mean()
    assert abs(two - 0.5) > phase_error(0.5, 16)


def test_the_spread_over_the_phases_enters_the_uncertainty():
    levels, values = [1, 2, 4], [1.01, 1.02, 1.04]
    without = extrapolate(levels, values, 1)
    with_spread = extrapolate(levels, values, 1, spreads=[0.001, 0.002, 0.004])
    assert with_spread.uncertainty > without.uncertainty + phase_error(0.001, 16)
    assert with_spread.credible


@given(errors=st.tuples(*[st.floats(-1, 1)] * 3), size=st.floats(1e-6, 1))
def test_the_true_value_stays_inside_when_every_level_is_wrong_within_its_bound(errors, size):
    values = [5 + h + size * e for h, e in zip((1, 2, 4), errors, strict=True)]
    assert true_value_is_inside(extrapolate([1, 2, 4], values, 1, errors=[size] * 3), 5.0)


def test_levels_lost_in_the_spread_are_not_credible_and_ask_for_more_phases():
    result = extrapolate([1, 2, 4], [1.01, 1.02, 1.04], 1, spreads=[0.2, 0.2, 0.2])
    assert not result.credible
    assert result.remedy == "more sub-step phases"


def test_the_finest_three_of_many_levels_are_used_in_any_sequence():
    levels = [8, 1, 4, 2]
    values = [100.0, 1.01, 1.04, 1.02]
    assert extrapolate(levels, values, 1) == extrapolate([1, 2, 4], [1.01, 1.02, 1.04], 1)


@pytest.mark.parametrize(
    "levels, values, message",
    [
        ([1], [1.0], "two or more"),
        ([1, 1], [1.0, 2.0], "distinct"),
        ([0, 1], [1.0, 2.0], "positive"),
        ([1, 2], [1.0, math.nan], "not finite"),
        ([1, 2, 3], [1.0, 2.0], "length"),
    ],
)
def test_levels_that_cannot_be_extrapolated_are_refused(levels, values, message):
    with pytest.raises(ValueError, match=message):
        extrapolate(levels, values, 1)


def test_two_refinements_from_one_run_add_their_corrections():
    """f = 1 + h + k, refined in h at k = 0.1 and in k at h = 0.1."""
    in_h = extrapolate([0.1, 0.2, 0.4], [1.2, 1.3, 1.5], 1)
    in_k = extrapolate([0.1, 0.2], [1.2, 1.3], 1)
    both = add_corrections(in_h, in_k)
    assert both.value == pytest.approx(1.0, rel=1e-12, abs=0)
    assert both.uncertainty == in_h.uncertainty + in_k.uncertainty
    assert not both.credible


def sure(value: float, uncertainty: float) -> Extrapolation:
    return Extrapolation(value, uncertainty, None, True, "given", "a better measurement")


def test_values_agree_up_to_the_sum_of_their_uncertainties_and_not_beyond():
    assert agreement(sure(1.0, 0.003), sure(1.0049, 0.002), scale=1.0).status == "agree"
    assert agreement(sure(1.0, 0.003), sure(1.0051, 0.002), scale=1.0).status == "disagree"


def test_a_tolerance_wider_than_its_limit_is_no_test_and_says_what_would_narrow_it():
    verdict = agreement(sure(1.0, 0.001), sure(1.0, 0.0095), scale=1.0)
    assert verdict.status == "not_tested"
    assert "too uncertain" in verdict.reason
    assert "a better measurement" in verdict.reason
    assert agreement(sure(1.0, 0.001), sure(1.0, 0.0095), scale=1.0, relative_limit=0.03).status == "agree"
    assert agreement(sure(0.0, 1e-9), sure(0.0, 1e-9), scale=0.0).status == "not_tested"


def test_a_difference_beyond_a_wide_tolerance_is_still_a_disagreement():
    assert agreement(sure(1.0, 0.2), sure(2.0, 0.2), scale=1.0).status == "disagree"


def test_a_value_that_is_not_finite_is_an_error():
    assert agreement(sure(1.0, 0.1), sure(math.nan, 0.1), scale=1.0).status == "error"


def test_a_closed_form_carries_the_rounding_of_what_entered_it():
    assert exact(0.5).uncertainty == pytest.approx(500 * EPS, rel=1e-12, abs=0)
    assert exact(0.0, scale=4.0).uncertainty == pytest.approx(4000 * EPS, rel=1e-12, abs=0)
    assert exact(0.0).uncertainty > 0
