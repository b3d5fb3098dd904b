"""How exactly a file gives its numbers: half a unit in the last place, of text and of binary numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np

SAMPLE = 3000  # numbers of a group that are looked at: a program writes all with one format
LONGEST = 400  # characters of a number; it has 17 digits that count, and an exponent
NUMBER = re.compile(r"[-+]?(\d*)\.?(\d*)(?:[eEdD]([-+]?\d+))?")


def text_resolution(groups: Mapping[str, Sequence[str]], largest: Mapping[str, float]) -> dict[str, float]:
    """Half a unit in the last place of groups of columns that were written as text.

    Parameters: groups, numbers as written, by group; largest, the greatest magnitude of each.
    Where a group has the same number (two or more) of decimals everywhere, that is its format.  Otherwise the
    file has a number of significant digits, the most that any of its numbers shows: trailing zeros may have
    been left out, as repr and %g do, so that a single number says little.

    >>> text_resolution({"v": ["0.500", "0.123"]}, {"v": 0.5})
    {'v': 0.0005}
    >>> text_resolution({"v": ["0.5"], "x": ["1.23456"]}, {"v": 0.5, "x": 1.23456})
    {'v': 5e-07, 'x': 5e-06}
    """
    parts = {name: [_split(text) for text in _sample(texts)] for name, texts in groups.items()}
    significant = max((s for numbers in parts.values() for s, _ in numbers), default=17)
    found = {}
    for name, numbers in parts.items():
        decimals = {d for _, d in numbers}
        fixed = decimals.pop() if len(decimals) == 1 else None
        if fixed is not None and fixed >= 2:
            found[name] = 0.5 * 10.0**-fixed
        else:
            found[name] = 0.5 * _unit_of_last(largest[name], min(significant, 17))
        found[name] = max(found[name], binary_resolution(largest[name], np.dtype(float)))
    return found


def binary_resolution(largest: float, dtype: np.dtype) -> float:
    """Half a unit in the last place of numbers up to `largest`; integers are exact."""
    if dtype.kind != "f":
        return 0.0
    return 0.5 * float(np.finfo(dtype).eps) * abs(largest)


def _unit_of_last(value: float, significant: int) -> float:
    if value == 0.0:
        return 0.0
    return 10.0 ** (math.floor(math.log10(abs(value))) - significant + 1)


def _sample(texts: Sequence[str]) -> Sequence[str]:
    return texts[:: max(1, len(texts) // SAMPLE)]


def _split(text: str) -> tuple[int, int | None]:
    """Significant digits, and decimals (None with an exponent), of a number as written."""
    match = NUMBER.fullmatch(text.strip()) if len(text) <= LONGEST else None
    if match is None:
        return 0, None
    whole, part, exponent = match.groups()
    digits = (whole + part).lstrip("0")
    return len(digits), None if exponent else len(part)
