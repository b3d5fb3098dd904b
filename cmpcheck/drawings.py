"""The figures of a page: noted where they belong, drawn together at the end, in processes if there are many.

What a figure shows is `plots.py`, `charts.py` and `plots_ensembles.py`; where it stands, `page.py`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from cmpcheck.pool import run_tasks

FEWEST = 40  # figures that are worth processes: one takes some 0.1 s, starting a process 1 s
CHUNK = 5  # figures drawn in one go
MARK = "\x1a"  # around the number of a figure in a text; `display.printable` lets it into no other


class Drawing(NamedTuple):
    """One figure: function(*arguments, **options) is its SVG."""

    function: Callable[..., str]
    arguments: tuple[Any, ...]
    options: dict[str, Any]


class Drawings:
    """Figures in the order in which they were noted."""

    def __init__(self) -> None:
        self._noted: list[Drawing] = []

    def note(self, function: Callable[..., str], *arguments: Any, **options: Any) -> Markup:
        """A mark that stands for the figure, until `place`; the function must be importable."""
        self._noted.append(Drawing(function, arguments, options))
        return Markup(f"{MARK}{len(self._noted) - 1}{MARK}")

    def place(self, text: str, jobs: int) -> str:
        """The text with every figure in the place of its mark; `jobs`, the number of processes."""
        figures = self._drawn(jobs)
        return re.sub(f"{MARK}(\\d+){MARK}", lambda mark: figures[int(mark[1])], text)

    def _drawn(self, jobs: int) -> list[str]:
        """The same figures, however many processes draw them."""
        if jobs == 1 or len(self._noted) < FEWEST:
            return draw(self._noted)
        found: dict[int, list[str]] = {}
        chunks = [(k, self._noted[k : k + CHUNK]) for k in range(0, len(self._noted), CHUNK)]
        for (k, _), future in run_tasks(_draw_chunk, chunks, jobs):
            found[k] = future.result()
        return [figure for k in sorted(found) for figure in found[k]]


def _draw_chunk(chunk: tuple[int, Sequence[Drawing]]) -> list[str]:
    return draw(chunk[1])


def draw(drawings: Sequence[Drawing]) -> list[str]:
    """The SVG of each."""
    return [function(*arguments, **options) for function, arguments, options in drawings]
