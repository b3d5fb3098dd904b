"""Two samples that cannot be paired by seed, such as those of a user's own trajectory.

Pairing, where it is possible, needs far fewer samples: `equivalence.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats


class Unpaired(NamedTuple):
    """The largest distance between two empirical distributions, and the p-value of "the same"."""

    distance: float
    p_different: float


def kolmogorov_smirnov(measured: ArrayLike, reference: ArrayLike) -> Unpaired:
    """Two-sample Kolmogorov-Smirnov test of one distribution.

    The values of a sample must be independent: one number per seed.  Impacts of one run are not (the same
    particles, the same surface), and the p-value of pooled impacts is too small, the more so the longer the
    runs; for those, compare one summary per seed.  A large p-value is no sign of equivalence.

    Parameters: measured (n,) and reference (m,), in one unit.
    Raises ValueError for an empty sample or values that are not finite.
    """
    samples = [np.asarray(values, dtype=float) for values in (measured, reference)]
    for sample in samples:
        if sample.ndim != 1 or sample.size == 0 or not np.isfinite(sample).all():
            raise ValueError(f"a sample of shape {sample.shape}; allowed: one or more finite values")
    result = stats.ks_2samp(*samples)
    return Unpaired(float(result.statistic), float(result.pvalue))
