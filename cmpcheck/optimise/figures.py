"""The figures of a design run: the paper's Figs. 7 and 8, methods side by side, and the front.

Each is drawn once on given axes, for the page and for files alike.  Their captions stand here too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from scipy import stats

from cmpcheck import svg
from cmpcheck.display import number, quantity_text, scale
from cmpcheck.figures import canvas
from cmpcheck.optimise.findings import best_method
from cmpcheck.optimise.front import SECOND, Front
from cmpcheck.optimise.methods import METHODS
from cmpcheck.optimise.results import Design, Distribution, gene_name, gene_text


class Colours(NamedTuple):
    """Of a medium."""

    ink: str
    faint: str
    series: tuple[str, ...]


PAGE = Colours(svg.INK, svg.FAINT, svg.COLOURS)
PRINT = Colours(canvas.INK, canvas.PALE, (canvas.BLUE, "#b45309", "#0f766e", "#7c3aed"))
LINES = ("-", (0, (4, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5)))


class Drawing(NamedTuple):
    """One figure: its panels, each drawn on axes of its own."""

    name: str  # of the files
    title: str
    caption: str
    panels: tuple[Callable[[Axes, Colours], None], ...]


def drawings(design: Design) -> list[Drawing]:
    """All figures that the design has anything for."""
    found = []
    if design.distributions:
        found.append(_distributions(design))
    if any(map(math.isfinite, design.history)):
        found.append(_history(design))
    if design.trials:
        found.append(_methods(design))
    if design.front is not None and design.front.strings:
        found.append(_front(design.front))
    return found


def write_figures(design: Design, folder: Path) -> list[Path]:
    """Each figure as NAME.svg and NAME.png."""
    files = []
    with canvas.paper_style():
        for drawing in drawings(design):
            figure = canvas.blank(7.2 if len(drawing.panels) > 1 else 4.8, 3.2, drawing.title)
            panels = np.atleast_1d(figure.subplots(1, len(drawing.panels)))
            for axes, draw in zip(panels, drawing.panels, strict=True):
                draw(axes, PRINT)
                axes.spines[["top", "right"]].set_visible(False)
            files += canvas.save(canvas.Picture(drawing.name, drawing.title, drawing.caption, figure), folder)
    return files


def inline(drawing: Drawing) -> list[str]:
    """The panels of a figure as `<svg>` elements."""
    texts = []
    for k, draw in enumerate(drawing.panels):
        with svg.styled() as (figure, axes):
            draw(axes, PAGE)
            texts.append(svg.svg_text(figure, f"{drawing.name}-{k}"))
    return texts


def _distributions(design: Design) -> Drawing:
    name, low, high = design.problem.cost_name, math.inf, -math.inf
    for distribution in design.distributions:
        low, high = min(low, distribution.costs.min()), max(high, distribution.costs.max())

    def panel(place: int, distribution: Distribution) -> Callable[[Axes, Colours], None]:
        def draw(axes: Axes, colours: Colours) -> None:
            costs = distribution.costs
            axes.hist(
                costs,
                bins="auto" if np.ptp(costs) > 0 else 1,
                color=colours.series[0],
                alpha=0.45,
                edgecolor=colours.ink,
                linewidth=0.6,
            )
            axes.axvline(float(costs.mean()), color=colours.ink, linewidth=1.4, label="mean")
            axes.axvline(
                float(np.median(costs)), color=colours.ink, linewidth=1.2, linestyle=LINES[1], label="median"
            )
            axes.set(xlabel=f"{name} of a sample", ylabel="samples")
            axes.set_title(f"({'ab'[place]}) {distribution.label}", loc="left")
            axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
            axes.legend()

        return draw

    texts = []
    for place, distribution in enumerate(design.distributions):
        genes = zip(design.problem.settings.gene, distribution.string, strict=True)
        values = ", ".join(f"{gene_name(gene.key)} {gene_text(gene.key, value)}" for gene, value in genes)
        texts.append(f"({'ab'[place]}) {distribution.label} ({values}): {_moments(distribution.costs)}")
    caption = (
        f"{name} of {len(design.distributions[0].costs)} samples with equal parameters and other random "
        "numbers. "
        f"{'. '.join(texts)}. {name} has no upper limit but cannot be negative."
    )
    panels = tuple(panel(place, d) for place, d in enumerate(design.distributions))
    return Drawing("figure_7", f"Fig. 7: distribution of {name} for equal parameters", caption, panels)


def _moments(costs: np.ndarray) -> str:
    """Mean, standard deviation and skewness, with the standard error of the latter under normality."""
    n = len(costs)
    text = f"mean {number(float(costs.mean()), 3)}, standard deviation {number(float(costs.std(ddof=1)), 2)}"
    if n < 3 or np.ptp(costs) == 0:
        return text
    error = math.sqrt(6 * n * (n - 1) / ((n - 2) * (n + 1) * (n + 3)))
    return text + f", skewness {number(float(stats.skew(costs, bias=False)), 2)} ± {number(error, 1)}"


def _history(design: Design) -> Drawing:
    name, best = design.problem.cost_name, np.array(design.history)
    errors = {one.cost: one.standard_error for one in reversed(design.ranked)}
    generations = np.arange(1, len(best) + 1)

    def draw(axes: Axes, colours: Colours) -> None:
        shown = np.isfinite(best)
        axes.plot(
            generations[shown], best[shown], drawstyle="steps-post", color=colours.series[0], linewidth=1.0
        )
        axes.errorbar(
            generations[shown],
            best[shown],
            yerr=[errors[cost] for cost in best[shown]],
            fmt="o",
            color=colours.series[0],
            markersize=4.5,
            capsize=2.5,
            linewidth=1.0,
        )
        axes.set(xlabel="generation", ylabel=f"{name} of the best string", ylim=(0.0, None))
        axes.xaxis.set_major_locator(MaxNLocator(10, integer=True))

    part = design.problem.settings
    caption = (
        f"Least {name} after each generation of {part.population} strings, {part.parents} of them parents; "
        "bars are standard errors. It never rises, because parents keep their cost: from "
        f"{number(best[0], 3)} to {number(best[-1], 3)}."
    )
    return Drawing("figure_8", f"Fig. 8: {name} of the best string in each generation", caption, (draw,))


def _methods(design: Design) -> Drawing:
    def draw(axes: Axes, colours: Colours) -> None:
        present = [name for name in METHODS if name in {trial.method for trial in design.trials}]
        for place, method in enumerate(present):
            own = [trial for trial in design.trials if trial.method == method]
            end = min(trial.used[-1] for trial in own)
            used = np.unique(np.concatenate([trial.used for trial in own]))
            start = max(trial.used[int(np.argmax(np.isfinite(trial.best)))] for trial in own)
            used = used[(used <= end) & (used >= start)]
            curves = np.array(
                [np.array(trial.best)[np.searchsorted(trial.used, used, side="right") - 1] for trial in own]
            )
            axes.plot(
                used,
                curves.mean(axis=0),
                color=colours.series[place],
                linestyle=LINES[place],
                linewidth=1.6,
                label=method,
                drawstyle="steps-post",
            )
        axes.set(xlabel="samples used", ylabel=f"least {design.problem.cost_name}, mean over seeds")
        axes.legend()

    return Drawing("methods", "Methods of search at the same budget", best_method(design.trials), (draw,))


def _front(front: Front) -> Drawing:
    unit = {"removal_rate": "m/s", "abrasive_mass": "kg"}[front.second]
    flatness = np.array([mean.flatness for mean in front.means])
    other = np.array([getattr(mean, front.second) for mean in front.means])
    factor, label = scale(float(np.abs(other).max()), unit)
    words = {"removal_rate": "removal rate", "abrasive_mass": "mass of abrasives"}[front.second]
    best = front.on_front
    order = np.argsort(flatness[best])

    def draw(axes: Axes, colours: Colours) -> None:
        axes.plot(
            flatness[~best],
            other[~best] * factor,
            "x",
            color=colours.ink,
            alpha=0.45,
            markersize=4,
            label="not on the front",
        )
        axes.plot(
            flatness[best][order],
            other[best][order] * factor,
            "o-",
            color=colours.series[0],
            markersize=5,
            linewidth=1.0,
            label="front",
        )
        axes.set(xlabel="Π", ylabel=f"{words} ({label})")
        if flatness.max() > 5 * max(flatness[best].max(), 0.2):
            axes.set_xlim(0.0, 2.0 * max(flatness[best].max(), 0.5))
        axes.legend()

    more = "a higher" if SECOND[front.second] < 0 else "a smaller"
    ends = [int(np.flatnonzero(best)[k]) for k in (order[0], order[-1])]
    caption = (
        f"{int(best.sum())} of {len(best)} strings tried by NSGA-II are on the front: none is flatter and "
        f"has {more} {words} at once. It runs from Π = {number(flatness[ends[0]], 2)} at "
        f"{quantity_text(other[ends[0]], unit, digits=2)} to Π = {number(flatness[ends[1]], 2)} at "
        f"{quantity_text(other[ends[1]], unit, digits=2)}."
    )
    return Drawing("front", f"Flatness against {words}", caption, (draw,))
