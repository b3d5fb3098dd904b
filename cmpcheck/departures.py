"""Known departures of engines: a versioned list, and what it makes of the rows that were compared.

The list is `known_departures.toml`; how a row was judged is `compare.py` and the ensembles.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.version import InvalidVersion, Version
from pydantic import AfterValidator, Field, ValidationError, model_validator

from cmpcheck.engines import ENGINES
from cmpcheck.engines.lammps_setup import departure_deck
from cmpcheck.results import Comparison
from reference.case_sections import Section
from reference.toml_source import MISSING, Refusal, TomlSource, nearest
from reference.units import Quantity

KNOWN = Path(__file__).with_name("known_departures.toml")
Size = Annotated[float, Quantity()]
Text = Annotated[str, Field(min_length=1)]


def _specifiers(text: str) -> str:
    try:
        SpecifierSet(text)
    except InvalidSpecifier:
        raise ValueError("allowed: version specifiers such as '>=20250722, <20260101'") from None
    return text


def _engine(name: str) -> str:
    if name not in ENGINES:
        raise ValueError(nearest(name, ENGINES))
    return name


class Departure(Section):
    """[[departure]]: where an engine departs from the model, by how much, and what shows it alone."""

    name: Text
    engine: Annotated[str, AfterValidator(_engine)]
    versions: Annotated[str, AfterValidator(_specifiers)]
    case: Text
    variant: str  # of the row; * stands for any text
    quantity: Text
    measure: Literal["relative", "absolute"]  # of low and high: parts of the reference, or SI
    low: Size  # smallest and largest measured - reference
    high: Size
    reason: Text
    deck: Text | None = None  # in lammps_inputs/departures, at most 30 lines
    upstream: Text | None = None

    @model_validator(mode="after")
    def _join(self) -> Departure:
        if self.low > self.high:
            raise Refusal(("low",), self.low, f"allowed: <= high, {self.high:g}")
        if self.low <= 0.0 <= self.high:
            raise Refusal(("high",), self.high, "allowed: an interval without 0, which is no departure")
        if (self.deck is None) == (self.upstream is None):
            raise Refusal((), MISSING, "allowed: either deck or upstream")
        if self.deck is not None and not departure_deck(self.deck).is_file():
            raise Refusal(("deck",), self.deck, "no such file in lammps_inputs/departures")
        return self

    def concerns(self, row: Comparison, version: str) -> bool:
        """Whether the row is what this entry speaks of, in this version of the engine."""
        names = (row.engine, row.case, row.quantity) == (self.engine, self.case, self.quantity)
        if not names or not fnmatchcase(row.variant, self.variant):
            return False
        try:
            return Version(version) in SpecifierSet(self.versions)  # last, for reading it takes longest
        except InvalidVersion:
            return False

    def size(self, row: Comparison) -> float:
        """Measured minus reference, in the entry's measure."""
        difference = row.measured - row.reference
        if self.measure == "absolute":
            return difference
        return difference / abs(row.reference) if row.reference else math.inf

    def judge(self, row: Comparison) -> Comparison:
        """The row as the list leaves it.

        A disagreement of the listed size is known.  One of another size, and an agreement, are a
        disagreement with the list.  A row without verdict neither confirms nor refutes it.
        """
        size, part = self.size(row), " of the reference" if self.measure == "relative" else f" {row.unit}"
        listed = f"the known departure {self.name!r} of {self.low:.3g} to {self.high:.3g}{part}"
        if row.status == "disagree" and self.low <= size <= self.high:
            return replace(row, known_departure=f"{self.name}: {self.reason} ({self.deck or self.upstream})")
        if row.status == "disagree":
            return replace(row, reason=f"{row.reason}; outside {listed}: it is {size:.3g}")
        if row.status == "agree":
            reason = f"{listed} no longer occurs: it is {size:.3g}; {row.reason}"
            return replace(row, status="disagree", reason=reason)
        if row.status == "not_tested":
            return replace(row, reason=f"{row.reason}; neither confirms nor refutes {listed}")
        return row


class Departures(Section):
    """The whole file."""

    departure: tuple[Departure, ...] = ()


@cache
def load_departures(path: Path = KNOWN) -> tuple[Departure, ...]:
    """The entries of a file.  Raises CaseError, one line naming file, key, value and what is allowed."""
    source = TomlSource(path)
    try:
        return Departures.model_validate(source.data).departure
    except ValidationError as problem:
        raise source.translate(problem) from None


def apply_departures(
    rows: Iterable[Comparison], versions: Mapping[str, str], departures: Iterable[Departure] | None = None
) -> list[Comparison]:
    """The rows, each judged by the first entry that concerns it.

    Parameters: versions of the engines by name; departures, by default those that ship.
    """
    entries = load_departures() if departures is None else tuple(departures)

    def judged(row: Comparison) -> Comparison:
        version = versions.get(row.engine, "")
        entry = next((entry for entry in entries if entry.concerns(row, version)), None)
        return entry.judge(row) if entry else row

    return [judged(row) for row in rows]
