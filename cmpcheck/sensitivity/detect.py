"""Which checks notice each seeded error, and the smallest size of it that any notices.

The checks themselves are `checks.py`; they run in the processes of `children.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cmpcheck.sensitivity.checks import Label, Noticed, only_new
from cmpcheck.sensitivity.children import Child, Died
from cmpcheck.sensitivity.mutants import Mutant

COARSE, FINE = 10.0, 1.25  # factors between sizes: on the way down, and where the search ends
SMALLEST = 1e-13  # of the size that a search starts with, near round-off
LARGER = 64.0  # times the first size, where a search upwards ends


def evaluate(
    child: Child, mutants: Sequence[Mutant], number: int | None, size: float, labels: Sequence[Label]
) -> list[Noticed]:
    """The rows that are bad while an error is on; a run that does not end, or kills its process, is one too.

    Raises RuntimeError when the checks themselves cannot be made.
    """
    request = {"do": "rows", "number": number, "size": size, "labels": [list(label) for label in labels]}
    try:
        reply = ask_twice(child, request)
    except Died as problem:
        if number is None:
            raise
        return [Noticed("process", "", "reference", str(problem), "error", None)]
    if reply["problem"]:
        raise RuntimeError(f"{'' if number is None else mutants[number].name}: {reply['problem']}")
    return [Noticed(**row) for row in reply["rows"]]


def first_noticing(
    child: Child, mutants: Sequence[Mutant], number: int, before: Sequence[Noticed], labels: Sequence[Label]
) -> list[Noticed]:
    """The rows that notice an error at its own size in the first of the labels, in order, that does."""
    for label in labels:
        found = only_new(evaluate(child, mutants, number, mutants[number].size, [label]), before)
        if found:
            return found
    return []


def ask_twice(child: Child, request: dict[str, Any]) -> dict[str, Any]:
    """The answer; who is killed from outside is not killed twice.  Raises Died after the second time."""
    try:
        return child.ask(request)
    except Died:
        return child.ask(request)


def record(mutant: Mutant, found: Sequence[Noticed]) -> dict[str, Any]:
    """What notices an error, as it is kept."""
    checks = sorted({row.check for row in found})
    worst = max(
        (row.ratio for row in found if row.ratio is not None and math.isfinite(row.ratio)), default=None
    )
    return {"size": mutant.size, "by": checks, "rows": len(found), "largest_ratio": worst}


def noticing(found: Sequence[Noticed], labels: Sequence[Label]) -> list[Label]:
    """The variants whose rows notice an error: all that a search for its smallest size has to run."""
    names = {(row.case, row.variant.split(", ")[0]) for row in found}
    cases = {row.case for row in found}
    own = [label for label in labels if label in names or (label[0] in cases and not label[1])]
    return own or list(labels)


def smallest(
    child: Child, mutants: Sequence[Mutant], number: int, found: Sequence[Noticed],
    before: Sequence[Noticed], labels: Sequence[Label],
) -> dict[str, Any]:  # fmt: skip
    """The smallest size that is noticed, by factors of 10 and then by bisection of its logarithm.

    What does not notice a size is not asked about smaller ones.
    Returns {"size", "not_noticed", "by", "evaluations"}: `size` is None where none is noticed up to LARGER
    times the first; `not_noticed` is the largest size below it that was not, None where there was none.
    """
    mutant, tries = mutants[number], 0
    own = noticing(found, labels) if found else list(labels)

    def at(size: float) -> list[Noticed]:
        nonlocal tries, own
        tries += 1
        rows = only_new(evaluate(child, mutants, number, size, own), before)
        if rows:
            own = noticing(rows, own)
        return rows

    high, seen, low = mutant.size, list(found), None
    while not seen and high < LARGER * mutant.size:
        low, high = high, 2.0 * high
        seen = at(high)
    if not seen:
        return {"size": None, "not_noticed": high, "by": [], "evaluations": tries}
    while low is None and high > SMALLEST * mutant.size:
        rows = at(high / COARSE)
        if rows:
            high, seen = high / COARSE, rows
        else:
            low = high / COARSE
    while low is not None and high / low > FINE:
        middle = math.sqrt(low * high)
        rows = at(middle)
        if rows:
            high, seen = middle, rows
        else:
            low = middle
    by = sorted({row.check for row in seen})
    return {"size": high, "not_noticed": low, "by": by, "evaluations": tries}
