"""Charts of studies as SVG text: curves with bands or error bars over any axis; no page layout.

Curves over time and convergence of single runs are `plots.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from cmpcheck.display import number, printable, scale
from cmpcheck.plots import MARKERS
from cmpcheck.results import Chart, Column
from cmpcheck.svg import COLOURS, styled, svg_text

ROW_HEIGHT = 0.17  # inches of a row of the legend
TICKS = 7  # at most so many values of a logarithmic axis are labelled
DECADES = 3.0  # of a logarithmic axis, beyond which only powers of ten have room for a label


def chart_figure(chart: Chart, key: str) -> str:
    """The chart as an `<svg>` element; `key` makes its ids unique in the page.

    A curve that has `lower` and `upper` gets a band if it is a line, and error bars if it is points.
    """
    with styled() as (figure, axes):
        x_factor, x_unit = _scale(chart.x, (x for curve in chart.curves for x in curve.x))
        y_factor, y_unit = _scale(chart.y, (y for curve in chart.curves for y in curve.y))
        for k, curve in enumerate(chart.curves):
            x, y = np.asarray(curve.x) * x_factor, np.asarray(curve.y) * y_factor
            low, high = (np.asarray(limit) * y_factor for limit in (curve.lower, curve.upper))
            colour = COLOURS[k % len(COLOURS)]
            if curve.style == "points":
                bars = [y - low, high - y] if low.size else None
                axes.errorbar(
                    x, y, bars, color=colour, marker=MARKERS[k % len(MARKERS)], markersize=4.5,
                    linestyle="none", elinewidth=1.0, capsize=2.5, label=printable(curve.label),
                )  # fmt: skip
                continue
            if low.size:
                axes.fill_between(x, low, high, color=colour, alpha=0.25, linewidth=0)
            axes.plot(x, y, color=colour, linewidth=1.5, label=printable(curve.label))
        if chart.logarithmic:
            axes.set_xscale("log")
            axes.set_yscale("log")
            _label_values(axes.xaxis, np.concatenate([np.asarray(c.x) for c in chart.curves]) * x_factor)
            bottom, top = axes.get_ylim()
            few = math.log10(top / bottom) > DECADES
            axes.yaxis.set_major_locator(LogLocator(10, subs=(1.0,) if few else (1.0, 2.0, 5.0)))
            axes.yaxis.set_minor_locator(NullLocator())
            axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
        else:
            axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
            axes.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
        axes.set_xlabel(_axis_label(chart.x, x_unit))
        axes.set_ylabel(_axis_label(chart.y, y_unit))
        if len(chart.curves) > 1:
            longest = max(len(curve.label) for curve in chart.curves)
            columns = max(1, min(3, 54 // (longest + 7), len(chart.curves)))
            figure.set_figheight(2.55 + ROW_HEIGHT * math.ceil(len(chart.curves) / columns))
            figure.legend(loc="outside upper left", ncols=columns)
        return svg_text(figure, key)


def _scale(column: Column, values: Iterable[float]) -> tuple[float, str]:
    return scale(max((abs(v) for v in values if math.isfinite(v)), default=0.0), column.unit)


def _axis_label(column: Column, unit: str) -> str:
    return printable(f"{column.name} ({unit})" if unit else column.name)


def _label_values(axis, values: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """Ticks at the values themselves, as many as have room."""
    shown: list[float] = []
    room = math.log(values.max() / values.min()) / TICKS if values.max() > values.min() else 0.0
    for value in np.unique(values):
        if not shown or math.log(value / shown[-1]) > room:
            shown.append(float(value))
    axis.set_major_locator(FixedLocator(shown))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
