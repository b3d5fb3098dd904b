"""Drag of the slurry on a particle, and the slurry's velocity (Eqs 20-22).

The flow is known; particles do not act on it.  How drag enters the step is `timestep.py`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from reference.compiled import broadcast, formula
from reference.state import FLOW_COUETTE, FLOW_UNIFORM


@formula
def _drag_coefficient(reynolds):
    if reynolds <= 1.0:
        return 24.0 / reynolds
    if reynolds <= 400.0:
        return 24.0 / reynolds**0.646
    if reynolds <= 3.0e5:
        return 0.5
    if reynolds <= 2.0e6:
        return 0.000366 * reynolds**0.4275
    return 0.18


@broadcast
def _broadcast_drag_coefficient(reynolds):
    return _drag_coefficient(reynolds) if reynolds == reynolds else reynolds  # not a number stays so


def drag_coefficient(reynolds: ArrayLike) -> np.ndarray:
    """Drag coefficient C_D of a sphere over its Reynolds number; arrays broadcast.

    Paper: Eq. (21), as printed: it jumps at Re = 400 (0.50036 to 0.5), 3e5 (0.5 to 0.08034) and 2e6
    (0.18079 to 0.18).  Re = 0 gives infinity; the force stays regular, see `drag_factor`.

    >>> float(drag_coefficient(0.5)), float(drag_coefficient(1000.0))
    (48.0, 0.5)
    """
    with np.errstate(divide="ignore"):
        return _broadcast_drag_coefficient(reynolds)


@formula
def drag_factor(slip_speed, diameter, fluid_density, viscosity):
    """Factor k of the drag D = k (u - v), in kg/s.

    Paper: Eqs. (20)-(22).  With Re = rho |u - v| d/mu <= 1 it is Stokes's 3 pi mu d, also at zero slip.
    """
    reynolds = fluid_density * slip_speed * diameter / viscosity
    if reynolds <= 1.0:
        return 3.0 * math.pi * viscosity * diameter
    area = math.pi * diameter * diameter / 4.0
    return 0.5 * fluid_density * slip_speed * _drag_coefficient(reynolds) * area


@broadcast
def _broadcast_drag_factor(slip_speed, diameter, fluid_density, viscosity):
    return drag_factor(slip_speed, diameter, fluid_density, viscosity)


def drag_force(
    fluid_velocity: ArrayLike,
    velocity: ArrayLike,
    diameter: ArrayLike,
    fluid_density: ArrayLike,
    viscosity: ArrayLike,
) -> np.ndarray:
    """Drag force of the fluid on spheres, shape (..., 3), in N.

    Paper: Eqs. (20)-(22).  Velocities (..., 3) in m/s, the others (...) in SI; everything broadcasts.

    >>> [round(float(f), 9) for f in drag_force([1e-3, 0, 0], [0, 0, 0], 1e-3 / (3 * math.pi), 1.0, 1.0)]
    [1e-06, 0.0, 0.0]
    """
    slip = np.asarray(fluid_velocity, dtype=float) - np.asarray(velocity, dtype=float)
    speed = np.linalg.norm(slip, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # vector code evaluates every regime
        k = _broadcast_drag_factor(speed, diameter, fluid_density, viscosity)
    return np.asarray(k)[..., np.newaxis] * slip


@formula
def fluid_velocity(model, pad_height, z):
    """Velocity (ux, uy, uz) of the fluid at height z, in m/s.

    Paper: Section 4, a linear profile under the pad, u = V_pad z/H; or a uniform flow.
    """
    if model.flow == FLOW_COUETTE:
        gap = pad_height if model.has_pad else model.gap
        return model.wall_speed * z / gap, 0.0, 0.0
    if model.flow == FLOW_UNIFORM:
        return model.flow_x, model.flow_y, model.flow_z
    return 0.0, 0.0, 0.0
