"""The run folder: trajectory, contact ledger, history and surfaces, in memory and on disk.

Every engine fills the same `Run`.  A folder is complete only when its `provenance.json`, which is written
last, says so.  Nothing is computed here that is not recorded.  Trajectory and ledger are written piece by
piece, so that a long run need not be in memory; where the pieces are until then is `spool.py`.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import platform
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from reference.case import Case, CaseError, load_case
from reference.case_sections import Cost
from reference.heightfield import Heightfield, flatness
from reference.ledger import empty_ledger, ledger_frame
from reference.origin import commit, digest, machine
from reference.state import State
from reference.toml_source import one_line

HISTORY = (
    "time", "flatness", "pad_height", "removed_volume", "removed_mass", "kinetic_energy",
    "momentum_x", "momentum_y", "momentum_z", "mean_velocity_x",
)  # fmt: skip
SUMS = (
    "contacts",
    "removals",
    "depth_sum",
    "contact_loss",
    "simultaneous_loss",
    "pad_work",
    "fluid_work",
    "fluid_impulse_x",
    "fluid_impulse_y",
    "fluid_impulse_z",
    "surface_impulse_x",
    "surface_impulse_y",
    "surface_impulse_z",
    "pad_impulse_z",
    "energy_rounding",
    "momentum_rounding",
)  # of the reference
TRAJECTORY = ("positions", "velocities", "masses")
HDF5_HEADERS = 16_384  # bytes, of a file with a few arrays
LATER = (*TRAJECTORY, "contacts")  # what `Run.open` reads when it is asked for
ROW_GROUP = 32_768  # rows of the ledger that are in memory at once when it is written, 6 MB


@dataclass
class Run:
    """What one engine computed for one variant of a case; SI throughout.

    `positions` (T, N, 3) are wrapped into the box; `contacts` has the columns of `ledger.COLUMNS`, `history`
    those of `HISTORY` and, from the reference, the cumulative `SUMS`; removed volume and mass there are
    cumulative and not accelerated.
    """

    case: Case
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    contacts: pd.DataFrame
    history: pd.DataFrame
    surface_initial: Heightfield | None = None
    surface: Heightfield | None = None
    diameters: np.ndarray = field(default_factory=lambda: np.zeros(0))
    provenance: dict[str, Any] = field(default_factory=dict)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the run folder; each file appears whole or not at all.  Raises OSError."""
        trajectory = {name: getattr(self, name) for name in TRAJECTORY}
        return self.save_pieces(folder, [trajectory], [self.contacts])

    def save_pieces(
        self,
        folder: str | os.PathLike[str],
        trajectory: Iterable[Mapping[str, np.ndarray]],
        ledger: Iterable[pd.DataFrame],
    ) -> Path:
        """As `save`, with the arrays of `TRAJECTORY` and the ledger in pieces along time.

        The files do not depend on where they are cut.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "provenance.json").unlink(missing_ok=True)
        write_durably(folder / "case.toml", self.case.save)
        size = self._size_of_arrays()
        write_durably(folder / "trajectory.h5", lambda path: self._write_arrays(path, trajectory), size)
        write_durably(folder / "contacts.parquet", lambda path: _write_ledger(path, ledger))
        write_durably(folder / "history.parquet", lambda path: self.history.to_parquet(path, index=False))
        text = json.dumps(self.provenance, indent=2, sort_keys=True) + "\n"
        write_durably(folder / "provenance.json", lambda path: path.write_text(text, "utf-8"))
        return folder

    def _size_of_arrays(self) -> int:
        numbers = len(self.times) * (1 + 7 * len(self.diameters)) + len(self.diameters)
        surfaces = sum(s.z.size for s in (self.surface_initial, self.surface) if s is not None)
        return 8 * (numbers + surfaces) + HDF5_HEADERS

    def _write_arrays(self, path: Path, pieces: Iterable[Mapping[str, np.ndarray]]) -> None:
        times, particles = len(self.times), len(self.diameters)
        shapes = {"positions": (times, particles, 3), "velocities": (times, particles, 3)}
        with h5py.File(path, "w") as file:
            file.create_dataset("times", data=self.times, track_times=False)
            for name in TRAJECTORY:
                file.create_dataset(name, shapes.get(name, (times, particles)), float, track_times=False)
            file.create_dataset("diameters", data=self.diameters, track_times=False)
            for name in ("surface_initial", "surface"):
                surface = getattr(self, name)
                if surface is not None:
                    file.create_dataset(name, data=surface.z, track_times=False).attrs["spacing"] = (
                        surface.spacing
                    )
            first = 0
            for piece in pieces:
                end = first + len(piece[TRAJECTORY[0]])
                for name in TRAJECTORY:
                    file[name][first:end] = piece[name]
                first = end

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Run:
        """Read a run folder.  Raises CaseError, in one line, for a folder that holds no run."""
        run = cls.open(folder)
        for name in LATER:
            getattr(run, name)
        return run

    @classmethod
    def open(cls, folder: str | os.PathLike[str], **known: Any) -> Run:
        """A run in a folder whose trajectory and ledger are read when they are first asked for.

        Parameters: known, fields that need not be read: all but those of `LATER`, before the folder is
        written; by default none.
        Raises CaseError, in one line, for a folder that holds no run, also later.
        """
        run = object.__new__(cls)
        run.__dict__["_folder"] = Path(folder)
        run.__dict__.update(known or _read_small(Path(folder)))
        return run

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """One of `LATER`, of a run that was opened."""
            if name not in LATER or "_folder" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            self.__dict__[name] = _read_large(self._folder, name)
            return self.__dict__[name]


def _read_small(folder: Path) -> dict[str, Any]:
    """What `Run.open` reads at once; of the rest it looks whether it is there."""
    with _reading(folder), h5py.File(folder / "trajectory.h5") as file:
        shape = (len(file["times"]), len(file["diameters"]))
        for name in TRAJECTORY:
            if file[name].shape[:2] != shape:
                raise ValueError(f"{name} of {file[name].shape[:2]} times and particles, not of {shape}")
        surfaces = {
            name: Heightfield(file[name][()], file[name].attrs["spacing"]) if name in file else None
            for name in ("surface_initial", "surface")
        }
        pq.read_schema(folder / "contacts.parquet")
        provenance = json.loads((folder / "provenance.json").read_text("utf-8"))
        _check_provenance(provenance)
        history = pd.read_parquet(folder / "history.parquet")
        missing = [name for name in HISTORY if name not in history or history[name].dtype.kind != "f"]
        if missing or len(history) != shape[0] or not shape[0]:
            raise ValueError(
                f"the history has {len(history)} of {shape[0]} rows, and no {', '.join(missing)}"
            )
        return {
            "times": file["times"][()],
            "diameters": file["diameters"][()],
            "case": load_case(folder / "case.toml"),
            "history": history,
            "provenance": provenance,
            **surfaces,
        }


def _check_provenance(found: Any) -> None:
    """What others rely on must be there; raises ValueError."""
    if not isinstance(found, dict):
        raise ValueError("provenance.json holds no table")
    number = (int, float)
    _require(found, {"engine": str, "complete": bool, "steps": number})
    if "notes" in found:
        _require(found, {"notes": list})
    if "timing" in found:
        _require(found, {"timing": dict})
        _require(
            found["timing"], dict.fromkeys(("wall_time", "sessions", "particle_steps_per_second"), number)
        )


def _require(found: dict[str, Any], kinds: Mapping[str, Any]) -> None:
    for key, kind in kinds.items():
        if not isinstance(found.get(key), kind):
            raise ValueError(f"provenance.json does not say {key}, or not as it should")


def _read_large(folder: Path, name: str) -> np.ndarray | pd.DataFrame:
    """The ledger, or an array of the trajectory."""
    with _reading(folder):
        if name == "contacts":
            return pd.read_parquet(folder / "contacts.parquet")
        with h5py.File(folder / "trajectory.h5") as file:
            array: np.ndarray = file[name][()]
            return array


@contextlib.contextmanager
def _reading(folder: Path) -> Iterator[None]:
    """What libraries say of a file that is missing or damaged becomes a CaseError."""
    try:
        yield
    except CaseError:
        raise
    except (
        OSError,
        KeyError,
        ValueError,
        TypeError,
        AttributeError,
        RuntimeError,
        pa.ArrowException,
    ) as problem:
        raise CaseError(f"{folder}: not a run folder: {one_line(problem)}") from None


def _write_ledger(path: Path, pieces: Iterable[pd.DataFrame]) -> None:
    """A ledger in row groups of a fixed length, so that bytes do not depend on how the pieces were cut."""
    schema = pa.Schema.from_pandas(ledger_frame(empty_ledger(1)), preserve_index=False)
    with pq.ParquetWriter(path, schema) as writer:
        held = schema.empty_table()
        for piece in pieces:
            held = pa.concat_tables([held, pa.Table.from_pandas(piece, schema, preserve_index=False)])
            while len(held) >= ROW_GROUP:
                writer.write_table(held.slice(0, ROW_GROUP).combine_chunks(), ROW_GROUP)
                held = held.slice(ROW_GROUP)
        if len(held):
            writer.write_table(held.combine_chunks(), ROW_GROUP)


def write_durably(path: Path, writer: Callable[[Path], Any], size: int = 0) -> None:
    """Write to a temporary name beside `path`, bring it to the disk, and rename.

    Parameters: size, of a file that HDF5 will write, at least, bytes: that there is so much room is tried
    first, because HDF5 itself may crash the process later when it has met a full disk.
    Raises OSError that names `path`, whatever the library that writes raises.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        if size:
            _require_room(partial, size)
        writer(partial)
        _bring_to_disk(partial)
        os.replace(partial, path)
        _bring_to_disk(path.parent)
    except (OSError, RuntimeError) as problem:  # the latter from HDF5
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
        told = re.search(r"errno = (\d+)", str(problem))
        code = getattr(problem, "errno", None) or (int(told.group(1)) if told else errno.EIO)
        raise OSError(code, os.strerror(code), str(path)) from None


