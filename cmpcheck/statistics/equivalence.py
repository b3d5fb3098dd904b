"""Whether paired differences are within a margin fixed beforehand, beyond it, or neither can be said.

One quantity at a time; several together are `families.py`, how many pairs are needed is `power.py`.

Sources: D. J. Schuirmann, J. Pharmacokinet. Biopharm. 15 (1987) 657 (two one-sided tests); D. Lakens,
Soc. Psychol. Personal. Sci. 8 (2017) 355 (read together with a test of no difference).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from cmpcheck.statistics.power import sample_size
from cmpcheck.statistics.resampling import StudentizedMean, sign_flip_p

STATUS = {"equivalent": "agree", "different": "disagree", "inconclusive": "not_tested"}


@dataclass(frozen=True)
class Equivalence:
    """What n paired differences say about a margin; mean, error, interval and margin in one unit.

    equivalent: the interval lies within the margin, so each of two one-sided tests of level alpha rejects.
    A difference from zero that is resolved as well (p_adjusted <= alpha) does not change this; the reason
    says so.
    different: the interval lies beyond the margin on one side, and the difference from zero is resolved.
    inconclusive: neither.
    """

    mean: float
    standard_error: float
    interval: tuple[float, float]  # of confidence 1 - 2 alpha
    p_different: float  # of a mean of zero, two-sided, by sign flips
    p_equivalent: float  # of a mean at or beyond the margin: the larger of two one-sided tests
    verdict: str  # equivalent | different | inconclusive
    n: int
    margin: float
    alpha: float
    p_adjusted: float  # p_different, adjusted for the other quantities of its family if it has one

    @property
    def status(self) -> str:
        """The verdict as the status of a comparison: agree, disagree or not_tested."""
        return STATUS[self.verdict]

    @property
    def resolved(self) -> bool:
        """A difference from zero has been found, of whatever size."""
        return self.p_adjusted <= self.alpha

    @property
    def reason(self) -> str:
        """Why the verdict is what it is; made when it is read, as missing pairs take a search."""
        return _reason(self)

    def in_family(self, p_adjusted: float) -> Equivalence:
        """The same evidence, judged with a p-value that allows for the rest of its family."""
        return _judged(replace(self, p_adjusted=p_adjusted))


def paired_difference(
    differences: ArrayLike, margin: float, alpha: float = 0.05, seed: int = 0, resamples: int = 9999
) -> Equivalence:
    """Judge differences of one observable, measured minus reference, against a margin fixed beforehand.

    Differences that are all equal have no spread to resample; the verdict is then on their value, and the
    reason states how many pairs could still be otherwise.

    Parameters: differences (n,), one per seed, and margin > 0, in one unit; alpha, the level of each
    one-sided test; seed and resamples of sign flips and bootstrap: the same seed gives the same result.
    Raises ValueError for fewer than two pairs, a value that is not finite, or a margin or alpha that makes no
    sense.

    >>> paired_difference([0.001, -0.002, 0.003, 0.0, -0.001, 0.002, 0.001, -0.003], margin=0.02).verdict
    'equivalent'
    """
    d = np.sort(np.asarray(differences, dtype=float))  # sorted: the order of the pairs must not matter
    if d.ndim != 1 or len(d) < 2:
        raise ValueError(f"differences of shape {d.shape}; allowed: one-dimensional, two or more pairs")
    if not np.isfinite(d).all():
        raise ValueError("differences must be finite")
    if not (margin > 0 and math.isfinite(margin)):
        raise ValueError(f"margin {margin}; allowed: positive and finite")
    if not 0 < alpha < 0.5:
        raise ValueError(f"alpha {alpha}; allowed: between 0 and 0.5")
    flips, draws = np.random.default_rng(seed).spawn(2)
    p_different = sign_flip_p(d, flips, resamples)
    if d[0] == d[-1]:
        mean, error, interval = float(d[0]), 0.0, (float(d[0]), float(d[0]))
        p_equivalent = 0.0 if abs(mean) < margin else 1.0
    else:
        bootstrap = StudentizedMean.of(d, draws, resamples)
        mean, error, interval = bootstrap.mean, bootstrap.standard_error, bootstrap.interval(alpha)
        p_equivalent = max(bootstrap.p_not_below(margin), bootstrap.p_not_above(-margin))
    return _judged(
        Equivalence(mean, error, interval, p_different, p_equivalent, "", len(d), margin, alpha, p_different)
    )


def relative_differences(measured: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Paired differences in units of the reference's mean, for margins such as 5 % of a count.

    The mean is taken as given: a standard error of 3 % of it makes a margin of 5 % one of 4.85 to 5.15 %.

    Parameters: measured, reference (n,), in one unit, paired by seed.
    Raises ValueError for other shapes, or a reference whose mean is zero.

    >>> relative_differences([11, 20], [9, 21])
    array([ 0.13333333, -0.06666667])
    """
    a, b = np.asarray(measured, dtype=float), np.asarray(reference, dtype=float)
    if a.shape != b.shape or a.ndim != 1 or a.size == 0:
        raise ValueError(f"measured of shape {a.shape} and reference of shape {b.shape} are no pairs")
    if b.mean() == 0:
        raise ValueError("the reference's mean is zero: nothing to be relative to")
    return (a - b) / abs(b.mean())


def _judged(evidence: Equivalence) -> Equivalence:
    """The evidence with its verdict."""
    within, beyond = _against_margin(evidence)
    different = beyond and evidence.resolved
    verdict = "equivalent" if within else "different" if different else "inconclusive"
    return replace(evidence, verdict=verdict)


def _against_margin(evidence: Equivalence) -> tuple[bool, bool]:
    """Whether the interval lies within the margin, and whether it lies beyond it on one side."""
    (low, high), limit = evidence.interval, evidence.margin
    return -limit < low and high < limit, low > limit or high < -limit


def _reason(evidence: Equivalence) -> str:
    """What the verdict rests on, in a sentence."""
    (low, high), limit = evidence.interval, evidence.margin
    shown = f"{100 * (1 - 2 * evidence.alpha):g} % interval [{low:.3g}, {high:.3g}]"
    margin, n, p = f"the margin of {limit:.3g}", f"n = {evidence.n}", f"p = {evidence.p_adjusted:.2g}"
    _, beyond = _against_margin(evidence)
    if evidence.verdict == "equivalent":
        reason = f"{shown} lies within {margin}, {n}"
        if evidence.resolved:
            reason += f"; a difference smaller than the margin was resolved ({p})"
    elif evidence.verdict == "different":
        reason = f"{shown} lies beyond {margin}, {n}, {p}"
    elif beyond:
        reason = f"inconclusive, {n}: {shown} lies beyond {margin}, but n is too small for the test ({p})"
    else:
        reason = f"inconclusive, {n}: {shown} reaches across {margin}; {_remedy(evidence)}"
        if evidence.resolved:
            reason += f"; a difference was resolved ({p}), not whether it exceeds the margin"
    if low == high:
        others = 1 - evidence.alpha ** (1 / evidence.n)
        reason += f"; all differences are equal: fewer than {100 * others:.2g} % of all pairs are otherwise"
        reason += f" ({100 * (1 - evidence.alpha):g} % sure)"
    return reason


def _remedy(evidence: Equivalence) -> str:
    """What would have settled it."""
    spread = evidence.standard_error * math.sqrt(evidence.n)
    needed = sample_size(spread, evidence.margin, alpha=evidence.alpha)
    if needed > evidence.n:
        return f"without a true difference, n = {needed} would settle it with a power of 90 %"
    return "the difference is too close to the margin for this n"
