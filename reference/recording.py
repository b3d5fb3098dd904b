"""The run folder: trajectory, contact ledger, history and surfaces, in memory and on disk.

Every engine fills the same `Run`.  A folder is complete only when its `provenance.json`, which is written
last, says so.  Nothing is computed here that is not recorded.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from reference.case import Case, CaseError, load_case
from reference.case_sections import Cost
from reference.heightfield import Heightfield, flatness
from reference.origin import commit, digest, machine
from reference.state import State

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
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "provenance.json").unlink(missing_ok=True)
        self.case.save(folder / "case.toml")
        _write(folder / "trajectory.h5", self._write_arrays)
        _write(folder / "contacts.parquet", lambda path: self.contacts.to_parquet(path, index=False))
        _write(folder / "history.parquet", lambda path: self.history.to_parquet(path, index=False))
        text = json.dumps(self.provenance, indent=2, sort_keys=True) + "\n"
        _write(folder / "provenance.json", lambda path: path.write_text(text, "utf-8"))
        return folder

    def _write_arrays(self, path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name in ("times", "positions", "velocities", "masses", "diameters"):
                file.create_dataset(name, data=getattr(self, name), track_times=False)
            for name in ("surface_initial", "surface"):
                surface = getattr(self, name)
                if surface is not None:
                    file.create_dataset(name, data=surface.z, track_times=False).attrs["spacing"] = (
                        surface.spacing
                    )

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Run:
        """Read a run folder.  Raises CaseError, in one line, for a folder that holds no run."""
        folder = Path(folder)
        try:
            with h5py.File(folder / "trajectory.h5") as file:
                arrays = {
                    name: file[name][()]
                    for name in ("times", "positions", "velocities", "masses", "diameters")
                }
                surfaces: dict[str, Any] = {
                    name: Heightfield(file[name][()], file[name].attrs["spacing"])
                    for name in ("surface_initial", "surface")
                    if name in file
                }
            return cls(
                case=load_case(folder / "case.toml"),
                contacts=pd.read_parquet(folder / "contacts.parquet"),
                history=pd.read_parquet(folder / "history.parquet"),
                provenance=json.loads((folder / "provenance.json").read_text("utf-8")),
                **arrays,
                **surfaces,
            )
        except (OSError, KeyError, ValueError) as problem:
            raise CaseError(f"{folder}: not a run folder: {problem}") from None


def _write(path: Path, writer: Callable[[Path], Any]) -> None:
    """Write to a temporary name beside `path` and rename."""
    partial = path.with_name(f".{path.name}.partial")
    writer(partial)
    os.replace(partial, path)


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