def _require_room(path: Path, size: int) -> None:
    with path.open("wb") as file, contextlib.suppress(AttributeError):  # no such call on this system
        os.posix_fallocate(file.fileno(), 0, size)


def _bring_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def history_row(
    time: float, state: State, z_initial: np.ndarray, removed_volume: float, removed_mass: float, cost: Cost
) -> dict[str, float]:
    """One row of `history` from a state; flatness is NaN where it is undefined (Eq 44)."""
    try:
        pi = flatness(state.heights, z_initial, cost.target_height, cost.exponent)
    except ValueError:
        pi = float("nan")
    momentum = (state.mass[:, np.newaxis] * state.velocity).sum(axis=0)
    with np.errstate(over="ignore"):  # of a state that is about to stop being finite
        energy = 0.5 * float((state.mass * (state.velocity**2).sum(axis=1)).sum())
    mean_velocity = state.velocity[:, 0].mean() if len(state.mass) else 0.0
    values = (time, pi, state.pad_height, removed_volume, removed_mass, energy, *momentum, mean_velocity)
    return dict(zip(HISTORY, map(float, values), strict=True))


@cache
def version_of_code() -> str:
    """SHA-256 of this package's sources, and the versions of what compiles and runs them."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    versions = " ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba"))
    return f"{digest.hexdigest()} {versions}"


def basic_provenance(case: Case, engine: str) -> dict[str, Any]:
    """Versions, commit, seed, content of the case, machine and engine of a run."""
    return {
        "engine": engine,
        "case": case.name,
        "variant": case.variant,
        "seed": case.case.seed,
        "python": platform.python_version(),
        "code": version_of_code(),
        "versions": {name: metadata.version(name) for name in ("numpy", "numba")},
        "commit": commit(),
        "case_digest": digest(case),
        "machine": machine(),
        "complete": False,
    }


def timing(wall_time: float, steps: int, particles: int, sessions: int = 1) -> dict[str, Any]:
    """What the provenance of a run says of its speed; wall_time in s, of all sessions that it took."""
    return {
        "wall_time": wall_time,
        "sessions": sessions,
        "particle_steps_per_second": steps * particles / wall_time,
    }
