"""One row of the components: a value, what it has to be, and within what."""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.results import COMPONENTS, Comparison

CASE = COMPONENTS
EPS = float(np.finfo(float).eps)
ROUNDING = 1000 * EPS  # of the largest magnitude: chains of some hundred operations, and quadrature to 1e-13


def row(
    quantity: str,
    equations: str,
    measured: float,
    expected: float,
    tolerance: float,
    reason: str,
    unit: str = "1",
    kind: str = "rounding",
    variant: str = "",
) -> Comparison:
    """A comparison with an exact value; what is not a number disagrees."""
    error = abs(measured - expected)
    return Comparison(
        case=CASE, variant=variant, engine="reference", quantity=quantity, equations=equations, unit=unit,
        reference=expected, measured=measured, error=error, tolerance=tolerance, kind=kind, reason=reason,
        status="agree" if error <= tolerance else "disagree",
    )  # fmt: skip


def worst(
    quantity: str, equations: str, measured: np.ndarray, expected: np.ndarray, unit: str = "1",
    relative: float = ROUNDING, reason: str = "rounding, 1000 eps", variant: str = "",
) -> Comparison:  # fmt: skip
    """The worst of several values, each within `relative` of the largest expected one."""
    measured, expected = np.ravel(measured), np.ravel(expected)
    excess = np.abs(measured - expected)
    k = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    return row(
        quantity, equations, float(measured[k]), float(expected[k]), relative * float(np.abs(expected).max()),
        reason, unit, variant=variant,
    )  # fmt: skip


def count(
    quantity: str, equations: str, measured: float, expected: float, reason: str, variant: str = ""
) -> Comparison:
    """A number of things."""
    return row(
        quantity, equations, float(measured), float(expected), 0.5, f"a count; {reason}", variant=variant
    )


def failed(part: str, problem: Exception) -> Comparison:
    """A part that could not be checked."""
    nan, text = math.nan, " ".join(f"{type(problem).__name__}: {problem}".split())
    return Comparison(CASE, part, "reference", "run", "", "1", nan, nan, nan, nan, "precision", text, "error")
