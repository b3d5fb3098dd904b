"""Confidence bands of curves over an ensemble, such as the flatness over time; drawing is `plots.py`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats


class Band(NamedTuple):
    """The mean curve and its limits, (T,) each, in the unit of the curves."""

    mean: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


def mean_band(curves: ArrayLike, confidence: float = 0.95) -> Band:
    """The mean of n curves and, point by point, Student's interval of it.

    Each point is covered with the given confidence, not the whole curve at once.  Student's t takes the n
    curves for independent and nearly normal; a bounded quantity may get limits outside its bounds.

    Parameters: curves (n, T), one row per seed.  Confidence 0.9 draws the interval that is held against a
    margin at alpha = 0.05.
    Raises ValueError for fewer than two curves.
    """
    values = np.asarray(curves, dtype=float)
    if values.ndim != 2 or len(values) < 2:
        raise ValueError(f"curves of shape {values.shape}; allowed: (n, T), two or more curves")
    if not 0 < confidence < 1:
        raise ValueError(f"confidence {confidence}; allowed: between 0 and 1")
    n = len(values)
    mean = values.mean(axis=0)
    half = stats.t.ppf(0.5 + 0.5 * confidence, n - 1) * values.std(axis=0, ddof=1) / np.sqrt(n)
    return Band(mean, mean - half, mean + half)


def difference_band(measured: ArrayLike, reference: ArrayLike, confidence: float = 0.9) -> Band:
    """The band of measured minus reference, seed by seed; by default the one to hold against a margin.

    Parameters: measured, reference (n, T), row k of both from the same initial state.
    Raises ValueError for fewer than two curves or shapes that differ.
    """
    a, b = np.asarray(measured, dtype=float), np.asarray(reference, dtype=float)
    if a.shape != b.shape:
        raise ValueError(f"measured of shape {a.shape} and reference of shape {b.shape} are no pairs")
    return mean_band(a - b, confidence)
