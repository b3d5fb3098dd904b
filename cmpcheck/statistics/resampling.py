"""Inference on one mean without assuming normal data: sign flips for a p-value, a bootstrap for bounds.

What the numbers are and what follows from them is `equivalence.py`.

Sources: E. J. G. Pitman, J. R. Stat. Soc. Suppl. 4 (1937) 119 (sign flips); B. Phipson and G. K. Smyth,
Stat. Appl. Genet. Mol. Biol. 9 (2010) 39 (never p = 0 from random flips); P. Hall, Ann. Statist. 16 (1988)
927 (studentized bootstrap, second-order correct on each side); B. Efron, J. Am. Stat. Assoc. 82 (1987) 171
(BCa, the alternative).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats


def sign_flip_p(values: np.ndarray, rng: np.random.Generator, resamples: int) -> float:
    """Two-sided p-value of a mean of zero when each value could as well have had the other sign.

    Why this test for paired differences: if two engines are the same, swapping them within a pair changes
    the sign of its difference and nothing else, so all 2^n sign patterns are equally likely, whatever the
    shape of the distribution.  It tests the mean, on which the margin is set (Wilcoxon's test weighs ranks),
    and needs no normal data (the t test does).

    Parameters: values (n,); resamples, the number of random flips where 2^n is larger.
    Returns: p; not below 2^(1-n), nor below 2/(resamples + 1) where flips are random.
    """
    result = stats.permutation_test(
        (values,), np.mean, permutation_type="samples", vectorized=True, n_resamples=resamples, rng=rng
    )
    return float(result.pvalue)


@dataclass(frozen=True)
class StudentizedMean:
    """The bootstrap distribution of t = (mean - true mean)/(standard error), by which a mean is bounded.

    Why studentized and not BCa: at 8 normal values a BCa bound of 95 % misses the mean in 9 % of trials, this
    one in 5.4 %; on the long side of 16 exponential values BCa misses 9 %, Student's t 11 %, this one 6.4 %.
    """

    mean: float
    standard_error: float
    ratios: np.ndarray  # t of every resample, ascending; infinite where all values drawn are equal

    @staticmethod
    def of(values: np.ndarray, rng: np.random.Generator, resamples: int) -> StudentizedMean:
        """Resample `values` (n,), which must not all be equal."""
        n = len(values)
        mean = values.mean()
        drawn = values[rng.integers(0, n, (resamples, n))]
        shift = drawn.mean(axis=1) - mean
        error = drawn.std(axis=1, ddof=1) / np.sqrt(n)
        ratios = np.divide(shift, error, out=np.copysign(np.inf, shift), where=error > 0)
        ratios[(shift == 0) & (error == 0)] = 0.0
        return StudentizedMean(float(mean), float(values.std(ddof=1) / np.sqrt(n)), np.sort(ratios))

    def interval(self, alpha: float) -> tuple[float, float]:
        """The interval that the true mean is below with probability alpha, and above with the same.

        Raises ValueError if the resamples are too few for that alpha.
        """
        k = int(alpha * (len(self.ratios) + 1) + 1e-9)
        if k < 1:
            raise ValueError(f"{len(self.ratios)} resamples cannot show alpha = {alpha}")
        low, high = self.ratios[k - 1], self.ratios[-k]
        return float(self.mean - high * self.standard_error), float(self.mean - low * self.standard_error)

    def p_not_below(self, bound: float) -> float:
        """p-value of a true mean of `bound` or more; at most alpha just where `interval` ends below it."""
        ratio = (self.mean - bound) / self.standard_error
        return float(1 + np.searchsorted(self.ratios, ratio, side="right")) / (len(self.ratios) + 1)

    def p_not_above(self, bound: float) -> float:
        """p-value of a true mean of `bound` or less."""
        ratio = (self.mean - bound) / self.standard_error
        above = len(self.ratios) - np.searchsorted(self.ratios, ratio, side="left")
        return float(1 + above) / (len(self.ratios) + 1)
