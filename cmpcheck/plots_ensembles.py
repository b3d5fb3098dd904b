"""Figures of part 3: means of two engines with their bands, and the paired difference beside the margin."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from cmpcheck.display import printable, scale, words
from cmpcheck.results import EnsembleCurve, MeanCurve
from cmpcheck.svg import COLOURS, INK, styled, svg_text

HEIGHTS = (1.7, 1.0)  # of the two panels
# Told apart without colour: the reference full and shaded, the other engine dashed between dotted limits
_OURS: dict[str, Any] = {"color": COLOURS[0], "linewidth": 1.6}
_THEIRS: dict[str, Any] = {"color": COLOURS[1], "linewidth": 1.4, "linestyle": (0, (4, 2))}
_LIMITS: dict[str, Any] = {"color": COLOURS[1], "linewidth": 0.9, "linestyle": (0, (1, 1.5))}
_DIFFERENCE: dict[str, Any] = {"color": INK, "linewidth": 1.4}
_MARGIN: dict[str, Any] = {"color": INK, "linewidth": 0.9, "linestyle": (0, (6, 3))}


def ensemble_figure(curve: EnsembleCurve, engine: str, key: str) -> str:
    """Two panels over time: both engines' means with 95 % bands; their paired difference, its margin dashed.

    `engine` names the other engine in the legend; `key` makes the ids of the SVG unique in its page.
    Returns the `<svg>` element.
    """
    with styled() as (figure, upper):
        figure.set_figheight(4.1)
        grid = figure.add_gridspec(2, 1, height_ratios=HEIGHTS)
        upper.set_subplotspec(grid[0])
        lower = figure.add_subplot(grid[1], sharex=upper)
        time_factor, time_unit = scale(max(curve.times), "s")
        factor, unit = scale(float(np.max(np.abs(curve.reference.mean))), curve.unit)
        times = np.asarray(curve.times) * time_factor
        _shade(upper, times, curve.reference, factor, COLOURS[0])
        upper.plot(times, _scaled(curve.reference.mean, factor), **_OURS)
        for limit in (curve.measured.lower, curve.measured.upper):
            upper.plot(times, _scaled(limit, factor), **_LIMITS)
        upper.plot(times, _scaled(curve.measured.mean, factor), **_THEIRS)
        upper.set_ylabel(_label(words(curve.quantity), unit))
        upper.tick_params(labelbottom=False)
        _draw_difference(lower, curve, times)
        lower.set_xlabel(f"time ({time_unit})")
        lower.set_xlim(times[0], times[-1])
        for axis in (upper.yaxis, lower.yaxis, lower.xaxis):
            axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        handles = [
            (Line2D([], [], **_OURS), "reference"),
            (Patch(facecolor=COLOURS[0], alpha=0.22), "95 % band"),
            (Line2D([], [], **_THEIRS), printable(engine)[:20]),
            (Line2D([], [], **_LIMITS), "95 % band"),
        ]
        figure.legend(*zip(*handles, strict=True), loc="outside upper left", ncols=4)
        return svg_text(figure, key)


def _draw_difference(axes: Axes, curve: EnsembleCurve, times: np.ndarray) -> None:
    """The difference in its own unit, on a scale that holds the margin."""
    largest = max(curve.margin, *map(abs, (*curve.difference.lower, *curve.difference.upper)))
    factor, unit = scale(largest, curve.unit)
    _shade(axes, times, curve.difference, factor, INK)
    axes.plot(times, _scaled(curve.difference.mean, factor), **_DIFFERENCE)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    for side in (-1.0, 1.0):
        axes.axhline(side * curve.margin * factor, **_MARGIN)
    axes.set_ylim(-1.25 * largest * factor, 1.25 * largest * factor)
    axes.text(times[0], curve.margin * factor, " margin", fontsize=8, va="bottom", ha="left")
    axes.set_ylabel(_label("difference", unit))


def _shade(axes: Axes, times: np.ndarray, curve: MeanCurve, factor: float, colour: str) -> None:
    lower, upper = _scaled(curve.lower, factor), _scaled(curve.upper, factor)
    axes.fill_between(times, lower, upper, color=colour, alpha=0.22, linewidth=0)


def _scaled(values: tuple[float, ...], factor: float) -> np.ndarray:
    return np.asarray(values) * factor


def _label(text: str, unit: str) -> str:
    return f"{text} ({unit})" if unit else text
