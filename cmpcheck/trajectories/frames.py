"""A trajectory as a file holds it: frames with named columns, and what the file says of itself.

Here are the names of the columns and what makes frames one trajectory.  Formats are `tables.py`,
`dumps.py` and `meshes.py`; units `units.py`; what it has to do with a case, `starts.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from reference.toml_source import CaseError

POSITION, VELOCITY = ("x", "y", "z"), ("vx", "vy", "vz")
COLUMNS = {
    "time": "time of the row",
    "particle": "number of the particle; the case's order, from any first number",
    "x": "centre; wrapped into the periodic box or not",
    "y": "",
    "z": "",
    "vx": "velocity; by differences of the positions where there is none",
    "vy": "",
    "vz": "",
    "mass": "mass; that of the case where there is none, unless the case changes it",
    "diameter": "diameter; checked against the case's",
}
ALIASES = {
    "t": "time", "id": "particle", "atom_id": "particle", "radius": "diameter", "radii": "diameter",
    "xu": "x", "yu": "y", "zu": "z", "v_x": "vx", "v_y": "vy", "v_z": "vz",
}  # fmt: skip
TWICE = ("radius", "radii")  # half of a diameter
DECLARED = ("units", "time_step", "contact_duration")
SHOWN = 60  # characters of a text from a file
MOST_BYTES = 250_000_000  # of a file, which takes up to ten times as much memory while it is read
MOST_NUMBERS = 100_000_000  # in a file, which may be compressed; 800 MB
MOST_TIMES = 100_000  # files of a series
LARGEST = 1e50  # number in a file, whose squares are still numbers
FEWER = "fewer output times or particles, or single columns"


@dataclass
class Frames:
    """What was read, in the file's units: one mapping of columns to arrays (n,) for each time."""

    path: Path
    times: np.ndarray  # (T,)
    frames: list[dict[str, np.ndarray]]
    resolution: dict[str, float]  # half a unit in the last place of a column, "time" among them
    declared: dict[str, str] = field(default_factory=dict)  # of DECLARED
    time_is_step: bool = False  # the times are numbers of steps


@dataclass
class Columns:
    """A whole trajectory: the columns (T, N), particles in the order of their numbers."""

    path: Path
    times: np.ndarray
    values: dict[str, np.ndarray]
    resolution: dict[str, float]


def check_size(path: Path) -> None:
    """Refuse a file that is too large to be read into memory.  Raises CaseError, OSError where it is gone."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise CaseError(
            f"{path}: {size / 1e6:.0f} MB; allowed: up to {MOST_BYTES / 1e6:.0f} MB, with {FEWER}"
        )


def check_numbers(path: Path, count: float) -> None:
    """Refuse a file that says that it holds too many numbers.  Raises CaseError."""
    if count > MOST_NUMBERS:
        raise CaseError(f"{path}: {count:.3g} numbers; allowed: up to {MOST_NUMBERS:.0e}, with {FEWER}")


def unusable(values: np.ndarray) -> np.ndarray:
    """Which numbers cannot be computed with: what is not finite, or beyond any unit."""
    return ~(np.abs(np.asarray(values, dtype=float)) <= LARGEST)


def canonical(name: str) -> str:
    """Our name of a column."""
    lower = name.strip().strip('"').lower()
    return ALIASES.get(lower, lower)


def shown(text: object) -> str:
    """A text from a file, fit for one line."""
    said = repr(text) if str(text).isprintable() else ascii(text)
    return said if len(said) <= SHOWN else said[: SHOWN - 3] + "..."


def rename(path: Path, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns under our names, without those that we do not know.  Raises CaseError for one given twice."""
    found: dict[str, np.ndarray] = {}
    for name, values in columns.items():
        ours = canonical(name)
        if ours not in COLUMNS:
            continue
        if ours in found:
            raise CaseError(f"{path}: two columns hold {ours}, one of them {shown(name)}; allowed: one")
        found[ours] = 2.0 * values if name.strip().lower() in TWICE else values
    return found


def assemble(read: Frames, count: int) -> Columns:
    """The frames as arrays (T, count).

    Raises CaseError, naming file and time, for a missing column, a wrong number of particles, particles that
    come, go or occur twice, values that are not finite, and times that do not rise.
    """
    path, times = read.path, read.times
    if not len(times):
        raise CaseError(f"{path}: holds no time at all; allowed: the times from 0 to the end of the case")
    if unusable(times).any():
        raise CaseError(f"{path}: a time is not finite; allowed: finite numbers up to {LARGEST:g}")
    if (np.diff(times) <= 0.0).any():
        late = float(times[1:][np.diff(times) <= 0.0][0])
        raise CaseError(f"{path}: time {late:g} follows a later or equal one; allowed: times that rise")
    first = read.frames[0]
    missing = [name for name in POSITION if name not in first]
    if missing:
        raise CaseError(
            f"{path}: no column {', '.join(missing)} (it has {_list(first)}); positions cannot be computed "
            f"from anything else; known columns: {', '.join(COLUMNS)}"
        )
    some = [name for name in VELOCITY if name in first]
    if some and len(some) < len(VELOCITY):
        raise CaseError(
            f"{path}: of the velocity only {', '.join(some)}; allowed: all of vx, vy, vz, or none"
        )
    if "particle" not in first and count > 1:
        raise CaseError(
            f"{path}: no column particle (or id): which of {count} particles is which is not known; add it"
        )
    names = [name for name in first if name not in ("time", "particle")]
    check_numbers(path, float(len(names)) * len(times) * count)
    values = {name: np.empty((len(times), count)) for name in names}
    ids: np.ndarray | None = None
    for k, (time, frame) in enumerate(zip(times, read.frames, strict=True)):
        rows = len(frame.get("x", ()))
        if rows != count:
            raise CaseError(f"{path}: time {time:g}: {rows} particles, but the case has {count}")
        if set(frame) != set(first):
            raise CaseError(
                f"{path}: time {time:g}: columns {_list(frame)}, but {_list(first)} at the first time"
            )
        number = frame.get("particle", np.zeros(count))
        order = np.argsort(number, kind="stable")
        if ids is None:
            ids = number[order]
            if len(np.unique(ids)) < count or not np.isfinite(ids).all():
                raise CaseError(f"{path}: time {time:g}: a particle occurs twice or has no number")
        elif not np.array_equal(number[order], ids):
            raise CaseError(f"{path}: time {time:g}: other particle numbers than at the first time")
        for name in names:
            values[name][k] = frame[name][order]
    for name in names:
        bad = unusable(values[name])
        if bad.any():
            k, p = np.argwhere(bad)[0]
            raise CaseError(f"{path}: time {times[k]:g}, particle {p}: {name} is not finite")
    return Columns(path, times, values, read.resolution)


def declare(path: Path, found: Iterable[tuple[str, str]]) -> dict[str, str]:
    """What a header says, of DECLARED.  Raises CaseError for two different values of one key."""
    said: dict[str, str] = {}
    for key, value in found:
        if key in DECLARED and said.setdefault(key, value) != value:
            raise CaseError(f"{path}: {key} is {shown(said[key])} and {shown(value)}; allowed: one value")
    return said


def _list(columns: Iterable[str]) -> str:
    return ", ".join(columns) or "none"
