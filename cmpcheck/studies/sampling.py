"""What every study does alike: change a case, run its samples, and put means beside their standard errors.

Samples are paired: sample k of a changed case has the seed of sample k of the case itself, so that
differences and slopes are taken sample by sample, and their spread over the samples is their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from cmpcheck.display import uncertain
from cmpcheck.results import Estimate
from reference import simulate
from reference.case import Case
from reference.ensemble import run_samples
from reference.process import build_setup, pressed_speed

CONFIDENCE = 0.95
FINE_GAMMA = 0.001  # of polish_pair: 0.9 ns, at which 2 U dt/tau is a fifth of its threshold
CONVERGED, DIFFERENT, UNDECIDED = "converged", "different", "not decided"


def changed(case: Case, /, **sections: Mapping[str, Any]) -> Case:
    """The case with keys of its sections replaced.

    Raises CaseError where the result is not a valid case.
    """
    return case.replaced(sections)


def held(case: Case, pad_height: float, /, **sections: Mapping[str, Any]) -> Case:
    """The case with its pad at a constant height H (m), and keys of other sections replaced."""
    pad = {"initial_height": pad_height, "minimum_height": pad_height}
    return changed(case, **{**sections, "pad": pad | dict(sections.get("pad", {}))})


def step_text(case: Case, plain: Case) -> str:
    """Why a case takes other steps than the plain one, in words."""
    setups = [build_setup(each) for each in (case, plain)]
    (dt, struck), (own, hard) = ((1e9 * s.time_step, pressed_speed(s, s.time_step)) for s in setups)
    return (
        f"γ = {case.numerics.gamma:g}, steps of {dt:.2g} ns: a particle pressed on the surface is struck at "
        f"2 U Δt/τ = {struck:.2g} m/s, below the threshold; at the case's own {own:.2g} ns at {hard:.2g} m/s."
    )


def final_row(case: Case) -> pd.Series:
    """The history of a run at its end."""
    return simulate(case).history.iloc[-1]


def sample_rows(case: Case, samples: int, observe: Callable[[Case], pd.Series] = final_row) -> pd.DataFrame:
    """What `observe` (a case to a series) finds in samples 0 ... samples - 1, a row each."""
    return pd.DataFrame(run_samples(case, range(samples), observe)).reset_index(drop=True)


def estimate(values: ArrayLike) -> Estimate:
    """Mean and standard error of one number per sample.

    Raises ValueError for fewer than two samples.

    >>> estimate([1.0, 3.0])
    Estimate(value=2.0, standard_error=1.0)
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 1 or len(array) < 2:
        raise ValueError(f"values of shape {array.shape}; allowed: (n,), two samples or more")
    return Estimate(float(array.mean()), float(stats.sem(array)))


def half_width(found: Estimate, samples: int, among: int = 1) -> float:
    """Half of Student's 95 % confidence interval of a mean, or of `among` means at once (Bonferroni)."""
    return float(stats.t.isf(0.5 * (1.0 - CONFIDENCE) / among, samples - 1)) * found.standard_error


def standing(changes: Sequence[Estimate], samples: int, limit: float) -> str:
    """Whether changes are within a limit, beyond it, or neither is known, by Student's one-sided bounds.

    converged: each |d| + t SE <= limit, t at 95 %.  different: some |d| - t SE > limit, where the 5 % are
    shared among the changes, since one of them is enough.  Else not decided: noise is no convergence.

    >>> [standing([Estimate(d, e)], 4, 0.01) for d, e in ((0.0, 0.001), (0.0, 0.1), (0.02, 0.001))]
    ['converged', 'not decided', 'different']
    """
    t, t_any = stats.t.isf([1.0 - CONFIDENCE, (1.0 - CONFIDENCE) / len(changes)], samples - 1)
    if all(abs(d) + t * error <= limit for d, error in changes):
        return CONVERGED
    return DIFFERENT if any(abs(d) - t_any * error > limit for d, error in changes) else UNDECIDED


def clear(found: Estimate, samples: int, among: int = 1) -> bool:
    """Whether the 95 % interval of a mean, or of one `among` several, leaves out zero."""
    return abs(found.value) > half_width(found, samples, among)


def interval_text(found: Estimate, samples: int) -> str:
    """A mean and half of its 95 % interval."""
    return uncertain(found.value, half_width(found, samples))


def samples_of(case: Case, samples: int) -> str:
    """Which samples were run, in words."""
    return f"Samples 0 to {samples - 1} of {case.name}, seed {case.case.seed}."


@dataclass(frozen=True)
class Power:
    """An exponent of a power law, with its 95 % confidence interval."""

    exponent: Estimate
    half_width: float

    @property
    def interval(self) -> tuple[float, float]:
        """Both ends of the interval."""
        return self.exponent.value - self.half_width, self.exponent.value + self.half_width

    def holds(self, value: float) -> bool:
        """Whether the interval holds a value."""
        return abs(self.exponent.value - value) <= self.half_width

    def text(self) -> str:
        """The exponent and half of its interval."""
        return uncertain(self.exponent.value, self.half_width)


def powers(predictors: Sequence[ArrayLike], responses: ArrayLike) -> list[Power]:
    """Exponents b_j of y = c x_1^b_1 x_2^b_2 ..., by least squares in logarithms, sample by sample.

    All samples have the same levels, so that the fit to each is an independent estimate of the exponents;
    the mean of the estimates is the least-squares fit with a constant for each sample, and their spread over
    the samples gives Student's interval, whatever the levels of one sample have in common.

    Parameters: predictors, one (levels,) each, x > 0; responses (levels, samples), y > 0.
    Raises ValueError where a response is not positive, or for fewer than two samples.

    >>> [round(p.exponent.value, 12) for p in powers([[1, 2, 4]], [[3, 5], [6, 10], [12, 20]])]
    [1.0]
    """
    y = np.asarray(responses, dtype=float)
    if not (y > 0).all():
        raise ValueError("a response is zero or negative in some sample; allowed: > 0, that is longer runs")
    design = np.column_stack([np.ones(len(y)), *(np.log(np.asarray(x, float)) for x in predictors)])
    slopes = np.linalg.lstsq(design, np.log(y), rcond=None)[0][1:]
    found = [estimate(row) for row in slopes]
    return [Power(slope, half_width(slope, y.shape[1])) for slope in found]


def power(predictor: ArrayLike, responses: ArrayLike) -> Power:
    """The exponent of y = c x^b; see `powers`."""
    return powers([predictor], responses)[0]
