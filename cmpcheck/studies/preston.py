"""Preston's law: how the removal rate depends on the pad's speed, the number of abrasives and the load.

The law is the paper's Eq. (1), MRR = K_e P V; which exponents the model has is measured here.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from cmpcheck.results import Chart, Column, Curve, Estimate, StudyResult, Table
from cmpcheck.studies.sampling import CONFIDENCE, HELD, estimate, half_width, held, sample_rows
from reference import simulate
from reference.case import Case, load_case
from reference.process import PAD_DESCENT

CASE = "polish_pair"
SAMPLES = {"quick": 4, "full": 12}
SPEEDS = (0.25, 0.5, 1.0, 2.0)  # V_pad, m/s
COUNTS = (10, 14, 20, 28)  # N
HEIGHTS = (1.05e-6, 1.15e-6, 1.25e-6, 1.35e-6)  # H, m
SPEED, COUNT, HEIGHT = 1.0, 20, 1.2e-6  # where the others are held
WAY = 150e-6  # V_pad T, m
MATCHED = 0.8  # Pi at which rates are compared
GAMMA = 0.005


class Fit(NamedTuple):
    """An exponent of a power law, with half of its 95 % confidence interval."""

    exponent: Estimate
    half_width: float


def exponents(logs: np.ndarray, response: np.ndarray) -> list[Fit]:
    """Exponents b_j of y = c x_1^b_1 x_2^b_2 ..., by least squares in logarithms, sample by sample.

    All samples have the same levels, so that a line fitted to each gives independent exponents; their mean
    is the least-squares fit with a constant for each sample, and their spread gives Student's interval.

    Parameters: logs (levels, predictors) or (samples, levels, predictors), natural logarithms of x;
    response (samples, levels), y > 0.
    Raises ValueError where y is not positive, or for fewer than two samples.
    """
    if not (response > 0).all():
        raise ValueError("a rate is zero in some sample; allowed: rates > 0, that is longer runs")
    n = len(response)
    logs = np.broadcast_to(logs, (n, *logs.shape[-2:]))
    design = np.concatenate([np.ones((*logs.shape[:2], 1)), logs], axis=2)
    slopes = np.array(
        [np.linalg.lstsq(x, np.log(y), rcond=None)[0][1:] for x, y in zip(design, response, strict=True)]
    )
    found = [estimate(column) for column in slopes.T]
    return [Fit(slope, half_width(slope, n)) for slope in found]


def rate_at_equal_flatness(case: Case) -> pd.Series:
    """Removal until flatness has fallen to 0.8, per time: caps (m3/s), node depths (m/s), pad load (Pa).

    The load is the sum of the pad's impulses per time and area, its work divided by its descent.
    Raises ValueError where the run is too short.
    """
    run = simulate(case)
    history, descent = run.history, HELD / (PAD_DESCENT * case.case.duration)
    below = np.flatnonzero(history.flatness.to_numpy() <= MATCHED)
    if not below.size or history.time[below[0]] > PAD_DESCENT * case.case.duration:
        raise ValueError(f"{case.variant}: flatness {MATCHED:g} is not reached in {case.case.duration:g} s")
    k = int(below[0])
    part = (history.flatness[k - 1] - MATCHED) / (history.flatness[k - 1] - history.flatness[k])
    row = history.iloc[k - 1] + part * (history.iloc[k] - history.iloc[k - 1])
    area = case.surface.size**2
    return pd.Series(
        {
            "time": row.time,
            "volume_rate": row.removed_volume / row.time,
            "depth_rate": row.depth_sum / row.time,
            "load": row.pad_work / (descent * row.time * area),
        }
    )
