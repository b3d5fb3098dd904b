"""Laws of ensembles: samples that depend on seed and number alone, and the adaptive mean of Section 4.1."""

from __future__ import annotations

import math
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

from reference import Case, load_case
from reference.ensemble import adaptive_mean, run_samples, sample_case
from reference.process import random_streams


@pytest.fixture(scope="module")
def case() -> Case:
    return load_case("swarm")


def first_numbers(case: Case) -> dict[str, float]:
    """What the streams of a sample begin with; at the top level, so that another process can find it."""
    return {name: stream.random() for name, stream in random_streams(case.case.seed).items()}


def slow_first(case: Case) -> int:
    """Sample 0 is finished last."""
    time.sleep(0.2 if case == sample_case(load_case("swarm"), 0) else 0.0)
    return case.case.seed


def test_a_sample_is_the_case_with_a_seed_of_its_own(case):
    sample = sample_case(case, 3)
    assert sample.case.seed != case.case.seed
    same = sample.model_copy(update={"case": sample.case.model_copy(update={"seed": case.case.seed})})
    assert same == case
    assert sample_case(case, 3) == sample
    assert sample.path == case.path


def test_seeds_are_what_they_were_in_every_release():
    """Results are quoted by case and sample number: a change of these numbers would orphan them."""
    case = load_case("swarm")
    base = case.model_copy(update={"case": case.case.model_copy(update={"seed": 7})})
    assert [sample_case(base, k).case.seed for k in (0, 1)] == [5952934778012098, 257574020974685]


def test_seeds_of_samples_and_of_neighbouring_cases_are_all_different_and_fit_toml_and_json(case):
    cases = [case.model_copy(update={"case": case.case.model_copy(update={"seed": s})}) for s in range(5)]
    seeds = {sample_case(base, k).case.seed for base in cases for k in range(200)}
    assert len(seeds) == 1000  # by chance two are equal once in 2^53/(1000^2/2) = 10^10 times
    assert 0 <= min(seeds) <= max(seeds) < 2**53
    assert seeds.isdisjoint(range(5))


def test_streams_of_samples_are_uncorrelated_with_each_other_and_with_those_of_the_case(case):
    """The first 400 numbers of each: correlations of 1/sqrt(400), all 1128 of them within 5 of that."""
    samples = [case, *(sample_case(case, k) for k in range(8))]
    numbers = [stream.random(400) for s in samples for stream in random_streams(s.case.seed).values()]
    off_diagonal = np.corrcoef(numbers)[np.triu_indices(len(numbers), 1)]
    assert abs(off_diagonal).max() < 5 / math.sqrt(400)


def test_a_sample_survives_being_saved(case, tmp_path):
    sample = sample_case(case, 1)
    sample.save(tmp_path / "sample.toml")
    assert load_case(tmp_path / "sample.toml") == sample


def test_variants_of_a_sample_are_samples_of_the_variants():
    case = load_case("wall_bounce")
    assert len(case.variants()) > 1
    assert sample_case(case, 5).variants() == [sample_case(variant, 5) for variant in case.variants()]


def test_a_negative_sample_is_refused(case):
    with pytest.raises(ValueError, match=r"sample -1; allowed: 0, 1, \.\.\."):
        sample_case(case, -1)


@pytest.mark.parametrize("workers", [1, 2])
def test_samples_are_the_same_here_and_on_any_number_of_workers(case, workers):
    here = run_samples(case, range(6), first_numbers)
    assert len({tuple(numbers.values()) for numbers in here}) == 6
    with ProcessPoolExecutor(workers) as executor:
        assert run_samples(case, range(6), first_numbers, executor) == here
    with ThreadPoolExecutor(workers) as executor:
        assert run_samples(case, (4, 2), first_numbers, executor) == [here[4], here[2]]


def test_results_come_in_order_of_the_samples_and_not_of_their_completion(case):
    with ThreadPoolExecutor(2) as executor:
        seeds = run_samples(case, range(4), slow_first, executor)
    assert seeds == [sample_case(case, k).case.seed for k in range(4)]


def test_a_sample_that_fails_ends_the_ensemble_with_its_error(case):
    def observe(sample: Case) -> float:
        raise ArithmeticError(str(sample.case.seed))

    with (
        ThreadPoolExecutor(2) as executor,
        pytest.raises(ArithmeticError, match=str(sample_case(case, 2).case.seed)),
    ):
        run_samples(case, [2, 3], observe, executor)


