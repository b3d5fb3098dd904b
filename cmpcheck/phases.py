"""Copies of one problem side by side, each at another phase of the time step.

A contact is noticed up to one step late, by a fraction of the step that depends on where the particles
happen to be.  Copies whose particles start a fraction of a step earlier or later sample that fraction evenly.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from reference.heightfield import Heightfield
from reference.recording import Run
from reference.state import Setup


def tile(setup: Setup, copies: int, time_step: float) -> Setup:
    """`copies` of a setup side by side along x, shifted in time by ((k + 1/2)/copies - 1/2) `time_step`.

    The particles of copy k are numbers k N ... (k + 1) N - 1.  The shift is along the initial velocity.
    """
    state, model = setup.state, setup.model
    shift = ((np.arange(copies) + 0.5) / copies - 0.5) * time_step
    together = (
        state.position.copy()
    )  # every particle at its image nearest to the first, so that no copy is split
    together[:, 0] -= model.length_x * np.round((together[:, 0] - together[:1, 0]) / model.length_x)
    position = together + shift[:, np.newaxis, np.newaxis] * state.velocity
    position[:, :, 0] += np.arange(copies)[:, np.newaxis] * model.length_x
    position = position.reshape(-1, 3)
    periods = np.array([copies * model.length_x, model.length_y, model.length_z])
    for axis in np.flatnonzero(periods):
        position[:, axis] %= periods[axis]
    repeated: dict[str, Any] = {
        name: np.tile(getattr(state, name), (copies, 1) if name == "velocity" else copies)
        for name in ("velocity", "mass", "diameter", "modulus")
    }
    return replace(
        setup,
        model=model._replace(length_x=periods[0]),
        state=replace(state, position=position, heights=np.tile(state.heights, (copies, 1)), **repeated),
        copies=copies,
    )


def split(array: np.ndarray, copies: int) -> np.ndarray:
    """An array over all particles as (copies, N, ...)."""
    return array.reshape(copies, -1, *array.shape[1:])


def surfaces(surface: Heightfield, copies: int) -> list[Heightfield]:
    """The part of a tiled surface that belongs to each copy."""
    return [Heightfield(z, surface.spacing) for z in np.split(surface.z, copies)]


def unwrapped(run: Run, setup: Setup) -> np.ndarray:
    """Positions (T, N, 3) without the jumps at periodic boundaries (moves of less than half a period)."""
    positions = run.positions.copy()
    for axis, period in enumerate((setup.model.length_x, setup.model.length_y, setup.model.length_z)):
        if period > 0.0:
            positions[:, :, axis] = np.unwrap(positions[:, :, axis], period=period, axis=0)
    return positions
