"""What a simulation is at an instant: names, shapes and units; no behaviour.

`Model` holds the constants that the kernels read, `State` the arrays that they advance, and `Setup`
puts both together with the times to be recorded.  Building them from a case is `process.py`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from reference.case import Case

FLOW_NONE, FLOW_UNIFORM, FLOW_COUETTE = 0, 1, 2
DEPOSIT_NONE, DEPOSIT_VOLUME, DEPOSIT_NODE_DEPTH = 0, 1, 2


class Model(NamedTuple):
    """Constants of one simulation, SI scalars (a named tuple, so that Numba reads it by name)."""

    length_x: float  # period of the box along x, m
    length_y: float  # period along y, m
    length_z: float  # period along z, m; 0: not periodic along z
    restitution: float  # e, Eq 5
    static_friction: float  # mu_s, Eq 17
    dynamic_friction: float  # mu_d, Eq 18
    impact_duration: float  # a constant delta t, s; 0: Hertz's duration
    flow: int  # FLOW_*
    fluid_density: float  # rho, kg/m3
    viscosity: float  # mu, Pa s
    flow_x: float  # u of a uniform flow, m/s
    flow_y: float
    flow_z: float
    wall_speed: float  # V of a Couette flow u = (V z/H, 0, 0), m/s
    gap: float  # H of a Couette flow without a pad, m
    has_surface: bool  # heightfield present
    spacing: float  # h, m
    surface_modulus: float  # E/(1-nu^2) of the surface, Pa
    surface_density: float  # rho_s, kg/m3
    poisson_ratio: float  # nu of the surface
    yield_stress: float  # sigma_y of the surface, Pa
    deposit: int  # DEPOSIT_*
    acceleration: float  # A: multiplies the removal of each impact
    mass_pickup: bool  # the particle carries the removed mass
    threshold_velocity: float  # slower impacts remove nothing, m/s
    has_pad: bool
    pad_restitution: float  # e_pad
    pad_descent: float  # V_z, m/s, times A
    pad_minimum: float  # H_min, m
    has_pairs: bool = True  # particles collide with each other
    new_contacts_only: bool = False  # a particle that touched the surface one step before removes nothing


class Particles(NamedTuple):
    """The arrays of all particles, SI float64, as the kernels take them."""

    position: np.ndarray  # (N, 3), m, wrapped into the box where it is periodic
    velocity: np.ndarray  # (N, 3), m/s
    mass: np.ndarray  # (N,), kg; grows when material is picked up
    diameter: np.ndarray  # (N,), m; constant
    modulus: np.ndarray  # (N,), E/(1-nu^2), Pa


@dataclass
class State:
    """Arrays at one instant, SI float64; positions are wrapped into the box where it is periodic."""

    time: float
    position: np.ndarray  # (N, 3), m
    velocity: np.ndarray  # (N, 3), m/s
    mass: np.ndarray  # (N,), kg; grows when material is picked up
    diameter: np.ndarray  # (N,), m; constant
    modulus: np.ndarray  # (N,), E/(1-nu^2) of each particle, Pa
    heights: np.ndarray  # (nx, ny) node heights z[i, j] at (i h, j h), m; shape (0, 0) without a surface
    pad_height: float = float("nan")  # H, m

    @property
    def particles(self) -> Particles:
        """The particles' arrays themselves, not copies."""
        return Particles(self.position, self.velocity, self.mass, self.diameter, self.modulus)


@dataclass
class Setup:
    """Everything an engine needs to run one variant of a case."""

    case: Case  # of this variant
    model: Model
    state: State  # initial; engines copy it
    time_step: float  # largest step, s
    end_time: float  # s
    output_times: np.ndarray  # (T,), s, ascending, first 0, last end_time
    copies: int = 1  # independent copies of the problem side by side along x
    notes: list[str] = field(default_factory=list)  # warnings to be recorded with the run
