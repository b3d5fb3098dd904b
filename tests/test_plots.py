"""Figures and numbers of the report: what is drawn, in which unit, and what rounding may not hide."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from report_example import HOSTILE, converging

from cmpcheck import display, plots
from cmpcheck.results import Trace


def test_thinning_keeps_the_extremes_of_a_curve() -> None:
    values = [0.0] * 10_000
    values[4321], values[8765] = 7.0, -9.0
    trace = Trace("c", "", "lammps", "spike", "m", tuple(map(float, range(10_000))), tuple(values))
    times, kept = plots._thinned(trace, logarithmic=False)
    assert len(times) <= 2 * plots.CURVE_BUCKETS + 2
    assert (times[kept.argmax()], kept.max()) == (4321, 7)
    assert (times[kept.argmin()], kept.min()) == (8765, -9)


def test_noise_of_rounding_is_said_and_not_plotted() -> None:
    assert plots.exact_to_rounding(converging("reference", "", "load", "N", 3.0, 0.0))
    assert not plots.exact_to_rounding(converging("reference", "", "load", "N", 3.0, 1.0))
    assert plots.exact_to_rounding(converging("reference", "", "momentum", "N s", 0.0, 0.0))


def test_noise_about_a_zero_target_is_judged_by_the_rounding_tolerance() -> None:
    noise = replace(
        converging("reference", "", "momentum", "N s", 0.0, 0.0), values=(1e-31, 0.0, 2e-31, 1e-31)
    )
    assert not plots.exact_to_rounding(noise)
    assert plots.exact_to_rounding(noise, rounding=2e-31)
    assert not plots.exact_to_rounding(noise, rounding=1.9e-31)


@pytest.mark.parametrize(
    "changes",
    [
        {"target": 0.0, "values": (1e-3, 1e-4, 0.0, 0.0)},
        {"target": math.nan},
        {"order": None},
        {"order": math.nan, "spreads": ()},
        {"values": (3.1, 3.0, 3.0, 3.0)},
        {"variant": HOSTILE + "_$x$" * 9},
    ],
)
def test_an_odd_convergence_is_still_drawn(changes: dict) -> None:
    record = replace(converging("lammps", "", "load", "N", 3.0, 1.0), **changes)
    assert plots.drawable(record)
    figure = plots.convergence_figure([record, converging("lammps", "other", "load", "N", 3.0, 1.0)], "k")
    assert "<script" not in figure
    assert "nan" not in figure


def test_what_cannot_stand_on_logarithmic_axes_is_not_drawn() -> None:
    record = converging("lammps", "", "load", "N", 3.0, 1.0)
    assert not plots.drawable(replace(record, levels=record.levels[:1], values=record.values[:1]))
    assert not plots.drawable(replace(record, values=(math.nan,) * 4))
    assert not plots.drawable(replace(record, levels=(0.0,) * 4))


@pytest.mark.parametrize(
    "values",
    [(0.0, 0.0, 0.0), (0.1 + 0.2, 0.3, 0.3), (-1.0, math.nan, math.inf), (1e-300, 1e-10, 1e10), (5.0,) * 3],
)
@pytest.mark.parametrize("style", ["line", "points"])
def test_an_odd_curve_is_still_drawn(values: tuple[float, ...], style: str) -> None:
    trace = Trace("c", f"_{HOSTILE}$", "lammps", f"$height$ {HOSTILE}", "m", (0.0, 1e-6, 2e-6), values, style)
    figure = plots.trace_figure([trace, replace(trace, engine="reference")], "k", until=3e-6)
    assert "<script" not in figure
    assert "$height$" in figure
    assert "time (µs)" in figure


def test_a_constant_is_drawn_flat_and_its_ticks_keep_their_digits() -> None:
    trace = Trace("c", "", "lammps", "restitution", "1", (0.0, 1.0, 2.0), (0.025, 0.025 * (1 + 1e-15), 0.025))
    ticks = re.findall(r">(0\.\d+)<", plots.trace_figure([trace], "k"))
    assert "0.025" in ticks


def test_a_figure_has_units_order_and_no_colour_of_its_own() -> None:
    figure = plots.convergence_figure([converging("lammps", "", "load", "N", 3.0, 1.0)], "k")
    text = re.sub("<[^>]*>", " ", figure)
    assert "contact duration (ns)" in text
    assert "order 1.00" in text
    assert "slope 1" in text
    assert "var(--plot-0)" in figure
    assert "#" not in figure.replace('href="#', "").replace("url(#", "")


@pytest.mark.parametrize(
    "value, unit, text",
    [
        (1.2345e-12, "N s", "1.2345 pN s"),
        (3e-15, "kg", "3 pg"),
        (2.5, "kg", "2.5 kg"),
        (3.1e-20, "m3", "0.031 µm³"),
        (4e-12, "m2", "4 µm²"),
        (0.5, "m/s", "0.5 m/s"),
        (5e-7, "s", "500 ns"),
        (3e8, "Pa", "300 MPa"),
        (2e-29, "N s", "2e−29 N s"),
        (0.7, "1", "0.7"),
        (-1e-15, "kg m/s", "−1 pg m/s"),
        (0.0, "J", "0 J"),
        (math.nan, "J", "n/a"),
        (5e-9, "mol", "5e−9 mol"),
    ],
)
def test_quantities_read_in_human_units(value: float, unit: str, text: str) -> None:
    assert display.quantity_text(value, unit) == text


@pytest.mark.parametrize(
    "ratio, text", [(1.0004, "1.0004"), (0.9996, "0.9996"), (1.0, "1"), (15.2, "15"), (1e-5, "<0.001")]
)
def test_a_ratio_never_rounds_across_one(ratio: float, text: str) -> None:
    assert display.ratio_text(ratio) == text
