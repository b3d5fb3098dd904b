"""The contact ledger: one row for each contact, the same columns for every engine.

Kernels fill rows of a float64 array by these column numbers; `ledger_frame` turns them into a table.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

KINDS = ("pair", "surface", "pad")
KIND_PAIR, KIND_SURFACE, KIND_PAD = 0, 1, 2

COLUMNS = {
    "time": "s, at the first step of overlap and approach",
    "kind": "pair | surface | pad",
    "i": "particle",
    "j": "second particle of a pair, else -1",
    "x": "m, point of contact",
    "y": "m",
    "z": "m",
    "nx": "normal: from i to j, or out of the surface or pad",
    "ny": "",
    "nz": "",
    "approach_speed": "m/s, positive, before any contact force",
    "normal_impulse": "N s, as it acted",
    "friction_impulse": "N s, magnitude",
    "duration": "s, the model's delta t",
    "load": "N, P = J/delta t with J of Eq 30",
    "yield_radius": "m, x_p (Eq 34, limited to R)",
    "depth": "m, delta h (Eq 35)",
    "removed_volume": "m3, cap volume (Eq 36), not accelerated",
    "removed_mass": "kg, rho_s times the cap volume",
    "external_force": "N along n at first contact; for pairs E_in/m_i - E_jn/m_j in m/s2",
    "contact_time": "s, time over which external forces acted within normal_impulse",
    "energy_lost": "J, kinetic energy taken by the contact",
}
(
    TIME, KIND, I, J, X,  # noqa: E741
    Y, Z, NX, NY, NZ, APPROACH_SPEED, NORMAL_IMPULSE, FRICTION_IMPULSE, DURATION, LOAD,
    YIELD_RADIUS, DEPTH, REMOVED_VOLUME, REMOVED_MASS, EXTERNAL_FORCE, CONTACT_TIME, ENERGY_LOST,
) = range(len(COLUMNS))  # fmt: skip


def empty_ledger(rows: int) -> np.ndarray:
    """Room for `rows` contacts, (rows, number of columns)."""
    return np.zeros((rows, len(COLUMNS)))


def ledger_frame(rows: np.ndarray) -> pd.DataFrame:
    """Rows of a ledger array as a table with the columns of `COLUMNS`."""
    frame = pd.DataFrame(np.array(rows, dtype=float).reshape(-1, len(COLUMNS)), columns=list(COLUMNS))
    frame["kind"] = pd.Categorical.from_codes(frame["kind"].astype(int), list(KINDS)).astype(str)
    return frame.astype({"i": np.int64, "j": np.int64})
