"""From what was measured to rows: extrapolated from several time steps, and judged.

Measuring is `measure.py`, what must come out `targets.py`, and orders and uncertainties
`cmpcheck/convergence.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cmpcheck.convergence import Extrapolation, agreement, extrapolate
from cmpcheck.published.benchmark import SWEPT, UNITS, Benchmark, Material
from cmpcheck.published.measure import Measured
from cmpcheck.published.scene import (
    PHASES,
    Contact,
    Scene,
    normal_speeds,
    tangential_speeds,
)
from cmpcheck.published.targets import (
    Target,
    impact_targets,
    integrated,
    law_of,
    oblique_target,
    published_target,
    rebound_values,
    slides,
)
from cmpcheck.results import Comparison, Convergence
from reference.exact.oblique import INERTIA

FORMAL_ORDER = 1.0  # a contact is noticed up to a step late, and its dashpot acts so much too short
LIMIT = 0.01  # a wider tolerance, as a part of the scale, is no test
DRAWN = 4  # members of a sweep whose convergence is drawn


@dataclass(frozen=True)
class Series:
    """One material in one model and engine: limits by quantity and member."""

    engine: str
    material: Material
    contact: Contact
    limits: dict[tuple[str, int], Extrapolation]
    levels: tuple[float, ...]  # time steps, s, coarsest first
    measured: tuple[Measured, ...]


def find_limits(scenes: list[Scene], measured: list[Measured]) -> dict[tuple[str, int], Extrapolation]:
    """What every quantity tends to in the time step."""
    found = {}
    for key in measured[0]:
        values = [level[key] for level in measured]
        found[key] = extrapolate(
            [scene.time_step for scene in scenes],
            [float(v.mean()) for v in values],
            FORMAL_ORDER,
            [float(np.ptp(v)) / 2.0 for v in values],
            phases=PHASES,
        )
    return found


def rows_of(benchmark: Benchmark, series: Series) -> list[Comparison]:
    """The rows of one series."""
    kind = benchmark.sweep.kind
    if kind == "normal":
        targets = impact_targets(benchmark, series.contact)
        return [_row(benchmark, series, key, 0, t, abs(t.limit.value)) for key, t in targets.items()]
    if kind == "restitution":
        member = benchmark.sweep.values.index(series.contact.restitution)
        target = impact_targets(benchmark, series.contact)["restitution"]
        return [_row(benchmark, series, "restitution", member, target, target.limit.value, place=0)]
    if kind == "spin":
        return [row for k in range(len(benchmark.sweep.values)) for row in _spin_rows(benchmark, series, k)]
    return _oblique_rows(benchmark, series) + _published_rows(benchmark, series) + _arm_row(benchmark, series)


def _spin_rows(benchmark: Benchmark, series: Series, member: int) -> list[Comparison]:
    omega, speed = benchmark.sweep.values[member], float(normal_speeds(benchmark)[member])
    zero = Target("", Extrapolation(0.0, 1e-12 * speed, None, True, "closed form, rounding", "nothing"))
    same = Target("", Extrapolation(omega, 1e-12 * omega, None, True, "closed form, rounding", "nothing"))
    return [
        _row(benchmark, series, "tangential_velocity", member, zero, speed),
        _row(benchmark, series, "spin", member, same, omega),
    ]


def _oblique_rows(benchmark: Benchmark, series: Series) -> list[Comparison]:
    spin = "normalised_spin" if benchmark.sweep.kind == "tangential_speed" else "spin"
    rows = []
    for quantity in ("tangential_restitution", spin):
        for k in range(len(benchmark.sweep.values)):
            scale = scale_of(benchmark, series.contact, quantity)
            target = oblique_target(benchmark, series.contact, series.engine, quantity, k, scale)
            rows.append(_row(benchmark, series, quantity, k, target, scale))
    return rows


def _published_rows(benchmark: Benchmark, series: Series) -> list[Comparison]:
    """Against the points where no closed form holds; they are of Hertz's contact."""
    rows = []
    for points in benchmark.points:
        if points.material != series.material.name or series.contact.model != "hertz":
            continue
        for index, at in enumerate(points.at):
            k = benchmark.sweep.values.index(at)
            if not slides(benchmark, series.contact, k):
                scale = scale_of(benchmark, series.contact, points.quantity)
                target = published_target(points, index)
                rows.append(_row(benchmark, series, points.quantity, k, target, scale))
    return rows


def _arm_row(benchmark: Benchmark, series: Series) -> list[Comparison]:
    """Whether friction turns the sphere at the arm r, where it slides hardest."""
    members = [k for k in range(len(benchmark.sweep.values)) if slides(benchmark, series.contact, k)]
    if not members:
        return []
    target = Target("", Extrapolation(1.0, 1e-12, None, True, "rigid sphere, rounding", "nothing"))
    return [_row(benchmark, series, "friction_arm", members[0], target, 1.0)]


def scale_of(benchmark: Benchmark, contact: Contact, quantity: str) -> float:
    """The magnitude by which a tolerance is judged: the largest in the sweep, 90 degrees for an angle."""
    normal = float(normal_speeds(benchmark).max())
    spin = contact.friction * (1.0 + contact.restitution) * normal / INERTIA  # r omega
    return {
        "tangential_restitution": 1.0,
        "spin": spin / benchmark.radius,
        "normalised_spin": spin / (contact.friction * normal),
        "rebound_angle": 90.0,
    }[quantity]


