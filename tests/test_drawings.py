"""Laws of the figures of a page: each stands where it was noted, whoever draws it."""

from __future__ import annotations

import pytest
from markupsafe import Markup

from cmpcheck import drawings
from cmpcheck.display import printable
from cmpcheck.drawings import CHUNK, Drawings


def figure(name: str, key: str, until: float = 0.0) -> str:
    return f"<svg>{name} {key} {until:g}</svg>"


def broken(name: str) -> str:
    raise ValueError(f"{name} cannot be drawn")


@pytest.mark.parametrize("jobs", [1, 2])
def test_figures_stand_where_they_were_noted_whoever_draws_them(jobs, monkeypatch):
    monkeypatch.setattr(drawings, "FEWEST", 2)
    noted = Drawings()
    marks = [noted.note(figure, "curve", f"k{n}", until=n) for n in range(2 * CHUNK + 1)]
    assert all(isinstance(mark, Markup) for mark in marks)  # nothing escapes what stands for a figure
    text = "; ".join([marks[-1], *marks])
    expected = [figure("curve", f"k{n}", n) for n in (2 * CHUNK, *range(2 * CHUNK + 1))]
    assert noted.place(text, jobs) == "; ".join(expected)


def test_no_text_of_others_stands_for_a_figure():
    noted = Drawings()
    mark = noted.note(figure, "curve", "k")
    forged = printable(str(mark))
    assert noted.place(forged, 1) == forged


def test_a_figure_that_cannot_be_drawn_is_an_error_in_processes_too(monkeypatch):
    monkeypatch.setattr(drawings, "FEWEST", 1)
    noted = Drawings()
    mark = noted.note(broken, "curve")
    with pytest.raises(ValueError, match="curve cannot be drawn"):
        noted.place(mark, 2)
