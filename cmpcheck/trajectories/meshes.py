"""Series of VTK files, read by meshio: a .pvd index, or ParaView's .series; one file for each time.

The index may say its units: an attribute units="si" of the first element of .pvd, a key "units" in .series.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
from pathlib import Path, PurePath
from typing import Any
from xml.etree import ElementTree

import meshio
import numpy as np

from cmpcheck.trajectories.digits import binary_resolution, text_resolution
from cmpcheck.trajectories.frames import (
    DECLARED,
    LARGEST,
    MOST_TIMES,
    Frames,
    canonical,
    check_size,
    declare,
    shown,
    unusable,
)
from reference.toml_source import CaseError, one_line

READERS = {".vtu": meshio.vtu.read, ".vtk": meshio.vtk.read}
VECTORS = {"velocity", "vel", "v", "linvelvec"}  # names of the velocity, in lower case
ASCII_ARRAY = re.compile(rb"<DataArray[^>]*format=\"ascii\"[^>]*>([^<]*)<")
NUMBERS = re.compile(rb"[-+\d][\d.eE+-]*")


def read_series(path: Path) -> Frames:
    """A .pvd or .series file and the files that it names.  Raises CaseError in one line."""
    try:
        text = path.read_text("utf-8")
    except UnicodeDecodeError:
        raise CaseError(f"{path}: not UTF-8 text") from None
    listed, said = _pvd(path, text) if path.suffix == ".pvd" else _series(path, text)
    if not 0 < len(listed) <= MOST_TIMES:
        raise CaseError(f"{path}: names {len(listed)} files; allowed: 1 to {MOST_TIMES}")
    times, frames = [], []
    resolution: dict[str, float] = {}
    for time, name in listed:
        frame, exact = _read(_inside(path, name))
        times.append(time)
        frames.append(frame)
        for column, value in exact.items():
            resolution[column] = max(value, resolution.get(column, 0.0))
    declared = declare(path, ((key, str(said[key])) for key in DECLARED if key in said))
    seconds = text_resolution({"time": [repr(t) for t in times]}, {"time": max(map(abs, times))})
    return Frames(path, np.array(times), frames, resolution | seconds, declared)


def _pvd(path: Path, text: str) -> tuple[list[tuple[float, str]], dict[str, Any]]:
    """Times and files of a .pvd index; of several parts the first one."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CaseError(f"{path}: declares a document type; allowed: a plain .pvd index")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as problem:
        raise CaseError(f"{path}: not a .pvd index: {one_line(problem)}") from None
    sets: dict[float, dict[int, str]] = {}
    for entry in root.iter("DataSet"):
        try:
            time, part = float(entry.get("timestep", "")), int(entry.get("part", "0"))
            if not abs(time) <= LARGEST:
                raise ValueError
        except ValueError:
            raise CaseError(f"{path}: a DataSet whose timestep or part is not a number") from None
        sets.setdefault(time, {})[part] = entry.get("file", "")
    return [(time, parts[min(parts)]) for time, parts in sets.items()], dict(root.attrib)


def _series(path: Path, text: str) -> tuple[list[tuple[float, str]], dict[str, Any]]:
    """Times and files of a .series index."""
    try:
        said = json.loads(text)
        listed = [(float(entry["time"]), str(entry["name"])) for entry in said["files"]]
        if not all(abs(time) <= LARGEST for time, _ in listed):
            raise ValueError("a time is not finite")
    except (ValueError, KeyError, TypeError, RecursionError) as problem:
        raise CaseError(f"{path}: not a .series index: {one_line(problem)}") from None
    return listed, said


def _inside(path: Path, name: str) -> Path:
    """The file that an index names: beside it or below."""
    pure = PurePath(name)
    if not name or pure.is_absolute() or ".." in pure.parts or "\0" in name:
        raise CaseError(f"{path}: names the file {shown(name)}; allowed: a file beside it or below")
    if pure.suffix not in READERS:
        raise CaseError(
            f"{path}: names the file {shown(name)}; allowed: files ending in {' or '.join(READERS)}"
        )
    return path.parent / pure


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Columns of one file, and the resolution of each."""
    try:
        check_size(path)
        raw = path.read_bytes()
    except OSError as problem:
        raise CaseError(f"{path}: {problem.strerror}") from None
    try:
        with contextlib.redirect_stderr(io.StringIO()) as said:  # where meshio says what it leaves out
            mesh = READERS[path.suffix](str(path))
        if "Skipping" in said.getvalue():
            raise ValueError(said.getvalue())
        points, data = np.asarray(mesh.points), dict(mesh.point_data)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError("its points have no three coordinates")
    except Exception as problem:  # meshio's readers raise whatever the file makes them stumble over
        raise CaseError(f"{path}: not read: {type(problem).__name__}: {one_line(problem)}") from None
    columns: dict[str, np.ndarray] = dict(zip("xyz", points.T, strict=True))
    for name, values in data.items():
        array = np.asarray(values)
        if array.dtype.kind not in "fiu" or len(array) != len(points):
            continue
        if name.lower() in VECTORS and array.shape == points.shape:
            columns |= dict(zip(("vx", "vy", "vz"), array.T, strict=True))
        elif array.ndim == 1 or array.shape[1:] == (1,):
            ours = canonical(name)
            flat = array.reshape(-1)
            if ours in ("mass", "diameter", "particle"):
                columns[ours] = 2.0 * flat if name.lower() in ("radius", "radii") else flat
    for name, values in columns.items():
        if unusable(values).any():
            raise CaseError(f"{path}: {name} is not finite")
    resolution = {name: _resolution(values, _digits(raw, path.suffix)) for name, values in columns.items()}
    return {name: values.astype(float) for name, values in columns.items()}, resolution


def _digits(raw: bytes, suffix: str) -> list[str]:
    """Numbers of a file that holds them as text, [] for a binary one."""
    if suffix == ".vtu":
        found = b" ".join(ASCII_ARRAY.findall(raw))
    else:
        head, _, body = raw.partition(b"POINTS")
        found = body if b"ASCII" in head else b""
    return [text.decode() for text in NUMBERS.findall(found) if b"." in text or b"e" in text]


def _resolution(values: np.ndarray, written: list[str]) -> float:
    largest = float(np.abs(values).max(initial=0.0))
    exact = binary_resolution(largest, values.dtype)
    if values.dtype.kind == "f" and written:
        return max(exact, text_resolution({"": written}, {"": largest})[""])
    return exact
