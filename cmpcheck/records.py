"""The records of `results.py` as JSON and back: the same types and, bit for bit, the same numbers.

For results that are kept between processes.  Reading makes those records and nothing else, whatever a file
says; what a person or another program reads is written by `report.py`.
"""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from typing import Any

from cmpcheck import results

KIND = "$"  # key of the name of a record
RECORDS: dict[str, type] = {
    name: found
    for name, found in vars(results).items()
    if isinstance(found, type) and (is_dataclass(found) or hasattr(found, "_fields"))
}


def to_json(found: Any) -> str:
    """A record, or a list of records, as JSON; NaN and infinity are the words that Python reads."""
    return json.dumps(_plain(found), ensure_ascii=False)


def from_json(text: str) -> Any:
    """What `to_json` was given; lists outside of records become tuples.

    Raises ValueError, KeyError or TypeError for anything else.
    """
    return _record(json.loads(text))


def settled(found: Any) -> Any:
    """The record as it comes back from a file: numbers of NumPy become Python's."""
    return from_json(to_json(found))


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, str | bool):
        return value
    if type(value).__name__ in RECORDS:
        names = [field.name for field in fields(value)] if is_dataclass(value) else value._fields
        return {KIND: type(value).__name__} | {name: _plain(getattr(value, name)) for name in names}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    if hasattr(value, "item"):  # of NumPy
        return value.item()
    if isinstance(value, int | float):
        return value
    raise TypeError(f"{type(value).__name__} is no part of a result")


def _record(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(_record(inner) for inner in plain)
    if not isinstance(plain, dict):
        return plain
    kind = RECORDS[plain[KIND]]
    values = {name: _record(inner) for name, inner in plain.items() if name != KIND}
    if is_dataclass(kind):
        lists = [field.name for field in fields(kind) if field.default_factory is list]
        values |= {name: list(values[name]) for name in lists}
    return kind(**values)
