"""The units of a trajectory file: declared in its header, by an option, or refused."""

from __future__ import annotations

from dataclasses import dataclass

from reference.units import to_si

STYLES = {  # of LAMMPS: length, time, mass, velocity
    "si": ("m", "s", "kg", "m/s"),
    "cgs": ("cm", "s", "g", "cm/s"),
    "micro": ("um", "us", "pg", "um/us"),
    "nano": ("nm", "ns", "ag", "nm/ns"),
}
SMALLEST = 1e-30  # of a unit in SI
SI = {"length": "m", "time": "s", "mass": "kg", "velocity": "m/s"}
ALLOWED = (
    f"allowed: {', '.join(STYLES)}, or the units themselves, as in length=um,time=us,mass=pg (and "
    "velocity=m/s where it is not length over time)"
)


@dataclass(frozen=True)
class Units:
    """SI values of the units."""

    length: float
    time: float
    mass: float
    velocity: float

    def of(self, column: str) -> float:
        """The unit of a column."""
        if column in ("x", "y", "z", "diameter"):
            return self.length
        return {"time": self.time, "mass": self.mass, "particle": 1.0}.get(column, self.velocity)


def parse_units(text: str) -> Units:
    """Units from a name or a list.  Raises ValueError saying what is wrong and what is allowed.

    >>> parse_units("length=um, time=us, mass=pg") == parse_units("micro")
    True
    """
    name = text.strip().lower()
    if name in STYLES:
        return Units(*(to_si(f"1 {unit}", si) for unit, si in zip(STYLES[name], SI.values(), strict=True)))
    given: dict[str, str] = {}
    for part in text.split(","):
        key, equals, unit = (piece.strip() for piece in part.partition("="))
        if not equals or key not in SI or key in given or not unit:
            raise ValueError(f"units {text[:60]!r}: {ALLOWED}")
        given[key] = unit
    missing = [key for key in ("length", "time", "mass") if key not in given]
    if missing:
        raise ValueError(f"units {text[:60]!r}: no {', '.join(missing)}; {ALLOWED}")
    try:
        found = {key: to_si(f"1 {unit}", SI[key]) for key, unit in given.items()}
    except ValueError as problem:
        raise ValueError(f"units {text[:60]!r}: {problem}; {ALLOWED}") from None
    if not all(SMALLEST <= value <= 1.0 / SMALLEST for value in found.values()):
        raise ValueError(
            f"units {text[:60]!r}: a unit is not between {SMALLEST:g} and its inverse in SI; {ALLOWED}"
        )
    found.setdefault("velocity", found["length"] / found["time"])
    return Units(**found)


def duration(text: str, units: Units) -> float:
    """A time in s: a number in the file's unit, or a text with its own.  Raises ValueError."""
    try:
        number = float(text) * units.time
    except ValueError:
        number = to_si(text, "s")
    if not 0.0 <= number < float("inf"):
        raise ValueError("not a finite time >= 0")
    return number
