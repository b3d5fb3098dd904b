"""Figures, tables and files of a benchmark: curves of the engines with the published points.

What was found is `judge.py`'s; drawing is `cmpcheck/charts.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from cmpcheck.display import words
from cmpcheck.published.benchmark import SWEPT, Benchmark
from cmpcheck.published.judge import Series, unit_of
from cmpcheck.published.scene import contact_of, tangential_speeds
from cmpcheck.published.targets import spinless_restitution
from cmpcheck.results import Chart, Column, Curve, Table

POINTS = "liggghts"  # drawn as points, so that curves of engines that agree are both seen
NO_SPIN = (
    "The paper's model has no spin, so the reference takes no part here: these rows test engines, against "
    "closed forms, the contact law they state, integrated independently, and published points."
)


def charts_of(benchmark: Benchmark, series: Sequence[Series]) -> list[Chart]:
    """One figure for each published curve; else one for what the sweep is about; none for a single impact."""
    kind = benchmark.sweep.kind
    if kind in ("normal", "restitution", "spin"):
        return [] if kind == "normal" or not series else [_chart(benchmark, series, kind, "")]
    drawn = dict.fromkeys((points.quantity, points.material) for points in benchmark.points)
    return [_chart(benchmark, series, quantity, material) for quantity, material in drawn]


def _chart(benchmark: Benchmark, series: Sequence[Series], quantity: str, material: str) -> Chart:
    """Curves of one material: of the engines in both models, the spinless model, and the points."""
    name = material or benchmark.material[0].name
    own = [s for s in series if s.material.name == name]
    curves = []
    for label in dict.fromkeys(f"{s.engine}, {s.contact.model}" for s in own):
        members = [s for s in own if f"{s.engine}, {s.contact.model}" == label]
        x, y = zip(*sorted(_xy(benchmark, members, quantity)), strict=True)
        curves.append(Curve(label, x, y, style="points" if members[0].engine == POINTS else "line"))
    if benchmark.measured and quantity in ("tangential_restitution", "rebound_angle"):
        curves.append(_spinless_curve(benchmark, quantity))
    for points in benchmark.points:
        if (points.quantity, points.material) == (quantity, name):
            known = [points.uncertainty(k) for k in range(len(points.at))]
            low, high = (
                tuple(v + sign * u for v, u in zip(points.values, known, strict=True)) for sign in (-1, 1)
            )
            label = "measured, digitised" if benchmark.measured else "published, digitised"
            curves.append(Curve(label, points.at, points.values, low, high, "points"))
    unit = SWEPT[benchmark.sweep.kind][1]
    title = _axis(quantity)
    what = "with the measured points" if benchmark.measured else "with the published points"
    has_points = any(curve.lower for curve in curves)
    caption = f"{title}, {name}" + (f", {what} and their digitisation floor" if has_points else "")
    return Chart(
        caption, Column(SWEPT[benchmark.sweep.kind][0], unit), Column(title, unit_of(quantity)), tuple(curves)
    )


def _xy(benchmark: Benchmark, members: Iterable[Series], quantity: str) -> Iterable[tuple[float, float]]:
    for s in members:
        for (key, k), limit in s.limits.items():
            if key == quantity:
                restitution = benchmark.sweep.kind == "restitution"
                yield (s.contact.restitution if restitution else benchmark.sweep.values[k]), limit.value


def _axis(quantity: str) -> str:
    text = words(quantity)
    return text[:1].upper() + text[1:]


def _spinless_curve(benchmark: Benchmark, quantity: str) -> Curve:
    """The paper's model over a fine sweep."""
    at = tuple(np.linspace(1.0, benchmark.sweep.values[-1], 60).tolist())
    fine = benchmark.model_copy(update={"sweep": benchmark.sweep.model_copy(update={"values": at})})
    e_t = _spinless(fine)
    if quantity == "rebound_angle":
        e_t = np.degrees(np.arctan(e_t * np.tan(np.radians(at)) / benchmark.restitution))
    return Curve("the paper's model, no spin", at, tuple(float(v) for v in e_t))


def _spinless(benchmark: Benchmark) -> np.ndarray:
    material = benchmark.material[0]
    return spinless_restitution(benchmark, contact_of(benchmark, material, "hertz", benchmark.restitution))


def tables_of(benchmark: Benchmark, series: Sequence[Series]) -> list[Table]:
    """How far engines and a spinless model are from what was measured; no verdict hangs on it."""
    if not benchmark.measured:
        return []
    quantity = "tangential_restitution"
    points = next(points for points in benchmark.points if points.quantity == quantity)
    spinless, tangential = _spinless(benchmark), tangential_speeds(benchmark)
    labels = [f"{s.engine}, {s.contact.model}" for s in series]
    rows, apart = [], []
    for at, value in zip(points.at, points.values, strict=True):
        k = benchmark.sweep.values.index(at)
        rows.append((at, value, *(s.limits[quantity, k].value for s in series), float(spinless[k])))
        apart.append(float(spinless[k]) - value)
    worst = max(range(len(apart)), key=lambda k: abs(apart[k]))
    k = benchmark.sweep.values.index(points.at[worst])
    lost = abs(apart[worst]) * tangential[k]
    engines = [abs(cell - row[1]) for row in rows for cell in row[2:-1]]
    caption = (
        "How far a model without spin is from the measurement, for information: its e_t is off by "
        f"{min(map(abs, apart)):.3f} to {max(map(abs, apart)):.3f}, most at {points.at[worst]:g}°"
        f" (by {lost:.2g} m/s)"
    )
    if engines:
        caption += f"; that of the engines, with spin, by {min(engines):.3f} to {max(engines):.3f}"
    columns = (
        Column("angle of incidence", "°"), Column("measured e_t"), *(Column(f"{label}") for label in labels),
        Column("no spin"),
    )  # fmt: skip
    return [Table(caption, columns, tuple(rows))]


def notes_of(benchmark: Benchmark) -> list[str]:
    """What stands above the rows."""
    sources = dict.fromkeys(points.source for points in benchmark.points)
    notes = [NO_SPIN, f"Publication: {benchmark.publication}."]
    if sources:
        notes.append(f"Points: {'; '.join(sources)}.")
    return notes


def write_curves(benchmark: Benchmark, series: Sequence[Series], path: Path) -> None:
    """Every limit that was found, as CSV with SI units and degrees."""
    rows = []
    for s in series:
        for (quantity, k), limit in s.limits.items():
            restitution = benchmark.sweep.kind == "restitution"
            rows.append(
                {
                    "engine": s.engine,
                    "model": s.contact.model,
                    "material": s.material.name,
                    "swept": s.contact.restitution if restitution else benchmark.sweep.values[k],
                    "quantity": quantity,
                    "unit": unit_of(quantity),
                    "limit": limit.value,
                    "uncertainty": limit.uncertainty,
                    "order": math.nan if limit.order is None else limit.order,
                }
            )
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(path, index=False, lineterminator="\n")
