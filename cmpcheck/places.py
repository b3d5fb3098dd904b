"""Where on a surface an engine departs: restitution and impulse at each place, and what would explain them.

A mesh wall is a set of triangles; a sphere near an edge is near two of them.  An engine that adds the forces
of N has N springs and dashpots where the model has one.  N follows from the restitution that came out;
nothing here knows which engine does so, or where.  The rows are judged already (`compare.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from cmpcheck.fixes.calibration import damping_ratio
from cmpcheck.results import Column, Comparison, Estimate, Table
from cmpcheck.verdicts import REFERENCE, WORDS, standing, worst_first

NAN = float("nan")
COLUMNS = (
    Column("place"),
    Column("engine"),
    Column("restitution asked for"),
    Column("measured"),
    Column("error of the impulse (%)"),
    Column("springs at once"),
    Column("verdict"),
)


def springs_at_once(asked: float, measured: float, uncertainty: float) -> Estimate | None:
    """How many equal springs and dashpots, acting at once, turn a restitution into the measured one.

    N of them are one with N k and N c: its damping ratio is sqrt(N) times theirs, so N = (z(measured) /
    z(asked))^2 (`calibration.damping_ratio`), to first order in the uncertainty.  None where a damping ratio
    does not tell: e = 1 has none, and e = 0 needs an infinite one.

    >>> round(springs_at_once(0.8, 0.7335104, 0.0).value, 2)
    2.0
    """
    if not (0.0 < asked < 1.0 and uncertainty < measured < 1.0 - uncertainty):
        return None
    z = damping_ratio(asked)
    low, middle, high = (
        (damping_ratio(e) / z) ** 2 for e in (measured + uncertainty, measured, measured - uncertainty)
    )
    return Estimate(middle, (high - low) / 2.0)


def contact_places(rows: Iterable[Comparison]) -> list[Table]:
    """A table of places for cases that drop a particle at several; none for others.

    A place is a variant whose rows tell a normal impulse; the engines' forms of contact stand apart.
    """
    places: dict[tuple[str, str], list[Comparison]] = {}
    for row in rows:
        if row.engine != REFERENCE and row.quantity in ("restitution", "normal_impulse"):
            places.setdefault((place_of(row), row.engine), []).append(row)
    shown = {key: found for key, found in places.items() if any(r.status != "not_tested" for r in found)}
    if len({place.split(", ")[0] for place, _ in shown}) < 2 or not any(
        row.status == "disagree" for found in shown.values() for row in found
    ):
        return []
    lines = tuple(_line(place, engine, found) for (place, engine), found in shown.items())
    return [Table(_caption(shown), COLUMNS, lines)]


def place_of(row: Comparison) -> str:
    """The variant of a row without the particle or impact that it names."""
    return ", ".join(part for part in row.variant.split(", ") if not part.startswith(("particle", "impact")))


def _line(place: str, engine: str, rows: Sequence[Comparison]) -> tuple[str | float | Estimate, ...]:
    bounce = next((row for row in rows if row.quantity == "restitution"), None)
    impulses = [row for row in rows if row.quantity == "normal_impulse" and row.reference]
    worst = max((100.0 * (row.measured / row.reference - 1.0) for row in impulses), key=abs, default=NAN)
    counted: str | Estimate = ""
    if bounce is not None and bounce.status == "disagree":
        counted = springs_at_once(bounce.reference, bounce.measured, bounce.tolerance) or ""
    gravest = worst_first(rows)[0]
    asked, measured = (bounce.reference, bounce.measured) if bounce else (NAN, NAN)
    return place, engine, asked, measured, worst, counted, WORDS[standing(gravest)]


def _caption(places: dict[tuple[str, str], list[Comparison]]) -> str:
    """One sentence on what departs where, made from the rows."""
    parts = []
    for (place, engine), rows in places.items():
        bounce = next((row for row in rows if row.quantity == "restitution"), None)
        if bounce is None or bounce.status != "disagree":
            continue
        counted = springs_at_once(bounce.reference, bounce.measured, bounce.tolerance)
        text = f"{engine} returns {bounce.measured:.3f} instead of {bounce.reference:g} at {place}"
        if counted is not None and abs(counted.value - round(counted.value)) <= 2.0 * counted.standard_error:
            text += f", as {round(counted.value)} equal springs and dashpots at once would"
        parts.append(text)
    if not parts:
        return "Restitution and impulse at each place"
    return f"Restitution and impulse at each place: {'; '.join(parts)}"
