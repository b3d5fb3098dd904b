"""Studies as they are printed, on the page and in Markdown: one unit for a column, digits from the error.

What a study found is `studies/`; the drawing of its charts is `charts.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from markupsafe import Markup

from cmpcheck.display import number, printable, scale, uncertain
from cmpcheck.drawings import Drawings
from cmpcheck.results import Column, Estimate, StudyResult, SuiteResult, Table
from cmpcheck.studies.tables import csv_names


class PrintedTable(NamedTuple):
    """A table with every cell as text."""

    caption: str
    header: list[str]
    rows: list[list[str]]
    numeric: list[bool]  # by column
    file: str  # its CSV file in data/studies/, "" if it has none


class PrintedStudy(NamedTuple):
    """A study as it stands on the page."""

    anchor: str
    number: str
    result: StudyResult
    tables: list[PrintedTable]
    panels: list[tuple[Markup, str]]  # figure and caption


def printed_studies(result: SuiteResult, drawings: Drawings) -> list[PrintedStudy]:
    """Every study with its tables as text and its charts as figures, which are noted in `drawings`."""
    from cmpcheck.charts import chart_figure

    return [
        PrintedStudy(
            f"study-{k}",
            f"S.{k}",
            study,
            printed_tables(study),
            [
                (drawings.note(chart_figure, chart, f"s{k}.{place}"), chart.caption)
                for place, chart in enumerate(study.charts)
            ],
        )
        for k, study in enumerate(result.studies, start=1)
    ]


def printed_tables(study: StudyResult) -> list[PrintedTable]:
    """The study's tables with every cell as text."""
    return [printed_table(table, file) for table, file in zip(study.tables, csv_names(study), strict=True)]


def printed_table(table: Table, file: str = "") -> PrintedTable:
    """A table with every cell as text; `file` is its CSV, "" if there is none."""
    header, cells, numeric = [], [], []
    for k, column in enumerate(table.columns):
        name, texts = _column(column, [row[k] for row in table.rows])
        header.append(name)
        cells.append(texts)
        numeric.append(not any(isinstance(row[k], str) and row[k] for row in table.rows))
    return PrintedTable(
        printable(table.caption), header, [list(row) for row in zip(*cells, strict=True)], numeric, file
    )


def _column(column: Column, cells: list[str | float | Estimate]) -> tuple[str, list[str]]:
    """Heading and texts, all numbers in the unit that suits the largest."""
    values = [cell.value if isinstance(cell, Estimate) else cell for cell in cells]
    sizes: Iterable[float] = (abs(v) for v in values if not isinstance(v, str) and math.isfinite(v))
    factor, unit = scale(max(sizes, default=0.0), column.unit)
    name = printable(f"{column.name} ({unit})" if unit else column.name)
    return name, [_text(cell, factor) for cell in cells]


def _text(cell: str | float | Estimate, factor: float) -> str:
    if isinstance(cell, Estimate):
        return uncertain(cell.value * factor, cell.standard_error * factor)
    if isinstance(cell, str):
        return printable(cell)
    return "" if math.isnan(cell) else number(cell * factor, 4)
