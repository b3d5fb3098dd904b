"""SHA-256 of what a command has written, array by array, without wall-clock times: is it the same?

Which runs are compared is the business of the modules `reliability_*.py`.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

TIMES = ("timing", "seconds", "surface_read_seconds", "stepping_seconds")  # of the wall clock


def digests_of(folder: Path) -> dict[str, str]:
    """Of every array, column and record of the runs below a folder, by file and name."""
    found: dict[str, str] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and not p.name.startswith(".")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".h5":
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
            with h5py.File(path) as file:
                found |= {f"{name}/{key}": array_digest(file[key][()]) for key in file}
        elif path.suffix == ".parquet":
            found |= table_digests(name, pd.read_parquet(path))
        elif path.suffix == ".json":
            found[name] = json_digest(json.loads(path.read_text("utf-8")))
        else:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def table_digests(name: str, table: pd.DataFrame) -> dict[str, str]:
    """Of every column."""
    return {f"{name}/{column}": array_digest(table[column].to_numpy()) for column in table}


def array_digest(array: np.ndarray) -> str:
    """Of an array's type, shape and bytes; of texts, of the texts."""
    data = repr(array.tolist()).encode() if array.dtype == object else np.ascontiguousarray(array).tobytes()
    return hashlib.sha256(f"{array.dtype}{array.shape}".encode() + data).hexdigest()


def json_digest(document: Any) -> str:
    """Of a record without its wall-clock times."""
    return hashlib.sha256(json.dumps(_without_times(document), sort_keys=True).encode()).hexdigest()


def _without_times(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_times(inner) for key, inner in value.items() if key not in TIMES}
    if isinstance(value, list):
        return [_without_times(inner) for inner in value]
    return value
