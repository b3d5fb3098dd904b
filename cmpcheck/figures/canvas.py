"""How the paper's figures look, and how they become files; nothing of what they show."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

# Told apart in grey by lightness, and by line style wherever two lines meet
INK, BLUE, PALE = "#1a1a1a", "#0b5394", "#d9d9d9"
DPI = 200
PAGE_DPI = 130  # of a page, whose size counts
MICRO = 1e-6
_STYLE: dict[Any, Any] = {
    "font.size": 9, "axes.titlesize": 9, "figure.titlesize": 10, "figure.titleweight": "bold",
    "legend.fontsize": 8.5, "legend.frameon": False, "axes.linewidth": 0.7, "axes.edgecolor": INK,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK, "ytick.color": INK,
    "xtick.major.width": 0.7, "ytick.major.width": 0.7, "lines.linewidth": 1.4, "hatch.linewidth": 0.6,
    "svg.fonttype": "path", "svg.hashsalt": "cmpcheck", "figure.dpi": DPI, "savefig.dpi": DPI,
}  # fmt: skip


@dataclass(frozen=True)
class Picture:
    """One of the paper's figures, redrawn."""

    name: str  # of the files
    title: str  # with the paper's number and its equations
    caption: str
    figure: Figure


@contextmanager
def paper_style() -> Iterator[None]:
    """This module's style, whatever the user's matplotlibrc says."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def blank(width: float, height: float, title: str) -> Figure:
    """An empty figure of that size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    return figure


def greys() -> Colormap:
    """Heights from white to a grey on which black lines still show."""
    return LinearSegmentedColormap.from_list("heights", ["#ffffff", "#7d7d7d"])


def save(picture: Picture, folder: Path) -> list[Path]:
    """NAME.svg and NAME.png, the same bytes for the same figure."""
    files = [folder / f"{picture.name}.svg", folder / f"{picture.name}.png"]
    picture.figure.savefig(files[0], metadata={"Date": None, "Title": picture.title})
    picture.figure.savefig(files[1], metadata={"Software": None})
    return files


def small_png(picture: Picture) -> bytes:
    """The figure for a page, the same bytes for the same figure."""
    buffer = io.BytesIO()
    picture.figure.savefig(buffer, format="png", dpi=PAGE_DPI, metadata={"Software": None})
    return buffer.getvalue()
