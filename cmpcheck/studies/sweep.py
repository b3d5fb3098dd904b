"""Polishing at several settings with the same samples: flatness, removals and volume, and how they change.

Each study that varies one thing and asks what becomes of the result is a list of settings for `sweep`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import pandas as pd

from cmpcheck.results import Column, Curve, Estimate, Table
from cmpcheck.statistics import relative_differences
from cmpcheck.studies.sampling import estimate, final_row, sample_rows
from reference.case import Case

ABSOLUTE, RELATIVE = ("flatness",), ("removals", "removed_volume")
NAMES = {"flatness": "Π(T)", "removals": "removals", "removed_volume": "removed volume"}
UNITS = {"flatness": "1", "removals": "1", "removed_volume": "m3"}


@dataclass(frozen=True)
class Setting:
    """One row: what stands in its first columns, its case, and what a run of it is asked for."""

    cells: tuple[str | float, ...]
    case: Case
    observe: Callable[[Case], pd.Series] = final_row


@dataclass(frozen=True)
class Found:
    """What the samples of one setting gave, and by how much it differs from the setting compared with."""

    setting: Setting
    rows: pd.DataFrame
    mean: dict[str, Estimate]
    difference: dict[str, Estimate]  # of Pi; of the others in parts of the base's mean


def sweep(settings: Sequence[Setting], base: int, samples: int) -> list[Found]:
    """Run the same samples at every setting; differences are to the setting number `base`, by seed."""
    frames = [sample_rows(setting.case, samples, setting.observe) for setting in settings]
    found = []
    for setting, rows in zip(settings, frames, strict=True):
        difference = {q: estimate(rows[q] - frames[base][q]) for q in ABSOLUTE}
        difference |= {q: estimate(relative_differences(rows[q], frames[base][q])) for q in RELATIVE}
        mean = {q: estimate(rows[q]) for q in (*ABSOLUTE, *RELATIVE)}
        found.append(Found(setting, rows, mean, difference))
    return found


def sweep_table(
    caption: str,
    head: Sequence[Column],
    found: Sequence[Found],
    base: str,
    extra: Mapping[str, Column] = MappingProxyType({}),
) -> Table:
    """The table of a sweep.

    Parameters: head, the columns of the settings' cells; base, what the differences are to; extra, more
    columns by the names of what was observed.
    """
    columns = [*head, Column("seeds")]
    for q in NAMES:
        columns.append(Column(NAMES[q], UNITS[q]))
        columns.append(Column(f"change of {NAMES[q]}", "1" if q in ABSOLUTE else "%"))
    columns += extra.values()
    rows = []
    for one in found:
        row: list[str | float | Estimate] = [*one.setting.cells, float(len(one.rows))]
        for q in NAMES:
            change = one.difference[q]
            row += [one.mean[q], change if q in ABSOLUTE else Estimate(*(100 * x for x in change))]
        rows.append((*row, *(estimate(one.rows[name]) for name in extra)))
    return Table(f"{caption}; changes from {base}", tuple(columns), tuple(rows))


def curve(label: str, found: Sequence[Found], quantity: str, place: int) -> Curve:
    """Means with error bars of one standard error, over the numbers in column `place` of the cells."""
    means = [one.mean[quantity] for one in found]
    return Curve(
        label,
        tuple(float(one.setting.cells[place]) for one in found),
        tuple(m.value for m in means),
        tuple(m.value - m.standard_error for m in means),
        tuple(m.value + m.standard_error for m in means),
        "points",
    )
