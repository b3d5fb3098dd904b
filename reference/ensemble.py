"""Samples of one case, and the mean of as many of them as it takes (Section 4.1).

Each sample is the case with a seed of its own; what is observed, and by which engine, is the caller's.
Statistics on finished samples are no part of the model: `cmpcheck/statistics`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from statistics import fmean, stdev
from typing import NamedTuple, TypeVar

import numpy as np

from reference.case import Case

Observed = TypeVar("Observed")
SAMPLES = 0x53414D50  # first word of the spawn key; the streams of `process.py` have keys of one small word
SEED_BITS = 53  # a seed that TOML's integers and JSON's doubles keep exactly


def sample_case(case: Case, k: int) -> Case:
    """The case as sample k of its ensemble: the same but for its seed.

    The seed is the first 53 bits of NumPy's SeedSequence of the case's seed with the spawn key
    (SAMPLES, k).  It depends on these two alone, so samples can be run in any order, on any machine, and
    more can be added later; engines that are given the same sample start from the same arrays.

    Parameters: case, one of its `variants()`; k >= 0.
    Raises ValueError for a negative k.
    """
    if k < 0:
        raise ValueError(f"sample {k}; allowed: 0, 1, ...")
    sequence = np.random.SeedSequence(case.case.seed, spawn_key=(SAMPLES, k))
    seed = int(sequence.generate_state(1, np.uint64)[0]) >> (64 - SEED_BITS)
    return case.model_copy(update={"case": case.case.model_copy(update={"seed": seed})})


def run_samples(
    case: Case,
    numbers: Iterable[int],
    observe: Callable[[Case], Observed],
    executor: Executor | None = None,
) -> list[Observed]:
    """What `observe` returns for each of these samples, in the order of `numbers` however they are run.

    Parameters: observe, called with the case of one sample (for processes: importable, not a lambda);
    executor, any of `concurrent.futures` or with its interface; without it samples run here, one by one.
    Raises what `observe` raises first, in that order.
    """
    run = map if executor is None else executor.map
    return list(run(partial(_observe, case, observe), numbers))


def _observe(case: Case, observe: Callable[[Case], Observed], k: int) -> Observed:
    return observe(sample_case(case, k))


class AdaptiveMean(NamedTuple):
    """The mean over an ensemble that was as large as it had to be; unpacks into three."""

    mean: float
    standard_error: float
    values: np.ndarray  # (n,), sample by sample

    @property
    def last_change(self) -> float:
        """By how much the last sample moved the mean."""
        return abs(self.mean - fmean(self.values[:-1]))

    def settled(self, tolerance: float) -> bool:
        """The last two means differ by the tolerance or less; otherwise the maximum ended it."""
        return self.last_change <= tolerance

    def settled_too_early(self, tolerance: float) -> bool:
        """The paper's rule ended it while the mean was still uncertain by more than the tolerance.

        This is usual: one more sample moves the mean by about s/n, but the mean is uncertain by s/sqrt(n).
        To bring the standard error to the tolerance takes (s/tolerance)^2 samples.
        """
        return self.settled(tolerance) and self.standard_error > tolerance


@dataclass(frozen=True)
class StoppingRule:
    """How many samples are enough: until two consecutive means differ by `tolerance` or less.

    Paper: Section 4.1.  The rule is applied from the sample number `minimum` on: at n = minimum, the mean of
    n samples is held against that of n - 1.

    Parameters: tolerance, absolute, in the unit of the samples; maximum, at which it ends whatever the
    difference is.
    Raises ValueError unless 2 <= minimum <= maximum and 0 <= tolerance.
    """

    minimum: int = 15
    tolerance: float = 0.01
    maximum: int = 200

    def __post_init__(self) -> None:
        if not 2 <= self.minimum <= self.maximum:
            raise ValueError(
                f"minimum {self.minimum}, maximum {self.maximum}; allowed: 2 <= minimum <= maximum"
            )
        if not self.tolerance >= 0:
            raise ValueError(f"tolerance {self.tolerance}; allowed: 0 or more")

    def enough(self, values: Sequence[float]) -> bool:
        """Whether the ensemble may end with the samples 0 to n - 1, whose values these are."""
        if len(values) < self.minimum:
            return False
        return len(values) >= self.maximum or abs(fmean(values) - fmean(values[:-1])) <= self.tolerance


def ensemble_mean(values: Sequence[float]) -> AdaptiveMean:
    """Mean and standard error s/sqrt(n) of n >= 2 samples."""
    return AdaptiveMean(fmean(values), stdev(values) / math.sqrt(len(values)), np.array(values))


def adaptive_mean(
    sample: Callable[[int], float], minimum: int = 15, tolerance: float = 0.01, maximum: int = 200
) -> AdaptiveMean:
    """The mean of sample(0), sample(1), ..., of as many as `StoppingRule` asks for.

    Paper: Section 4.1.
    Parameters: sample, the observable of sample k; the others are those of `StoppingRule`.
    Returns: mean, standard error s/sqrt(n), values.
    Raises ValueError if a sample is not finite, and as `StoppingRule` does.

    >>> mean, standard_error, values = adaptive_mean(lambda k: k % 2, tolerance=0.04)
    >>> mean, len(values)  # 7/15 after 15 samples; one before, 7/14
    (0.4666666666666667, 15)
    """
    rule = StoppingRule(minimum, tolerance, maximum)
    values: list[float] = []
    while not rule.enough(values):
        values.append(float(sample(len(values))))
        if not math.isfinite(values[-1]):
            raise ValueError(f"sample {len(values) - 1} is {values[-1]}; allowed: finite values")
    return ensemble_mean(values)
