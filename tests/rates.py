"""What the statistical tests share: is a simulated count what a rate gives?

The interval is the 99.99 % binomial one: a right implementation fails one such check in 10 000 seeds, and
the seeds are fixed.
"""

from __future__ import annotations

from scipy import stats

ALPHA = 0.05


def agrees(count: int, trials: int, rate: float) -> bool:
    """The count is within the interval of the rate."""
    low, high = stats.binom.interval(0.9999, trials, rate)
    return bool(low <= count <= high)


def highest(trials: int, rate: float) -> float:
    """The largest count that a rate of `rate` or less gives."""
    return float(stats.binom.ppf(0.9999, trials, rate))


def lowest(trials: int, rate: float) -> float:
    """The smallest count that a rate of `rate` or more gives."""
    return float(stats.binom.ppf(0.0001, trials, rate))
