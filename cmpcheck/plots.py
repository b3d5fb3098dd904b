"""Figures of the report as SVG text: curves over time, and convergence in log-log scale.

What is drawn and how it is scaled and labelled; no page layout, no verdicts, and no SVG syntax (`svg.py`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from cmpcheck.display import number, printable, scale, superscript, words
from cmpcheck.results import Convergence, Trace
from cmpcheck.svg import COLOURS, INK, styled, svg_text

SERIES = len(COLOURS)  # a panel holds at most so many variants
CURVE_BUCKETS = 160  # a longer curve keeps its smallest and largest value in each bucket
IMPACTS_DRAWN = 400
ROUNDING = 64 * np.finfo(float).eps  # an error this small, relative to the value, is arithmetic

MARKERS = ("o", "s", "^", "D", "v", "P")
# By engine: the first curve is broad and pale, the next ones thin on top of it, so that both stay visible.
_LINES: tuple[dict[str, Any], ...] = (
    {"linewidth": 4.2, "alpha": 0.4, "linestyle": "-"},
    {"linewidth": 1.5, "linestyle": (0, (4, 2))},
    {"linewidth": 1.3, "linestyle": (0, (1, 1.5))},
    {"linewidth": 1.3, "linestyle": (0, (5, 1.5, 1, 1.5))},
)
_POINTS: tuple[dict[str, Any], ...] = (
    {"marker": "o", "markersize": 7, "fillstyle": "none", "markeredgewidth": 1.1},
    {"marker": "x", "markersize": 4.5, "markeredgewidth": 1.3},
    {"marker": "+", "markersize": 7, "markeredgewidth": 1.1},
    {"marker": "s", "markersize": 9, "fillstyle": "none", "markeredgewidth": 0.9},
)


def trace_figure(traces: Sequence[Trace], key: str, until: float = 0.0) -> str:
    """One observable over time: engines over each other, variants by colour.

    `traces` share a label, a unit and a style; at most `SERIES` variants.  `key` makes the ids of the SVG
    unique in its page; impacts are drawn on a time axis that runs to `until` (s), as their case's curves do.
    Returns the `<svg>` element.
    """
    engines, variants = _names(traces)
    several = len(variants) > 1
    with styled() as (figure, axes):
        points = traces[0].style == "points"
        longest = max([until * points, *(abs(time) for trace in traces for time in trace.times)])
        time_factor, time_unit = scale(longest, "s")
        values = np.concatenate([np.asarray(trace.values, float) for trace in traces])
        values = values[np.isfinite(values)]
        factor, unit = scale(float(np.max(np.abs(values), initial=0.0)), traces[0].unit)
        logarithmic = _wants_logarithm(values)
        for trace in traces:
            place = _place(engines, trace.engine)
            colour = COLOURS[(variants.index(trace.variant) if several else place) % SERIES]
            times, heights = _thinned(trace, logarithmic)
            axes.plot(
                times * time_factor, heights * factor, color=colour, **_look(trace, place, len(engines))
            )
        axes.set_xlabel(f"time ({time_unit})")
        axes.set_ylabel(_label(words(traces[0].label), unit))
        axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
        if points:
            axes.set_xlim(-0.03 * longest * time_factor, 1.03 * longest * time_factor)
        if logarithmic:
            _logarithmic_y(axes, values * factor)
        else:
            _steady_limits(axes, values * factor)
        handles = []
        if several:
            handles += [
                Line2D([], [], color=COLOURS[k % SERIES], linewidth=2.5, label=_short(variant or "base"))
                for k, variant in enumerate(variants)
            ]
        handles += [
            Line2D([], [], color=INK if several else COLOURS[place % SERIES], label=_short(engine),
                   **_look(traces[0], place, len(engines)))
            for engine in engines for place in [_place(engines, engine)]
        ]  # fmt: skip
        _legend(figure, handles)
        return svg_text(figure, key)


def convergence_figure(convergences: Sequence[Convergence], key: str) -> str:
    """The distance to the target against the refined parameter, with observed orders and a slope.

    `convergences` share quantity, unit and parameter, and none of them is `exact_to_rounding`.  Distances
    are relative where every target is a number other than zero.  Returns the `<svg>` element.
    """
    engines, _ = _names(convergences)
    relative = all(math.isfinite(c.target) and c.target != 0 for c in convergences)
    with styled() as (figure, axes):
        finest = max(level for c in convergences for level in c.levels)
        x_factor, x_unit = scale(finest, "s")
        largest = max(float(np.nanmax(np.abs(_distance(c)))) for c in convergences)
        factor, unit = (1.0, "") if relative else scale(largest, convergences[0].unit)
        handles, everything = [], []
        for k, c in enumerate(convergences):
            size = abs(_target(c)) if relative else 1.0
            distance = np.abs(_distance(c)) / size * factor
            floor = np.finfo(float).eps * abs(_target(c)) / size * factor
            distance = np.maximum(distance, floor)
            distance[distance == 0] = np.nan  # about a zero target there is no floor to put it on
            x = np.asarray(c.levels) * x_factor
            spread = np.asarray(c.spreads) / size * factor if len(c.spreads) == len(x) else np.zeros(len(x))
            style: dict[str, Any] = {
                "color": COLOURS[k % SERIES],
                "marker": MARKERS[k % SERIES],
                "markersize": 5,
            }
            bars = np.vstack([np.minimum(spread, 0.9 * distance), spread])
            axes.errorbar(x, distance, yerr=bars if np.any(spread > 0) else None, linewidth=1.1, capsize=2,
                          elinewidth=0.8, **style)  # fmt: skip
            everything.append((x, distance))
            name = ", ".join(part for part in (c.variant, c.engine if len(engines) > 1 else "") if part)
            order = "no order" if c.order is None or not math.isfinite(c.order) else f"order {c.order:.2f}"
            label = _short(name, 22) + ": " + order if name and len(convergences) > 1 else order
            handles.append(Line2D([], [], linewidth=1.1, label=label, **style))
        handles += _slope(axes, everything, [c.order for c in convergences])
        axes.set_xscale("log")
        x_values = np.concatenate([x for x, _ in everything])
        _logarithmic_y(axes, np.concatenate([y for _, y in everything]))
        _level_ticks(axes, x_values)
        limit = "the target" if all(math.isfinite(c.target) for c in convergences) else "the limit"
        axes.set_xlabel(f"{printable(convergences[0].parameter)} ({x_unit})")
        axes.set_ylabel(f"relative distance to {limit}" if relative else _label(f"distance to {limit}", unit))
        _legend(figure, handles)
        return svg_text(figure, key)


def exact_to_rounding(convergence: Convergence, rounding: float = 0.0) -> bool:
    """Whether every level meets the target within 64 units in the last place: nothing to plot.

    `rounding` is an absolute bound that is known from elsewhere, for targets of zero.
    """
    bound = max(rounding, ROUNDING * abs(_target(convergence)))
    return bool(np.all(np.abs(_distance(convergence)) <= bound))


def drawable(convergence: Convergence) -> bool:
    """Whether there are at least two finite positive levels to put on logarithmic axes."""
    levels, distance = np.asarray(convergence.levels, float), _distance(convergence)
    return len(levels) == len(distance) >= 2 and bool(np.all(levels > 0) and np.all(np.isfinite(distance)))


def _target(c: Convergence) -> float:
    return c.target if math.isfinite(c.target) else c.extrapolated


def _distance(c: Convergence) -> np.ndarray:
    return np.asarray(c.values, float) - _target(c)


def _names(records: Sequence[Trace] | Sequence[Convergence]) -> tuple[list[str], list[str]]:
    engines = sorted({r.engine: 0 for r in records}, key=lambda name: name != "reference")
    return engines, list(dict.fromkeys(r.variant for r in records))


def _place(engines: list[str], engine: str) -> int:
    """The place in the styles: 0 is the reference's, also where it is not drawn."""
    return engines.index(engine) + ("reference" not in engines)


