"""Observables of a run, by the same code for every engine.

Each function takes a run of `copies` equal problems side by side and returns one value per copy.  What they
have to be is the judges' business.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
import pandas as pd

from cmpcheck.phases import split, surfaces
from reference.neighbors import neighbor_pairs
from reference.recording import Run
from reference.state import Setup

EPS = float(np.finfo(float).eps)


def kinetic_energy(run: Run, frame: int, copies: int) -> np.ndarray:
    """Kinetic energy of each copy at a recorded time, J."""
    mass, velocity = split(run.masses[frame], copies), split(run.velocities[frame], copies)
    return 0.5 * (mass * (velocity**2).sum(axis=2)).sum(axis=1)


def momentum_change(run: Run, copies: int) -> np.ndarray:
    """Magnitude of the change of total momentum over the run, N s."""
    first, last = (
        (split(run.masses[k], copies)[..., np.newaxis] * split(run.velocities[k], copies)).sum(axis=1)
        for k in (0, -1)
    )
    return np.linalg.norm(last - first, axis=1)


def momentum_scale(run: Run, copies: int) -> float:
    """Sum of m |v| at the start, the largest of the copies, N s."""
    mass, velocity = split(run.masses[0], copies), split(run.velocities[0], copies)
    return float((mass * np.linalg.norm(velocity, axis=2)).sum(axis=1).max())


def final_velocity(run: Run, copies: int) -> np.ndarray:
    """Velocities (copies, N, 3) at the end, m/s."""
    return split(run.velocities[-1], copies)


def mass_gained(run: Run, copies: int) -> np.ndarray:
    """Mass picked up over the run, kg."""
    return split(run.masses[-1] - run.masses[0], copies).sum(axis=1)


def volume_lost(run: Run, copies: int) -> np.ndarray:
    """Volume that the surface has lost over the run, m3."""
    assert run.surface is not None
    assert run.surface_initial is not None
    pairs = zip(surfaces(run.surface_initial, copies), surfaces(run.surface, copies), strict=True)
    return np.array([before.spacing**2 * float((before.z - after.z).sum()) for before, after in pairs])


def volume_rounding(run: Run) -> float:
    """Bound of the rounding error of `volume_lost`: half a unit of z at each of n lowerings and sums, m3."""
    assert run.surface_initial is not None
    z = run.surface_initial
    return z.spacing**2 * EPS * (float(np.abs(z.z).max()) * 12 * (1 + len(run.contacts)))


def contacts_by_copy(run: Run, setup: Setup, kind: str) -> list[pd.DataFrame]:
    """The ledger's contacts of one kind, by copy, in order of time, with i and j counted within the copy."""
    n = run.positions.shape[1] // setup.copies
    rows = run.contacts[run.contacts["kind"] == kind].sort_values(["time", "i", "j"], kind="stable")
    owner = rows["i"] // n
    local = rows.assign(i=rows["i"] % n, j=np.where(rows["j"] < 0, -1, rows["j"] % n))
    order = np.argsort(owner.to_numpy(), kind="stable")
    ends = np.searchsorted(owner.to_numpy()[order], np.arange(setup.copies + 1))
    together = local.iloc[order]
    return [together.iloc[begin:end] for begin, end in itertools.pairwise(ends)]


def contact_columns(contacts: list[pd.DataFrame], count: int) -> Iterator[pd.DataFrame]:
    """For each of the first `count` contacts, its row in every copy (all copies must have it)."""
    together = pd.concat(contacts)
    first = np.cumsum([0, *(len(frame) for frame in contacts[:-1])])
    for k in range(count):
        yield together.iloc[first + k]


def model_impulse(rows: pd.DataFrame) -> np.ndarray:
    """Normal impulse with the external force acting over the model's whole delta t, N s.

    Eq 30's J contains -E_n delta t; an engine's contains it over the time that its contact lasts.
    """
    missing = rows["duration"].to_numpy(float) - rows["contact_time"].to_numpy(float)
    return rows["normal_impulse"].to_numpy(float) - rows["external_force"].to_numpy(float) * missing


def pair_model_impulse(rows: pd.DataFrame, reduced_mass: float) -> np.ndarray:
    """As `model_impulse` for pairs: Eq 9's J contains m* (E_in/m_i - E_jn/m_j) delta t, in N s.

    Parameters: reduced_mass m*, kg; in the ledger the external force of a pair is an acceleration.
    """
    missing = rows["duration"].to_numpy(float) - rows["contact_time"].to_numpy(float)
    given = rows["normal_impulse"].to_numpy(float)
    return given + reduced_mass * rows["external_force"].to_numpy(float) * missing


def free_flight_change(run: Run, setup: Setup) -> float:
    """Largest change of a velocity component, in m/s, between outputs without a contact of the particle.

    Without external forces there is none.  A contact lasts from its first step to its end, and one that is
    still open at the end of the run is told by the overlap.
    """
    changes = np.abs(np.diff(run.velocities, axis=0)).max(axis=2)  # (T - 1, N)
    contacts, step = run.contacts, float(run.times[-1]) / run.provenance["steps"]
    first = np.searchsorted(run.times, contacts["time"].to_numpy() - 2.0 * step) - 1
    last = np.searchsorted(run.times, (contacts["time"] + contacts["contact_time"]).to_numpy() + 2.0 * step)
    for i, j, begin, end in zip(contacts["i"], contacts["j"], first, last, strict=True):
        changes[max(begin, 0) : end, [i, j]] = 0.0
    model = setup.model
    periods = np.array([model.length_x, model.length_y, model.length_z])
    changes[-1, neighbor_pairs(run.positions[-1], float(run.diameters.max()), periods).ravel()] = 0.0
    return float(changes.max(initial=0.0))