def taken(values: list[float], **options: float) -> int:
    """The number of samples that the rule takes of these; they are asked for in order, once each."""
    asked: list[int] = []

    def sample(k: int) -> float:
        asked.append(k)
        return values[k]

    result = adaptive_mean(sample, **options)
    assert asked == list(range(len(result.values)))
    np.testing.assert_array_equal(result.values, values[: len(asked)])
    return len(asked)


def test_it_ends_when_two_consecutive_means_differ_by_the_tolerance_or_less():
    """The means of 0, 1, 1, 1, ... are 1 - 1/n and differ by 1/(n (n - 1)): from n = 4 on 1/12, 1/20."""
    steps = [0.0] + [1.0] * 20
    assert taken(steps, minimum=2, tolerance=1 / 16) == 5
    assert taken(steps, minimum=2, tolerance=1 / 24) == 6
    assert taken([0.0, 1.0, 0.5, 2.5, 1.0], minimum=2, tolerance=0.5) == 2  # |1/2 - 0| equals the tolerance
    assert taken([0.0, 1.0, 0.5, 2.5, 1.0], minimum=2, tolerance=0.49) == 3


def test_it_never_ends_before_the_minimum_and_compares_no_means_but_the_last_two():
    assert taken([1.0] * 40) == 15
    assert taken([1.0] * 40, minimum=20) == 20
    late = [1.0] * 14 + [100.0] + [7.6] * 10  # the mean jumps at n = 15 and stays from then on
    assert taken(late, tolerance=1e-9) == 16


def test_the_tolerance_is_absolute():
    values = [0.0] + [1.0] * 60
    assert taken(values, minimum=2, tolerance=0.01) == taken(
        [1e6 + v for v in values], minimum=2, tolerance=0.01
    )
    assert taken([100 * v for v in values], minimum=2, tolerance=0.01, maximum=50) == 50


def test_the_maximum_is_respected_and_told_apart():
    growing = adaptive_mean(lambda k: float(k), minimum=3, tolerance=0.1, maximum=7)
    assert len(growing.values) == 7
    assert growing.last_change == 0.5
    assert not growing.settled(0.1)
    assert not growing.settled_too_early(0.1)
    assert adaptive_mean(lambda k: 1.0, minimum=7, maximum=7).settled(0.0)


def test_mean_and_standard_error_in_numbers():
    mean, standard_error, values = adaptive_mean([1.0, 2.0, 3.0, 6.0].__getitem__, 4, 0.5, 4)
    assert mean == 3.0
    assert standard_error == pytest.approx(math.sqrt(14 / 3 / 4), rel=1e-15, abs=0)
    assert values.shape == (4,)


def test_the_rule_of_the_paper_ends_before_the_standard_error_is_as_small_as_the_tolerance():
    """A sample moves the mean by s/n, which is uncertain by s/sqrt(n): 0.11/sqrt(15) = 0.028 and 0.007."""
    draws = np.random.default_rng(0).normal(0.3, 0.11, 200)
    result = adaptive_mean(draws.__getitem__, tolerance=0.01)
    assert result.settled(0.01)
    assert result.settled_too_early(0.01)
    assert result.standard_error > 2 * 0.01
    steady = adaptive_mean((0.3 + 0.01 * draws).__getitem__, tolerance=0.01)
    assert steady.settled(0.01)
    assert not steady.settled_too_early(0.01)


def test_twin_without_a_minimum_two_samples_that_happen_to_be_alike_would_do():
    values = [0.5, 0.5] + [0.1] * 30
    assert taken(values, minimum=2, tolerance=0.005) == 2
    assert abs(adaptive_mean(values.__getitem__, minimum=2, tolerance=0.005).mean - 0.1) > 0.3
    assert abs(adaptive_mean(values.__getitem__, tolerance=0.005).mean - 0.1) < 0.06


@pytest.mark.parametrize(
    "options, words",
    [
        ({"minimum": 1}, "minimum 1, maximum 200; allowed: 2 <= minimum <= maximum"),
        ({"minimum": 5, "maximum": 4}, "minimum 5, maximum 4"),
        ({"tolerance": -0.1}, "tolerance -0.1"),
        ({"tolerance": math.nan}, "tolerance nan"),
    ],
)
def test_a_rule_that_cannot_end_well_is_refused(options, words):
    with pytest.raises(ValueError, match=words):
        adaptive_mean(lambda k: 1.0, **options)


def test_a_sample_that_is_not_finite_is_named():
    with pytest.raises(ValueError, match="sample 1 is nan"):
        adaptive_mean([1.0, math.nan, 2.0].__getitem__)
