"""What changed between two reports of one request: row by row, and in what they were made with.

Both are documents of `report.json`.  Which request a report came from is `request.py`'s business; how changes
are told `rerun_words.py`'s.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

CHANGES = ("identical", "round-off", "value", "verdict", "gone", "new")
# Each step of a run rounds a value by eps = 2^-52 of itself at most, and nothing that is compared takes more
# than 2^26 = 6.7e7 steps: what rounding alone may have changed is 2^-26 of the value.
ROUND_OFF = 2.0**-26
NUMBERS = ("reference", "measured", "error", "tolerance", "order")
ORIGINS = (
    "cmpcheck", "commit", "sources", "python", "versions", "machine", "cases", "benchmarks", "decks",
    "request",
)  # fmt: skip


class Side(NamedTuple):
    """A row as one of the reports has it."""

    status: str
    reference: float | None
    measured: float | None
    tolerance: float | None


@dataclass(frozen=True)
class RowChange:
    """What became of one row."""

    case: str
    variant: str
    engine: str
    quantity: str
    unit: str
    change: str  # one of CHANGES
    before: Side | None
    after: Side | None


@dataclass(frozen=True)
class OriginChange:
    """One entry of provenance that differs; "" where a report has none."""

    key: str
    before: str
    after: str


@dataclass(frozen=True)
class Changes:
    """Everything that differs between two reports."""

    verdicts: tuple[str, str]
    rows: tuple[RowChange, ...]
    origins: tuple[OriginChange, ...]
    studies: tuple[str, ...]  # names of those that say something else

    @property
    def counts(self) -> dict[str, int]:
        """How many rows there are of each change."""
        found = Counter(row.change for row in self.rows)
        return {change: found[change] for change in CHANGES}

    @property
    def any(self) -> bool:
        """Whether a result changed by more than round-off."""
        same = self.counts["identical"] + self.counts["round-off"]
        return same < len(self.rows) or bool(self.studies)


def compare_reports(before: Mapping[str, Any], after: Mapping[str, Any]) -> Changes:
    """What changed from one report to the other."""
    ours, theirs = _keyed(before["comparisons"]), _keyed(after["comparisons"])
    rows = [_row_change(key, ours.get(key), theirs.get(key)) for key in dict.fromkeys([*ours, *theirs])]
    origins = _origins(before, after)
    return Changes(
        (before["verdict"], after["verdict"]), tuple(rows), tuple(origins), _studies(before, after)
    )


def _keyed(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, ...], Mapping[str, Any]]:
    """Rows by case, variant, engine and quantity, and by number where these occur more than once."""
    seen: Counter[tuple[str, ...]] = Counter()
    found = {}
    for row in rows:
        key = tuple(row[name] for name in ("case", "variant", "engine", "quantity"))
        seen[key] += 1
        found[*key, str(seen[key])] = row
    return found


def _row_change(
    key: tuple[str, ...], before: Mapping[str, Any] | None, after: Mapping[str, Any] | None
) -> RowChange:
    known = before or after
    assert known is not None
    case, variant, engine, quantity, _ = key
    change = _kind(before, after)
    return RowChange(case, variant, engine, quantity, known["unit"], change, _side(before), _side(after))


def _side(row: Mapping[str, Any] | None) -> Side | None:
    return None if row is None else Side(*(row[name] for name in Side._fields))


def _kind(before: Mapping[str, Any] | None, after: Mapping[str, Any] | None) -> str:
    """One of CHANGES."""
    if before is None or after is None:
        return "new" if before is None else "gone"
    if _standing(before) != _standing(after):
        return "verdict"
    if all(before.get(name) == after.get(name) for name in NUMBERS):
        return "identical"
    near = all(_is_near(before, after, name) for name in ("reference", "measured", "tolerance"))
    return "round-off" if near else "value"


def _standing(row: Mapping[str, Any]) -> tuple[str, bool]:
    return row["status"], bool(row.get("known_departure"))


def _is_near(before: Mapping[str, Any], after: Mapping[str, Any], name: str) -> bool:
    """Whether rounding may have made the difference; in a row that bounds rounding, its tolerance is it."""
    old, new = before.get(name), after.get(name)
    if old is None or new is None:
        return old is new
    scale = max(abs(before[n] or 0.0) for n in ("reference", "measured", "tolerance"))
    bound = ROUND_OFF * scale
    if before["kind"] == "rounding":
        bound = max(bound, before["tolerance"] or 0.0)
    return bool(abs(new - old) <= bound)


def _origins(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[OriginChange]:
    sides = []
    for document in (before, after):
        record = document.get("provenance", {})
        flat = _flat({name: record.get(name, {}) for name in ORIGINS})
        for engine in document.get("engines", []):
            flat[f"engines.{engine['name']}"] = engine["version"] if engine["available"] else "not available"
        sides.append(flat)
    ours, theirs = sides
    return [
        OriginChange(key, ours.get(key, ""), theirs.get(key, ""))
        for key in dict.fromkeys([*ours, *theirs])
        if ours.get(key, "") != theirs.get(key, "")
    ]


def _flat(value: Any, key: str = "") -> dict[str, str]:
    if not isinstance(value, Mapping):
        return {key: value if isinstance(value, str) else json.dumps(value)}
    parts = [_flat(inner, f"{key}.{name}" if key else str(name)) for name, inner in value.items()]
    return {name: text for part in parts for name, text in part.items()}


def _studies(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[str, ...]:
    sides = [
        {study["name"]: {**study, "seconds": 0.0} for study in document.get("studies", [])}
        for document in (before, after)
    ]
    names = dict.fromkeys([*sides[0], *sides[1]])
    return tuple(name for name in names if sides[0].get(name) != sides[1].get(name))
