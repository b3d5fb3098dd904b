"""Checkpoints: what a run in progress needs to go on after it was killed.

Each checkpoint adds one numbered part and never rewrites an earlier one: the rows recorded since, and the
state at its end.  Where there are many rows, parts of rows alone are written before it.  `checkpoint.json`,
replaced last and at once, lists with their digests the parts that belong together, and whose they are;
nothing else in the folder is read.  Which rows are on the disk already is `spool.py`'s business, what the
state consists of `simulation.py`'s.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from reference.case import Case, CaseError
from reference.recording import HDF5_HEADERS, Run, version_of_code, write_durably
from reference.state import Setup
from reference.toml_source import one_line

FOLDER, INDEX = "checkpoint", "checkpoint.json"
DAMAGE = (OSError, ValueError, LookupError, TypeError, AttributeError, RuntimeError, MemoryError)
Arrays = dict[str, np.ndarray]


class Saved(NamedTuple):
    """What a checkpoint holds."""

    parts: tuple[Path, ...]  # files of the rows recorded since the start, in order; see `read_rows`
    state: Arrays  # at the end


class Checkpoint:
    """The checkpoint of one run, in the folder `checkpoint` of its run folder."""

    def __init__(self, run_folder: Path, setup: Setup):
        self.folder = run_folder / FOLDER
        self.owner = {"case": setup.case.toml(), "setup": _digest_of_setup(setup), "code": version_of_code()}
        self.parts: dict[str, str] = {}  # name and SHA-256, in order

    def start(self) -> None:
        """Begin anew, whatever was there; from now on the run folder holds no complete run."""
        (self.folder.parent / "provenance.json").unlink(missing_ok=True)
        self.remove()
        self.folder.mkdir(parents=True)
        self.parts = {}
        self._write_index()

    def add(self, rows: Arrays, state: Arrays) -> None:
        """Make a checkpoint: the rows since the last one, and the present state.  Raises OSError."""
        self._write_part({"rows": rows, "state": state})
        self._write_index()

    def spill(self, rows: Arrays) -> None:
        """Write rows that belong to the next checkpoint; without one they are not read.  Raises OSError."""
        self._write_part({"rows": rows})

    @property
    def files(self) -> tuple[Path, ...]:
        """The parts that were written, in order."""
        return tuple(self.folder / name for name in self.parts)

    def _write_part(self, groups: dict[str, Arrays]) -> None:
        name = part_name(len(self.parts))

        def write(path: Path) -> None:
            with h5py.File(path, "w") as file:
                for group, arrays in groups.items():
                    for key, value in arrays.items():
                        file.create_dataset(f"{group}/{key}", data=value, track_times=False)

        size = sum(np.asarray(value).nbytes for arrays in groups.values() for value in arrays.values())
        write_durably(self.folder / name, write, size + HDF5_HEADERS)
        self.parts[name] = _digest_of_file(self.folder / name)

    def load(self) -> Saved | None:
        """What was saved, or None where nothing was.

        Raises CaseError for a checkpoint of another case or version, and for one that is damaged.
        """
        if not (self.folder / INDEX).exists():
            return None
        try:
            index = json.loads((self.folder / INDEX).read_text("utf-8"))
            self._require_same_owner(index["owner"])
            parts = dict(index["parts"])
            for k, (name, digest) in enumerate(parts.items()):
                if name != part_name(k):
                    raise ValueError(f"{name[:60]!r} where {part_name(k)} should be")
                if _digest_of_file(self.folder / name) != digest:
                    raise ValueError(f"{name} is not as it was written")
            state = _read(self.folder / list(parts)[-1], "state") if parts else {}
        except CaseError:
            raise
        except DAMAGE as problem:
            raise self.damaged(problem) from None
        self.parts = parts
        return Saved(self.files, state) if parts else None

    def damaged(self, problem: Exception) -> CaseError:
        """The error to raise for what cannot be restored, also found by those who know what it means."""
        said = one_line(problem)
        return CaseError(
            f"{self.folder}: the checkpoint is damaged ({said}); allowed: to start again with --force"
        )

    def remove(self) -> None:
        """Remove it, when the run is complete or begins anew."""
        if self.folder.exists():
            if self.parts:
                os.sync()  # the run folder is on the disk before what could restore it goes
            shutil.rmtree(self.folder)

    def _write_index(self) -> None:
        text = json.dumps({"owner": self.owner, "parts": self.parts}, indent=2) + "\n"
        write_durably(self.folder / INDEX, lambda path: path.write_text(text, "utf-8"))

    def _require_same_owner(self, owner: dict[str, str]) -> None:
        again = "allowed: to go on with what began it, or to start again with --force"
        if owner["case"] != self.owner["case"]:
            earlier = owner["case"].splitlines()
            changed = next((line for line in self.owner["case"].splitlines() if line not in earlier), "")
            now = f", now {changed}" if changed else ""
            raise CaseError(f"{self.folder}: the checkpoint belongs to another case{now}; {again}")
        for key, what in (("code", "version of the code, NumPy or Numba"), ("setup", "initial state")):
            if owner[key] != self.owner[key]:
                raise CaseError(f"{self.folder}: the checkpoint belongs to another {what}; {again}")


def is_complete(folder: Path) -> bool:
    """Whether a folder says that it holds a complete run."""
    try:
        provenance = json.loads((folder / "provenance.json").read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(provenance, dict) and provenance.get("complete") is True


def finished_run(folder: Path, case: Case) -> Run | None:
    """The complete run in a folder, or None where there is none.

    Raises CaseError for a run of another case or engine, and for one that another version of the code has
    made: like a checkpoint of another version, it is not this one's result, whether it differs or not.
    """
    if not is_complete(folder):
        return None
    run = Run.open(folder)
    if run.case != case or run.provenance.get("engine") != "reference":
        raise CaseError(
            f"{folder}: holds a complete run of another case or engine; allowed: another folder, or --force"
        )
    if run.provenance.get("code") != version_of_code():
        raise CaseError(
            f"{folder}: holds a complete run by another version of the code, NumPy or Numba, which stays "
            "readable; allowed: another folder, or --force to make it anew"
        )
    shutil.rmtree(folder / FOLDER, ignore_errors=True)  # of a session killed when it had just ended
    return run


def part_name(k: int) -> str:
    """The file name of part k; a checkpoint has all of them, from 0 on."""
    return f"part-{k:05}.h5"


def read_rows(parts: Iterable[Path], keys: Iterable[str]) -> Iterator[Arrays]:
    """The rows of each part, one part at a time."""
    for path in parts:
        yield _read(path, "rows", keys)


def _read(path: Path, group: str, keys: Iterable[str] = ()) -> Arrays:
    """The arrays of a group of a part, all of them or those of some keys."""
    with h5py.File(path) as file:
        return {key: file[group][key][()] for key in keys or file[group]}


def _digest_of_file(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digest_of_setup(setup: Setup) -> str:
    """SHA-256 of where a run starts and of the times at which it stops."""
    state, digest = setup.state, hashlib.sha256(np.float64(setup.time_step).tobytes())
    for array in (*state.particles, state.heights, setup.output_times):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