def cross_rows(benchmark: Benchmark, first: Series, second: Series) -> list[Comparison]:
    """The second engine against the first one, in Hertz's contact where no closed form holds.

    The difference that their arms of friction make (`targets.SHORTENING`) is taken off, by the law.
    """
    rows: list[Comparison] = []
    if first.contact.model != "hertz":
        return rows  # its law is linear but for the slip, and integrated to more digits than the engines have
    for k in range(len(benchmark.sweep.values)):
        if benchmark.sweep.kind not in ("angle", "tangential_speed") or slides(benchmark, first.contact, k):
            continue
        quantity = "tangential_restitution"
        value = first.limits[quantity, k]
        ours, theirs = (
            oblique_target(benchmark, s.contact, s.engine, quantity, k, 1.0).limit for s in (first, second)
        )
        shifted = Extrapolation(
            value.value + theirs.value - ours.value, value.uncertainty + ours.uncertainty, value.order,
            value.credible, f"{first.engine}, shifted by the arm of friction: {value.reason}", value.remedy,
        )  # fmt: skip
        rows.append(_row(benchmark, second, quantity, k, Target(f"against {first.engine}", shifted), 1.0))
    return rows


def member_name(benchmark: Benchmark, member: int) -> str:
    """How a member of the sweep is called, e.g. "10°" or "e = 0.8"."""
    kind, value = benchmark.sweep.kind, benchmark.sweep.values[member]
    unit = SWEPT[kind][1]
    if kind == "normal":
        return ""
    if kind == "restitution":
        return f"e = {value:g}"
    return f"{value:g}{unit}" if unit == "°" else f"{value:.4g} {unit}"


def variant_name(benchmark: Benchmark, series_model: str, material: str, member: int, place: str = "") -> str:
    """Name of a row: model, material, member of the sweep and what it is compared with."""
    last = " ".join(part for part in (member_name(benchmark, member), place) if part)
    return ", ".join(part for part in (series_model, material, last) if part)


def _row(
    benchmark: Benchmark, series: Series, quantity: str, member: int, target: Target, scale: float,
    place: int | None = None,
) -> Comparison:  # fmt: skip
    found = series.limits[quantity, member if place is None else place]
    verdict = agreement(target.limit, found, scale, LIMIT)
    return Comparison(
        case=benchmark.name,
        variant=variant_name(benchmark, series.contact.model, series.material.name, member, target.place),
        engine=series.engine,
        quantity=quantity,
        equations="",
        unit=unit_of(quantity),
        reference=target.limit.value,
        measured=found.value,
        error=verdict.error,
        tolerance=verdict.tolerance,
        kind="discretisation",
        reason=verdict.reason,
        status=verdict.status,
        order=found.order,
    )


def unit_of(quantity: str) -> str:
    """SI unit of a quantity; degrees for an angle."""
    more = {
        "deepest_approach": "m",
        "largest_force": "N",
        "contact_duration": "s",
        "tangential_velocity": "m/s",
    }
    return (UNITS | more).get(quantity, "1")


def failed_row(
    benchmark: Benchmark, variant: str, engine: str, reason: str, status: str = "error"
) -> Comparison:
    """The row of a series that could not be run."""
    nan = math.nan
    return Comparison(
        benchmark.name, variant, engine, "run", "", "1", nan, nan, nan, nan, "precision", reason, status
    )


def convergences_of(benchmark: Benchmark, series: Series) -> list[Convergence]:
    """The levels of a few members, for the plots: of the Hertz contact of the first material."""
    if series.contact.model != "hertz" or series.material is not benchmark.material[0]:
        return []
    if (
        benchmark.sweep.kind == "restitution"
        and series.contact.restitution not in benchmark.sweep.values[1::2]
    ):
        return []
    quantity = {"normal": "deepest_approach", "restitution": "restitution", "spin": "restitution"}.get(
        benchmark.sweep.kind, "tangential_restitution"
    )
    members = sorted({k for key, k in series.limits if key == quantity})
    picked = members[:: max(1, len(members) // DRAWN)][:DRAWN]
    records = []
    for k in picked:
        limit = series.limits[quantity, k]
        values = [level[quantity, k] for level in series.measured]
        if quantity == "tangential_restitution":
            normal = float(normal_speeds(benchmark)[k])
            law = law_of(benchmark, series.contact, series.engine)
            rebound = integrated(law, normal, float(tangential_speeds(benchmark)[k]))
            target = rebound_values(benchmark, rebound, k)[quantity]
        else:
            target = impact_targets(benchmark, series.contact)[quantity].limit.value
        own = benchmark.sweep.kind == "restitution"
        member = benchmark.sweep.values.index(series.contact.restitution) if own else k
        label = member_name(benchmark, member) or "hertz"
        means = tuple(float(v.mean()) for v in values)
        spreads = tuple(float(np.ptp(v)) / 2.0 for v in values)
        records.append(
            Convergence(
                benchmark.name, label, series.engine, quantity, unit_of(quantity), "time step", series.levels,
                means, spreads, limit.value, limit.uncertainty, limit.order, target,
            )
        )  # fmt: skip
    return records