def _look(trace: Trace, place: int, engines: int) -> dict[str, Any]:
    if trace.style == "points":
        return _POINTS[place % len(_POINTS)] | {"linestyle": "none"}
    return _LINES[place % len(_LINES)] if engines > 1 else {"linewidth": 1.4}


def _thinned(trace: Trace, logarithmic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Few enough points for a small file; a curve keeps the extremes of every bucket."""
    times, values = np.asarray(trace.times, float), np.asarray(trace.values, float)
    values = np.where(np.isfinite(values) & ((values > 0) | (not logarithmic)), values, np.nan)
    if trace.style == "points":
        step = max(1, math.ceil(len(times) / IMPACTS_DRAWN))
        return times[::step], values[::step]
    if len(times) <= 2 * CURVE_BUCKETS:
        return times, values
    keep: set[int] = {0, len(times) - 1}
    for bucket in np.array_split(np.arange(len(times)), CURVE_BUCKETS):
        finite = bucket[np.isfinite(values[bucket])]
        if finite.size:
            keep |= {int(finite[values[finite].argmin()]), int(finite[values[finite].argmax()])}
    index = sorted(keep)
    return times[index], values[index]


def _wants_logarithm(values: np.ndarray) -> bool:
    positive = values[values > 0]
    if positive.size < 3 or np.any(values < 0):
        return False
    return bool(positive.max() > 1e3 * np.quantile(positive, 0.1))


def _steady_limits(axes: Axes, values: np.ndarray) -> None:
    """A curve that is constant but for rounding is drawn flat, not magnified to noise."""
    middle = float(np.mean(values)) if values.size else 0.0
    if values.size and float(np.ptp(values)) <= 1e-9 * abs(middle):
        axes.set_ylim(*sorted((0.95 * middle, 1.05 * middle)) if middle else (-1, 1))
    elif values.size:
        axes.margins(y=0.08)
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def _logarithmic_y(axes: Axes, values: np.ndarray) -> None:
    """Whole decades, at most 14 of them (the largest) and about seven labels, no minor ticks."""
    positive = values[(values > 0) & np.isfinite(values)]
    high = math.ceil(math.log10(positive.max()))
    low = max(min(math.floor(math.log10(positive.min())), high - 1), high - 14)
    axes.set_yscale("log")
    axes.set_ylim(10.0**low, 10.0**high)
    axes.yaxis.set_major_locator(FixedLocator(list(10.0 ** np.arange(low, high + 1, (high - low) // 7 + 1))))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "10" + superscript(round(math.log10(y)))))


def _level_ticks(axes: Axes, x: np.ndarray) -> None:
    """Ticks at the levels themselves, as many as have room."""
    levels: list[float] = []
    span = max(math.log(x.max() / x.min()), 1e-9)
    for level in np.unique(x):
        if not levels or math.log(level / levels[-1]) > span / 7:
            levels.append(float(level))
    axes.xaxis.set_major_locator(FixedLocator(levels))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: number(value, 3)))
    axes.set_xlim(x.min() / 1.2, x.max() * 1.2)


def _slope(
    axes: Axes, curves: list[tuple[np.ndarray, np.ndarray]], orders: list[float | None]
) -> list[Line2D]:
    """A dotted line of the integer order nearest to the observed ones, under the lowest curve."""
    known = [order for order in orders if order is not None and math.isfinite(order)]
    slope = round(float(np.median(known))) if known else 0
    if slope < 1:
        return []
    curves = [(x[y > 0], y[y > 0]) for x, y in curves if np.any(y > 0)]
    x, y = min(curves, key=lambda curve: curve[1][int(np.argmin(curve[0]))])
    ends = np.array([x.min(), x.max()])
    style: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (1, 2))}
    axes.plot(ends, 0.5 * y[int(np.argmin(x))] * (ends / x.min()) ** slope, **style)
    return [Line2D([], [], label=f"slope {slope}", **style)]


def _label(text: str, unit: str) -> str:
    text = _short(text, 40)
    return f"{text} ({unit})" if unit else text


def _short(text: str, length: int = 26) -> str:
    """A name that fits a small figure; matplotlib would drop one that starts with an underscore."""
    text = " ".join(printable(text).split())
    text = text if len(text) <= length else text[: length - 1] + "…"
    return "\u200b" + text if text.startswith("_") else text


def _legend(figure: Figure, handles: list[Line2D]) -> None:
    """The legend above the axes, in as many columns as its longest entry allows."""
    if not handles:
        return
    longest = max(len(str(handle.get_label())) for handle in handles)
    columns = max(1, min(3, 54 // (longest + 7), len(handles)))
    rows = math.ceil(len(handles) / columns)
    figure.set_figheight(2.55 + 0.17 * rows)
    figure.legend(handles=handles, loc="outside upper left", ncols=columns)
