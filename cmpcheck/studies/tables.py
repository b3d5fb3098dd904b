"""The tables of studies as data frames and CSV files; how they look on a page is `study_page.py`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from cmpcheck.results import Column, Estimate, StudyResult, Table


def csv_frame(table: Table) -> pd.DataFrame:
    """The table with a column of its own for each standard error; units stand in the names, in SI.

    Raises ValueError where two columns have the same name and unit.
    """
    if len({*table.columns}) < len(table.columns):
        raise ValueError(f"{table.caption}: two columns have one name; allowed: a name of its own for each")
    columns: dict[str, list[object]] = {}
    for k, column in enumerate(table.columns):
        cells = [row[k] for row in table.rows]
        errors: list[object]
        columns[_heading(column)] = [cell.value if isinstance(cell, Estimate) else cell for cell in cells]
        if any(isinstance(cell, Estimate) for cell in cells):
            errors = [cell.standard_error if isinstance(cell, Estimate) else None for cell in cells]
            columns[_heading(column._replace(name=f"{column.name}, standard error"))] = errors
    return pd.DataFrame(columns)


def frame_table(caption: str, frame: pd.DataFrame, units: Mapping[str, str]) -> Table:
    """A data frame as a table; units by column, SI, "1" where none is given."""
    columns = tuple(Column(str(name), units.get(str(name), "1")) for name in frame.columns)
    rows = (tuple(cell if isinstance(cell, str | Estimate) else float(cell) for cell in row)
            for row in frame.itertuples(index=False, name=None))  # fmt: skip
    return Table(caption, columns, tuple(rows))


def csv_names(result: StudyResult) -> list[str]:
    """The names of a study's CSV files, one for each of its tables."""
    if len(result.tables) == 1:
        return [f"{result.name}.csv"]
    return [f"{result.name}_{k + 1}.csv" for k in range(len(result.tables))]


def write_csv(results: Iterable[StudyResult], folder: Path) -> list[Path]:
    """Write every table of every study into `folder`; returns the files.  Raises OSError."""
    files = []
    for result in results:
        for name, table in zip(csv_names(result), result.tables, strict=True):
            folder.mkdir(parents=True, exist_ok=True)
            csv_frame(table).to_csv(folder / name, index=False, lineterminator="\n")
            files.append(folder / name)
    return files


def _heading(column: Column) -> str:
    return column.name if column.unit in ("", "1") else f"{column.name} ({column.unit})"
