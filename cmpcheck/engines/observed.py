"""What was observed of an engine's run, made a `Run` as every engine has to return it.

Who observes is the engines' business: `lammps.py`, `liggghts_run.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.engines.protocol import Resolution
from reference.heightfield import Heightfield
from reference.recording import Run, basic_provenance, history_row
from reference.state import Setup


@dataclass(frozen=True)
class Observed:
    """Trajectory, ledger and surfaces of one run, SI; T outputs."""

    times: np.ndarray  # (T,)
    positions: np.ndarray  # (T, N, 3), wrapped
    velocities: np.ndarray  # (T, N, 3)
    masses: np.ndarray  # (T, N)
    contacts: pd.DataFrame  # columns of the ledger
    surfaces: list[np.ndarray]  # T heights (nx, ny)
    pad_heights: list[float]  # T
    extra: dict[str, Any] = field(default_factory=dict)  # for the provenance


def observed_run(
    setup: Setup, resolution: Resolution, seen: Observed, time_step: float, engine: str, version: str
) -> Run:
    """The run of an engine.  Raises ValueError when it has not every output."""
    if len(seen.times) != len(setup.output_times):
        raise ValueError(f"{len(seen.times)} of {len(setup.output_times)} outputs were recorded")
    state, cost = setup.state, setup.case.cost
    removed = seen.contacts[["time", "removed_volume", "removed_mass"]]
    history = []
    for k, time in enumerate(setup.output_times):
        so_far = removed[removed["time"] <= time].sum()
        now = replace(
            state, position=seen.positions[k], velocity=seen.velocities[k], mass=seen.masses[k],
            heights=seen.surfaces[k], pad_height=seen.pad_heights[k],
        )  # fmt: skip
        volume, mass = float(so_far["removed_volume"]), float(so_far["removed_mass"])
        history.append(history_row(time, now, state.heights, volume, mass, cost))
    spacing, has_surface = setup.model.spacing, setup.model.has_surface
    return Run(
        case=setup.case,
        times=setup.output_times.copy(),
        positions=seen.positions,
        velocities=seen.velocities,
        masses=seen.masses,
        contacts=seen.contacts,
        history=pd.DataFrame(history),
        surface_initial=Heightfield(seen.surfaces[0], spacing) if has_surface else None,
        surface=Heightfield(seen.surfaces[-1], spacing) if has_surface else None,
        diameters=state.diameter.copy(),
        provenance={
            **basic_provenance(setup.case, engine),
            engine: version,
            "form": resolution.form,
            "contact_duration": resolution.contact_duration,
            "time_step": time_step,
            "steps": round(float(setup.output_times[-1]) / time_step),
            "copies": setup.copies,
            "notes": list(setup.notes),
            **seen.extra,
            "complete": True,
        },
    )


def label(setup: Setup) -> str:
    """Case and variant, for messages."""
    return " ".join(filter(None, (setup.case.name, setup.case.variant)))
