"""The shape of a flatness curve in the words of the paper's Section 4 about Fig. 6, computed from the curve.

Unchanged at first, a nearly linear fall, levelling off, and possibly a rise by scratching.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

UNCHANGED = 0.01  # Pi has changed when it differs by more from its first value
FALL = (0.1, 0.9)  # the parts of the whole drop between which the fall is judged
LINEAR = 0.98  # R^2 from which a fall is called nearly linear
LEVEL = 0.2  # of the fall's slope: flatter is levelled off
WINDOW = 0.1  # of the time: over which the slope near the end is taken
SCRATCH = 0.001  # a smaller rise is not called one


@dataclass(frozen=True)
class Shape:
    """What a curve does; times in the unit of its times."""

    unchanged_until: float
    fall_from: float
    fall_to: float
    slope: float  # of the line through the fall, per unit of time, negative
    r_squared: float
    level_from: float | None  # None: it has not levelled off at the end
    rise: float  # the largest one above an earlier value
    rise_at: float  # where it ends

    def words(self, unit: str) -> str:
        """A sentence in the paper's words."""
        linear = "nearly linear" if self.r_squared >= LINEAR else "not linear"
        level = (
            f"it levels off from t = {self.level_from:.3g} {unit} on"
            if self.level_from is not None
            else "it has not levelled off at the end"
        )
        scratch = (
            f"it rises again by scratching, at most by {self.rise:.2g} at t = {self.rise_at:.3g} {unit}"
            if self.rise > SCRATCH
            else f"no scratch raises it (by {self.rise:.1g} at most)"
        )
        return (
            f"Π is unchanged until t = {self.unchanged_until:.3g} {unit}; its fall between "
            f"{self.fall_from:.3g} and {self.fall_to:.3g} {unit} is {linear}, with a slope of "
            f"{self.slope:.3g} per {unit} (R² = {self.r_squared:.3f}); {level}; {scratch}."
        ).replace("-", "−")


def shape_of(times: ArrayLike, flatness: ArrayLike) -> Shape:
    """The shape of a curve Pi(t), (T,) each.

    The fall is where the curve makes the middle 80 % of its whole drop.  It has levelled off from where on
    the mean slope of every tenth of the time is below a fifth of the fall's.
    Raises ValueError where Pi does not fall by more than 2 %.
    """
    t, pi = np.asarray(times, dtype=float), np.asarray(flatness, dtype=float)
    drop = pi[0] - pi.min()
    if drop <= 2 * UNCHANGED:
        raise ValueError(f"flatness falls by {drop:.2g}; allowed: a fall of more than {2 * UNCHANGED:g}")
    changed = int(np.argmax(np.abs(pi - pi[0]) > UNCHANGED))
    first, last = (int(np.argmax(pi <= pi[0] - part * drop)) for part in FALL)
    last = max(last, first + 2)
    line = stats.linregress(t[first : last + 1], pi[first : last + 1])
    lowest = np.minimum.accumulate(pi)
    top = int((pi - lowest).argmax())
    return Shape(
        unchanged_until=float(t[changed - 1]),
        fall_from=float(t[first]),
        fall_to=float(t[last]),
        slope=float(line.slope),
        r_squared=float(line.rvalue**2),
        level_from=_level_from(t, pi, float(line.slope), first),
        rise=float((pi - lowest)[top]),
        rise_at=float(t[top]),
    )


def _level_from(t: np.ndarray, pi: np.ndarray, slope: float, first: int) -> float | None:
    """The earliest time from which on every window is flat against the fall; None if the last one is not."""
    width = WINDOW * (t[-1] - t[0])
    found = None
    for k in range(len(t) - 1, first, -1):
        if t[-1] - t[k] < width * (1 - 1e-9):
            continue
        end = int(np.searchsorted(t, t[k] + width * (1 - 1e-9)))
        if abs((pi[end] - pi[k]) / (t[end] - t[k])) > LEVEL * abs(slope):
            break
        found = float(t[k])
    return found
