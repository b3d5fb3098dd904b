"""The memory of one fix: its arrays, and the context that tells a compiled callback where they are."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.engines.lammps_library import function_address, global_address
from cmpcheck.fixes.calibration import spring
from cmpcheck.fixes.layout import BY_TAG_COLUMNS, CONTEXT, FORMS, OBSERVE, OPEN_COLUMNS, SOFT
from cmpcheck.fixes.local import empty_local
from cmpcheck.fixes.near import empty_near
from reference.ledger import empty_ledger, ledger_frame
from reference.state import Model

PAIRS_PER_PARTICLE = 32  # listed neighbours j > i; spheres of one size have at most 6 touching ones each
OPEN_PER_PARTICLE = 6

NAMES = {
    "name_id_at": b"id",
    "name_x_at": b"x",
    "name_v_at": b"v",
    "name_f_at": b"f",
    "name_radius_at": b"radius",
    "name_rmass_at": b"rmass",
    "name_state_at": b"d2_cmpcheck",
    "name_given_at": b"d2_cmpcheck_given",
}


class Memory:
    """Arrays that LAMMPS's callback reads and writes; they must outlive the fix.

    Attributes: `context` (a record, see `layout.CONTEXT`), `modulus` (N,), `heights` (nx, ny), `rows` (the
    ledger), `by_tag`, `position`, `pairs` and `listed` (the positions when they were listed), `open_pairs`,
    `samples`, `local` (see `local.Local`), `near` (see `near.Near`).
    """

    def __init__(
        self,
        model: Model,
        modulus: np.ndarray,
        heights: np.ndarray,
        form: str,
        contact_duration: float,
        sample_every: int,
        max_contacts: int,
        max_samples: int,
        observe_pairs: bool,
        pad_height: float,
        ledger_speed: float,
    ) -> None:
        n = len(modulus)
        self.modulus = np.array(modulus, dtype=np.float64)
        self.heights = np.array(heights, dtype=np.float64, order="C")
        self.rows = empty_ledger(max_contacts)
        self.by_tag = np.zeros((n, BY_TAG_COLUMNS))
        self.pairs = np.zeros((PAIRS_PER_PARTICLE * n, 2), dtype=np.int64)
        self.position = np.zeros((n, 3))
        self.listed = np.zeros((n, 3))
        self.open_pairs = np.zeros((OPEN_PER_PARTICLE * n, OPEN_COLUMNS))
        self.local = empty_local(n)
        self.near = empty_near(n)
        self.samples = np.zeros((max_samples if sample_every else 0, 1 + 7 * n))
        self._names = {key: ctypes.create_string_buffer(name) for key, name in NAMES.items()}
        self._context = np.zeros(1, dtype=CONTEXT)
        self.context: Any = self._context.view(np.recarray)[0]
        c = self.context
        for name, value in model._asdict().items():
            self._context["model"][name] = value
        c.form, c.particles = FORMS.index(form), n
        c.observe_pairs, c.sample_every = observe_pairs, sample_every
        if c.form == SOFT and model.has_surface:
            c.spring, c.damping = spring(model.restitution, contact_duration)
        if c.form == SOFT and model.has_pad:
            c.pad_spring, c.pad_damping = spring(model.pad_restitution, contact_duration)
        c.pad_height, c.ledger_speed = pad_height, ledger_speed
        c.patience = 0.0 if c.form == OBSERVE else 2.0 * contact_duration
        c.highest = self.heights.max(initial=-np.inf)
        c.last_step, c.pairs = -1, -1
        c.nodes_x, c.nodes_y = self.heights.shape
        c.max_rows, c.max_samples = len(self.rows), len(self.samples)
        c.max_pairs, c.max_open = len(self.pairs), len(self.open_pairs)

    def connect(self, lmp: Any) -> None:
        """Fill in the addresses: of this memory, and of the LAMMPS instance and its library."""
        c = self.context
        c.lammps, c.dt_at = ctypes.cast(lmp.lmp, ctypes.c_void_p).value, global_address(lmp, "dt")
        c.allocated_at, c.allocated = global_address(lmp, "nmax"), -1
        c.extract_atom_at = function_address(lmp, "lammps_extract_atom")
        c.force_timeout_at = function_address(lmp, "lammps_force_timeout")
        for key, buffer in self._names.items():
            self._context[key] = ctypes.addressof(buffer)
        for name in ("modulus", "heights", "rows", "by_tag", "position", "pairs", "listed", "samples"):
            self._context[f"{name}_at"] = getattr(self, name).ctypes.data
        c.open_at, c.address = self.open_pairs.ctypes.data, self.address
        for name, array in (self.local._asdict() | self.near._asdict()).items():
            self._context[f"{name}_at"] = array.ctypes.data

    def contacts(self, rows: np.ndarray | None = None) -> pd.DataFrame:
        """Ledger rows, by default all that are kept here, as a table sorted by time and particle; SI."""
        found = self.rows[: self.context.rows] if rows is None else rows
        return ledger_frame(found).sort_values(["time", "i", "j", "kind"], kind="stable", ignore_index=True)

    def trajectory(
        self, samples: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times (T,), positions (T, N, 3) wrapped, full-step velocities (T, N, 3), masses (T, N); SI."""
        found = self.samples[: self.context.samples] if samples is None else samples
        columns = found[:, 1:].reshape(len(found), len(self.modulus), 7)
        times, position, velocity, mass = found[:, 0], columns[..., :3], columns[..., 3:6], columns[..., 6]
        return times.copy(), position.copy(), velocity.copy(), mass.copy()

    @property
    def address(self) -> int:
        """Address of the context: the pointer that LAMMPS hands to the callback."""
        return int(self._context.ctypes.data)
