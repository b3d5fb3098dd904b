"""Observed order of convergence, the value that a sequence of levels tends to, and how uncertain it is.

Works on plain numbers: a quantity at successively refined levels (time steps, contact durations).  What the
quantity is, and which runs it came from, is `compare.py`'s business.

Sources: P. J. Roache, *Verification and Validation in Computational Science and Engineering*, 1998 (the grid
convergence index and its safety factors 1.25 and 3); I. B. Celik et al., J. Fluids Eng. 130 (2008) 078001
(levels refined by unequal ratios); L. Eca and M. Hoekstra, J. Comput. Phys. 262 (2014) 104 (orders below half
the formal one are not trusted).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

SAFETY_CREDIBLE = 1.25
SAFETY_OTHERWISE = 3.0
# Sums of up to about a thousand terms, each rounded by half a unit and all in the same direction.
ROUNDING = 1000 * float(np.finfo(float).eps)
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Extrapolation:
    """What a sequence of levels tends to: the true value is meant to lie within value +- uncertainty."""

    value: float
    uncertainty: float  # never 0
    order: float | None  # observed; None where it cannot be observed
    credible: bool  # the order is observed and believed, or there was nothing to extrapolate
    reason: str  # how the uncertainty was derived
    remedy: str = ""  # what would narrow it
    correction: float = 0.0  # value minus the value on the finest level


class Agreement(NamedTuple):
    """The verdict on two values; error and tolerance in their unit."""

    error: float
    tolerance: float
    status: str  # agree | disagree | not_tested | error
    reason: str


def exact(value: float, scale: float | None = None, reason: str = "closed form") -> Extrapolation:
    """A value known up to rounding.

    Parameters: scale, the largest magnitude that entered it (default the value itself).
    """
    size = abs(value) if scale is None else max(abs(value), abs(scale))
    return Extrapolation(value, max(ROUNDING * size, TINY), None, True, f"{reason}, rounding 1000 eps")


def phase_error(spread: float, phases: int) -> float:
    """Bound on the error of a mean over equally spaced sub-step phases.

    A function g of the phase with one rise and one fall per period has the variation 2 R, R its range.  About
    each of the n samples, g departs from the sample by at most its variation within half a cell, so the mean
    of the samples is within 2 R/(2 n) = R/n of the mean over all phases.  The samples of a sawtooth miss one
    cell's share of R, hence n - 1.  (Independent random phases: a standard error of R/sqrt(12 n) instead.)

    Parameters: spread, half the range of the samples; phases, their number n.

    >>> phase_error(1.5, 16)
    0.2
    """
    return 2 * spread / (phases - 1) if phases > 1 else 2 * spread


def credible_orders(formal_order: float) -> tuple[float, float]:
    """The lowest and highest observed order that is believed.

    Below half the formal order the levels are too coarse (Eca and Hoekstra).  A leading error term and the
    next, of order p + 1 and the same sign, show an order between p and p + 1; more needs terms that cancel,
    and then the finest difference may be small by accident.  0.1 is allowed for an order that is just p + 1.
    """
    return 0.5 * formal_order, formal_order + 1.1


def grid_convergence_index(fine: float, coarse: float, ratio: float, order: float, safety: float) -> float:
    """Uncertainty of the value on the finer of two levels, in its unit (Roache).

    >>> grid_convergence_index(1.0, 4.0, 2.0, 2.0, 3.0)
    3.0
    """
    return safety * abs(coarse - fine) / (ratio**order - 1)


def observed_order(levels: Sequence[float], values: Sequence[float]) -> float | None:
    """The p of f = f_0 + c h^p through three levels, finest first; None where there is none in (0, 50).

    >>> observed_order([1, 2, 4], [1 + 1, 1 + 4, 1 + 16])
    2.0
    """
    h1, h2, h3 = levels
    f1, f2, f3 = values
    d21, d32 = f2 - f1, f3 - f2
    if d21 * d32 <= 0:
        return None
    ratio = d32 / d21
    if math.isclose(h2 / h1, h3 / h2, rel_tol=1e-12):
        p = math.log(ratio) / math.log(h2 / h1)
        return p if 0 < p < 50 else None

    def excess(p: float) -> float:
        return math.log((h3**p - h2**p) / (h2**p - h1**p)) - math.log(ratio)

    h1, h2, h3 = 1.0, h2 / h1, h3 / h1
    if excess(1e-6) > 0 or excess(50.0) < 0:
        return None
    return float(brentq(excess, 1e-6, 50.0, xtol=1e-14))


def extrapolate(
    levels: Sequence[float],
    values: Sequence[float],
    formal_order: float,
    spreads: Sequence[float] | None = None,
    *,
    phases: int = 16,
    errors: Sequence[float] | None = None,
    scale: float | None = None,
) -> Extrapolation:
    """The limit h -> 0 by Richardson's extrapolation, with the grid convergence index as its uncertainty.

    With three levels and a credible order (`credible_orders`, wherever the true values lie within the errors
    of the single ones) the safety factor is 1.25 and the order the observed one.  Otherwise it is 3, the
    order the formal one, and the error estimate the largest that two neighbouring levels give: the finest two
    may agree by accident.  Errors of the single values are carried through the extrapolation and added.

    Parameters: levels h > 0 in any sequence, two or more, of which the finest three are used; values, one per
    level; spreads, half ranges over `phases` equally spaced sub-step phases; errors, other bounds on each
    value; scale, the largest magnitude that entered the values (default the largest value), for rounding.
    Raises ValueError for fewer than two distinct levels and for numbers that are not finite.
    """
    h, f, noise = _finest_levels(levels, values, spreads, errors, phases)
    size = max(*map(abs, f), abs(scale or 0.0))
    rounding = max(ROUNDING * size, TINY)
    noise = [e + rounding for e in noise]
    if max(f) - min(f) <= 2 * rounding:
        reason = "equal on all levels to rounding, 1000 eps" if size else "zero on all levels"
        remedy = "nothing: this is rounding"
        if max(noise) > 2 * rounding:
            reason, remedy = f"{reason}, and errors of the single values", "more sub-step phases"
        return Extrapolation(f[0], 2 * max(noise), None, True, reason, remedy)

    order = observed_order(h, f) if len(h) == 3 else None
    carried = _carried_error(h, f, noise, formal_order) if len(h) == 3 else None
    credible = order is not None and carried is not None
    if order is not None and carried is not None:
        index = grid_convergence_index(f[0], f[1], h[1], order, SAFETY_CREDIBLE)
        correction = (f[0] - f[1]) / (h[1] ** order - 1)
        reason = f"grid convergence index, safety factor 1.25, observed order {order:.2f} on three levels"
        remedy = "finer levels"
    else:
        slopes = [
            (f[k + 1] - f[k]) / (h[k + 1] ** formal_order - h[k] ** formal_order) for k in range(len(h) - 1)
        ]
        index = SAFETY_OTHERWISE * max(map(abs, slopes))
        correction = -slopes[0]
        weight = 1 / (h[1] ** formal_order - 1)
        why = _why_not_credible(f, order, formal_order)
        reason = f"grid convergence index, safety factor 3, formal order {formal_order:g}: {why}"
        remedy = "a third level or finer ones, with a credible order"
        carried = (1 + weight) * noise[0] + weight * noise[1]
    if carried > index:
        reason += ", and mostly errors of the single values (sub-step phases, rounding)"
        remedy = "more sub-step phases"
    return Extrapolation(f[0] + correction, index + carried, order, credible, reason, remedy, correction)


def add_corrections(first: Extrapolation, second: Extrapolation) -> Extrapolation:
    """The limit in two parameters that were refined one at a time from the same finest run.

    Corrections and uncertainties add; the order shown is the first one's.
    """
    worse = max(first, second, key=lambda part: part.uncertainty)
    return Extrapolation(
        first.value + second.correction,
        first.uncertainty + second.uncertainty,
        first.order,
        first.credible and second.credible,
        f"{first.reason}; and {second.reason}",
        worse.remedy,
        first.correction + second.correction,
    )


def agreement(
    reference: Extrapolation, measured: Extrapolation, scale: float, relative_limit: float = 0.01
) -> Agreement:
    """Whether two values agree within the sum of their uncertainties.

    A difference beyond both uncertainties is a disagreement however large they are; one within a tolerance
    wider than `relative_limit` of the scale is no test.

    Parameters: scale > 0, the magnitude that the tolerance is judged by, in the values' unit; relative_limit,
    0.01, and 0.03 for removed volume.
    """
    error = abs(measured.value - reference.value)
    tolerance = reference.uncertainty + measured.uncertainty
    if not (math.isfinite(error) and math.isfinite(tolerance)):
        return Agreement(error, tolerance, "error", "a value or its uncertainty is not finite")
    larger = max(reference, measured, key=lambda part: part.uncertainty)
    if error > tolerance:
        return Agreement(error, tolerance, "disagree", larger.reason)
    if not tolerance <= relative_limit * abs(scale):
        wide = f"{100 * tolerance / abs(scale):.2g} % of {abs(scale):.3g}" if scale else "without a scale"
        reason = f"too uncertain: tolerance {wide}, limit {100 * relative_limit:g} %; {larger.reason}"
        return Agreement(error, tolerance, "not_tested", f"{reason}; narrowed by {larger.remedy}")
    return Agreement(error, tolerance, "agree", larger.reason)


def _finest_levels(
    levels: Sequence[float],
    values: Sequence[float],
    spreads: Sequence[float] | None,
    errors: Sequence[float] | None,
    phases: int,
) -> tuple[list[float], list[float], list[float]]:
    """At most three levels relative to the finest, values and bounds on their errors, finest first."""
    none = [0.0] * len(values)
    columns = (levels, values, none if spreads is None else spreads, none if errors is None else errors)
    if len({len(column) for column in columns}) != 1:
        raise ValueError(f"levels, values, spreads, errors differ in length: {[len(c) for c in columns]}")
    rows = sorted(tuple(map(float, row)) for row in zip(*columns, strict=True))
    if not all(math.isfinite(x) for row in rows for x in row):
        raise ValueError(f"a level, value, spread or error is not finite: {rows}")
    if len(rows) < 2 or len({row[0] for row in rows}) < len(rows) or rows[0][0] <= 0:
        raise ValueError(f"two or more distinct positive levels are needed, not {list(levels)}")
    h, f, spread, error = zip(*rows[:3], strict=True)
    noise = [phase_error(abs(s), phases) + abs(e) for s, e in zip(spread, error, strict=True)]
    return [x / h[0] for x in h], list(f), noise


def _carried_error(h: list[float], f: list[float], noise: list[float], formal_order: float) -> float | None:
    """How far errors of three values shift the extrapolated one; None if the order may not be credible."""
    low, high = credible_orders(formal_order)
    limits = []
    for signs in itertools.product((0, -1, 1), repeat=3):
        shifted = [value + sign * e for value, sign, e in zip(f, signs, noise, strict=True)]
        order = observed_order(h, shifted)
        if order is None or not low <= order <= high:
            return None
        limits.append(shifted[0] + (shifted[0] - shifted[1]) / (h[1] ** order - 1))
    return max(abs(limit - limits[0]) for limit in limits)


def _why_not_credible(f: list[float], order: float | None, formal_order: float) -> str:
    if len(f) == 2:
        return "two levels"
    if (f[1] - f[0]) * (f[2] - f[1]) < 0:
        return "the values oscillate"
    low, high = credible_orders(formal_order)
    if order is not None and low <= order <= high:
        return "the levels differ by little more than the errors of the single values"
    return f"observed order {'none' if order is None else f'{order:.2f}'}, credible {low:g} to {high:g}"
