"""Tables of rows (time, particle, x, y, z, ...): CSV and Parquet.

CSV: lines `# units: micro` (also time_step, contact_duration) above the line with the names of the columns.
Parquet: the same keys in the schema's metadata, or in the attributes that pandas keeps there.
"""

from __future__ import annotations

import io
import json
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from cmpcheck.trajectories.digits import binary_resolution, text_resolution
from cmpcheck.trajectories.frames import (
    COLUMNS,
    DECLARED,
    POSITION,
    VELOCITY,
    Frames,
    canonical,
    check_numbers,
    declare,
    rename,
    shown,
    unusable,
)
from reference.toml_source import CaseError, one_line

SEPARATORS = (",", ";", "\t")


def read_csv(path: Path) -> Frames:
    """A CSV file.  Raises CaseError in one line, OSError where the file cannot be read."""
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise CaseError(f"{path}: not UTF-8 text; allowed: a CSV file with the columns {_names()}") from None
    header = [line[1:] for line in lines if line.startswith("#")]
    body = [line for line in lines if line.strip() and not line.startswith("#")]
    said = [
        (key.strip().lower(), value.strip()) for key, _, value in (line.partition(":") for line in header)
    ]
    declared = declare(path, said)
    if len(body) < 2:
        raise CaseError(
            f"{path}: no rows; allowed: a line with the names of the columns, and a row for each time"
        )
    separator = next((sign for sign in SEPARATORS if sign in body[0]), r"\s+")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # a row with more values than columns
            table = pd.read_csv(
            io.StringIO("\n".join(body)), sep=separator, dtype=str, keep_default_na=False, index_col=False,
            skipinitialspace=True, quoting=3, on_bad_lines="error",
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError, pd.errors.ParserWarning) as problem:
        raise CaseError(f"{path}: not a table: {one_line(problem)}") from None
    known = {name: table[name] for name in table.columns if canonical(str(name)) in COLUMNS}
    texts = rename_texts(path, known)
    columns = {}
    for name, series in known.items():
        short = series.isna() | (series == "")
        if short.any():
            raise CaseError(
                f"{path}: row {int(short.to_numpy().argmax()) + 1} of the table has no {shown(name)}"
            )
        numbers = pd.to_numeric(series, errors="coerce").to_numpy(float)
        bad = unusable(numbers)
        if bad.any():
            row = int(bad.argmax())
            raise CaseError(
                f"{path}: row {row + 1} of the table: {name} = {shown(series.iloc[row])}; allowed: finite "
                "numbers"
            )
        columns[str(name)] = np.array(list(series), dtype=float)  # exact; pandas 2 is off in the last place
    groups = (("time",), POSITION, VELOCITY, ("mass",), ("diameter",))
    renamed = rename(path, columns)
    written = {
        "/".join(group): [text for name in group if name in texts for text in texts[name]] for group in groups
    }
    largest = {
        "/".join(group): max(
            (float(np.abs(renamed[name]).max()) for name in group if name in renamed), default=0.0
        )
        for group in groups
    }
    found = text_resolution({key: texts for key, texts in written.items() if texts}, largest)
    resolution = {name: value for key, value in found.items() for name in key.split("/")}
    return _by_time(path, renamed, resolution, declared)


def rename_texts(path: Path, known: dict[str, pd.Series]) -> dict[str, list[str]]:
    """The texts of the columns, under our names."""
    return {canonical(str(name)): [str(text) for text in series] for name, series in known.items()}


def read_parquet(path: Path) -> Frames:
    """A Parquet file.  Raises CaseError in one line."""
    try:
        described = pq.read_metadata(path)
        check_numbers(path, float(described.num_rows) * described.num_columns)
        table = pq.read_table(path, memory_map=False)
    except CaseError:
        raise
    except (pa.ArrowException, OSError, ValueError) as problem:
        raise CaseError(f"{path}: not a Parquet file: {one_line(problem)}") from None
    columns: dict[str, np.ndarray] = {}
    for field in table.schema:
        if canonical(field.name) not in COLUMNS:
            continue
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            raise CaseError(f"{path}: the column {shown(field.name)} holds {field.type}; allowed: numbers")
        columns[field.name] = table[field.name].to_numpy()
    resolution = {
        canonical(name): binary_resolution(float(np.nanmax(np.abs(values), initial=0.0)), values.dtype)
        for name, values in columns.items()
    }
    said = {key.decode("utf-8", "replace"): value for key, value in (table.schema.metadata or {}).items()}
    found = [(key, said[key].decode("utf-8", "replace")) for key in DECLARED if key in said]
    found += [(key, str(value)) for key, value in _attributes(said).items() if key in DECLARED]
    doubles = {name: values.astype(float) for name, values in columns.items()}
    for name, values in doubles.items():
        bad = unusable(values)
        if bad.any():
            raise CaseError(
                f"{path}: row {int(bad.argmax()) + 1}: {name} is not finite; allowed: finite numbers"
            )
    return _by_time(path, rename(path, doubles), resolution, declare(path, found))


def _attributes(metadata: dict[str, bytes]) -> dict[str, object]:
    """`DataFrame.attrs`: beside pandas's description of the columns, or by themselves (pandas 2)."""
    found: dict[str, object] = {}
    for text, key in ((metadata.get("PANDAS_ATTRS"), None), (metadata.get("pandas"), "attributes")):
        try:
            said = json.loads(text or b"{}")
            said = said.get(key) if key else said
        except (ValueError, AttributeError, RecursionError):
            continue
        found |= said if isinstance(said, dict) else {}
    return found


def _by_time(
    path: Path, columns: dict[str, np.ndarray], resolution: dict[str, float], declared: dict[str, str]
) -> Frames:
    """Rows cut where the time changes, which the file may have in any order of particles."""
    if "time" not in columns:
        raise CaseError(f"{path}: no column time; known columns: {_names()}")
    time = columns.pop("time")
    cuts = np.flatnonzero(np.diff(time)) + 1
    starts = np.concatenate([[0], cuts]).astype(int) if len(time) else np.zeros(0, int)
    frames = [
        {name: values[begin:end] for name, values in columns.items()}
        for begin, end in zip(starts, [*cuts, len(time)], strict=True)
    ]
    return Frames(path, time[starts], frames, resolution, declared)


def _names() -> str:
    return ", ".join(COLUMNS)
