"""Figures of the sensitivity: detection limits as bars, power as curves; SVG text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from cmpcheck.charts import chart_figure
from cmpcheck.display import number, printable
from cmpcheck.results import Chart, Column, Curve
from cmpcheck.sensitivity.words import PERCENT, compared_text, limit_text
from cmpcheck.svg import COLOURS, INK, styled, svg_text

BAR_HEIGHT, WIDTH = 0.19, 7.4  # inches
LEAST = 1e-9  # %, where the axis begins: what is smaller is seen by exact balances


def limited(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The errors with a smallest size in percent, the largest first."""
    own = [
        m for m in document["mutants"] if m["unit"].startswith(PERCENT) and m["smallest_detected"] is not None
    ]
    return sorted(own, key=lambda m: -m["smallest_detected"])


def limits_figure(document: dict[str, Any], key: str) -> str:
    """The smallest noticed size of each error in percent, "" where none is known."""
    own = limited(document)
    if not own:
        return ""
    with styled() as (figure, axes):
        figure.set_size_inches(WIDTH, 0.6 + BAR_HEIGHT * len(own))
        sizes = [max(m["smallest_detected"], LEAST) for m in own]
        low = 10.0 ** math.floor(math.log10(min(sizes)))
        places = np.arange(len(own))[::-1]
        axes.barh(places, [s - low for s in sizes], left=low, height=0.7, color=COLOURS[0])
        for place, size, m in zip(places, sizes, own, strict=True):
            axes.text(size * 1.15, place, limit_text(m), va="center", fontsize=8, color=INK)
        axes.set_xscale("log")
        axes.set_xlim(low, 10.0 ** math.ceil(math.log10(max(sizes)) + 0.7))
        axes.set_ylim(-0.7, len(own) - 0.3)
        axes.set_yticks(places, [printable(m["name"]) for m in own], fontsize=8)
        axes.grid(axis="y", visible=False)
        axes.xaxis.set_major_locator(LogLocator(10, numticks=12))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{number(x, 3)} %"))
        axes.set_xlabel("smallest size that is noticed")
        return svg_text(figure, key)


def power_figures(document: dict[str, Any], key: str) -> list[tuple[str, str]]:
    """The fractions of verdicts over the true difference, of each comparison with many pairs and with few."""
    drawn = []
    curves = sorted(document["power"].get("curves", []), key=lambda curve: -curve["pairs"])
    for k, curve in enumerate(curves):
        name, points = compared_text(curve), curve["points"]
        effects = tuple(point["effect"] for point in points)
        names = [
            ("different", "called different"),
            ("equivalent", "called equivalent"),
            ("resolved", "found to differ from 0"),
        ]
        chart = Chart(
            "", Column("true difference / margin"), Column("fraction of trials"),
            tuple(Curve(label, effects, tuple(point[name] for point in points)) for name, label in names),
        )  # fmt: skip
        caption = (
            f"{name[0].upper()}{name[1:]}, {curve['pairs']} pairs; margin "
            f"{number(curve['margin'], 2)}, spread of a difference {number(curve['spread'], 2)}; "
            f"{curve['trials']} trials a point."
        )
        drawn.append((chart_figure(chart, f"{key}.{k}"), caption))
    return drawn
