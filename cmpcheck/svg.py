"""A matplotlib figure as an inline `<svg>`: small, unique ids, the page's fonts and colours.

Colours are CSS variables (`--plot-ink`, `--plot-0`, ...), so that the page decides how they look in light,
dark and print; the same figure gives the same bytes.  What is drawn is in `plots.py`.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

# Placeholders that the SVG backend writes as they are; `svg_text` turns them into CSS variables.
INK, FAINT = "#0a0b01", "#0a0b02"
COLOURS = tuple(f"#0a0c0{k}" for k in range(6))
_VARIABLES = {INK: "--plot-ink", FAINT: "--plot-faint"} | {
    colour: f"--plot-{k}" for k, colour in enumerate(COLOURS)
}
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "cmpcheck", "text.parse_math": False,
    "font.size": 9, "axes.titlesize": 9, "legend.fontsize": 9, "axes.spines.top": False,
    "axes.spines.right": False, "axes.linewidth": 0.7, "axes.edgecolor": INK, "axes.labelcolor": INK,
    "text.color": INK, "xtick.color": INK, "ytick.color": INK, "xtick.major.width": 0.7,
    "ytick.major.width": 0.7, "axes.grid": True, "grid.color": FAINT, "grid.linewidth": 0.6,
    "axes.axisbelow": True, "legend.frameon": False, "legend.handlelength": 2.4,
    "legend.columnspacing": 1.2, "legend.borderaxespad": 0, "axes.unicode_minus": True, "path.simplify": True,
    "path.simplify_threshold": 0.3,
}  # fmt: skip


@contextmanager
def styled() -> Iterator[tuple[Figure, Axes]]:
    """A figure and its axes in this module's style, whatever the user's matplotlibrc says."""
    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        figure = Figure(figsize=(4.5, 2.7), dpi=72, layout="constrained")
        FigureCanvasSVG(figure)
        yield figure, figure.add_subplot()


def svg_text(figure: Figure, key: str) -> str:
    """The figure as an inline `<svg>`: short numbers, unique ids, the page's fonts and colours."""
    layout = figure.get_layout_engine()
    if layout is not None:  # savefig would draw all of it once more, unseen, before it does this
        layout.execute(figure)
        figure.set_layout_engine(None)
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", text, flags=re.DOTALL)
    width, height = figure.get_size_inches() * 72
    text = re.sub(
        r"<svg[^>]*>", f'<svg viewBox="0 0 {width:.0f} {height:.0f}" aria-hidden="true">', text, count=1
    )
    text = text.replace("xlink:href", "href")
    used = dict.fromkeys(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    short = {name: f"{key}-{k}" for k, name in enumerate(used)}
    text = re.sub(r'\s+id="([^"]+)"', lambda m: f' id="{short[m[1]]}"' if m[1] in short else "", text)
    text = re.sub(r'(href="#|url\(#)([^")]+)', lambda m: m[1] + short[m[2]], text)
    text = re.sub(r" font-family: [^;\"]*;| transform=\"rotate\(-0 [^\"]*\"", "", text)
    for colour, variable in _VARIABLES.items():
        text = text.replace(colour, f"var({variable})")
    text = re.sub(r'\b(?:d|x|y|width|height|transform|points)="[^"]*"', _rounded, text)
    text = re.sub(r"\s+", " ", re.sub(r">\s+<", "><", text)).strip()
    return re.sub(r"<g( clip-path=[^>]*)>((?:<use [^>]*/>){2,})</g>", _styled_once, text)


def _rounded(attribute: re.Match[str]) -> str:
    return re.sub(r"-?\d+\.\d{2,}", lambda m: f"{float(m[0]):.2f}".rstrip("0").rstrip("."), attribute[0])


def _styled_once(group: re.Match[str]) -> str:
    """A group of equal markers with their common style on the group."""
    styles = set(re.findall(r' style="[^"]*"', group[2]))
    if len(styles) != 1:
        return group[0]
    style = styles.pop()
    return f"<g{group[1]}{style}>{group[2].replace(style, '')}</g>"
