"""Impulses of colliding particles, and of a particle and the surface (Eqs 3-19 and 23-31).

Only the algebra of one contact: who touches whom is `neighbors.py` and `heightfield.py`, what the drag is
`drag.py`, and how impulses move particles `timestep.py`.  J is an impulse in N s, E an external force in N,
and `ext` its impulse over a phase of the contact.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from reference.compiled import broadcast, formula

HERTZ = 2.87  # of an elastic impact's duration: see `impact_duration`


@formula
def pair_normal_impulse(mass_i, mass_j, v_in, v_jn, restitution, ext_i=0.0, ext_j=0.0):
    """Normal impulse J that particle j gives to i against n_ij, never negative, in N s.

    Paper: Eq. (9).  Velocities (m/s) are components along n_ij, from i to j, before contact; `ext_i`,
    `ext_j` are the impulses (N s) of the external forces along n_ij over the compression phase.  Arrays
    broadcast.
    Departure: the paper prints the masses under the two integrals swapped.

    >>> float(pair_normal_impulse(1.0, 1.0, 1.0, -1.0, 1.0))
    2.0
    """
    m_eff = mass_i * mass_j / (mass_i + mass_j)
    v_approach = v_in - v_jn + ext_i / mass_i - ext_j / mass_j
    return np.maximum(0.0, (1.0 + restitution) * m_eff * v_approach)


@formula
def friction_impulse_per_slip(mass_i, mass_j, slip_speed, normal_impulse, static_friction, dynamic_friction):
    """Friction impulse on i divided by the slip w that it opposes, in kg (scalars only).

    Paper: Eqs. (14)-(18).  m* while sticking, that is |m* w| <= mu_s J; mu_d J/|w| while slipping.
    """
    m_eff = mass_i * mass_j / (mass_i + mass_j)
    if m_eff * slip_speed <= static_friction * normal_impulse:
        return m_eff
    return dynamic_friction * normal_impulse / slip_speed


@broadcast
def _friction_impulse_per_slip(mass_i, mass_j, slip_speed, normal_impulse, static_friction, dynamic_friction):
    return friction_impulse_per_slip(
        mass_i, mass_j, slip_speed, normal_impulse, static_friction, dynamic_friction
    )


def pair_friction_impulse(
    mass_i: ArrayLike,
    mass_j: ArrayLike,
    slip: ArrayLike,
    normal_impulse: ArrayLike,
    static_friction: float,
    dynamic_friction: float,
) -> np.ndarray:
    """Friction impulse on particle i, shape (..., 3), in N s; particle j receives the opposite.

    Paper: Eqs. (14)-(18).  `slip` (..., 3) in m/s is w = v_jt - v_it - (E_it/m_i - E_jt/m_j) delta t, the
    tangential velocity that friction has to cancel.  Zero slip gives zero.
    Raises ValueError unless 0 <= mu_d <= mu_s.
    Departure: the vector form; the printed sign of Eq. (18) holds only while I_f < 0.

    >>> [float(f) for f in pair_friction_impulse(2.0, 2.0, [0.5, 0.0, 0.0], 10.0, 0.3, 0.2)]
    [0.5, 0.0, 0.0]
    """
    if not 0.0 <= dynamic_friction <= static_friction:
        raise ValueError(
            f"dynamic_friction {dynamic_friction}; allowed: 0 to static_friction {static_friction}"
        )
    w = np.asarray(slip, dtype=float)
    speed = np.linalg.norm(w, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # vector code evaluates both branches
        factor = _friction_impulse_per_slip(
            mass_i, mass_j, speed, normal_impulse, static_friction, dynamic_friction
        )
    return np.asarray(factor)[..., np.newaxis] * w


@formula
def surface_normal_impulse(mass, v_n, restitution, ext=0.0):
    """Normal impulse J of the surface on a particle, never negative, in N s.

    Paper: Eqs. (29) and (30), which together do not depend on the mass removed.  `v_n` (m/s) is negative
    towards the surface, `ext` (N s) the external impulse along n over the compression phase.

    >>> float(surface_normal_impulse(2.0, -1.0, 0.5))
    3.0
    """
    return np.maximum(0.0, -(1.0 + restitution) * (mass * v_n + ext))


@formula
def surface_normal_velocity(mass, mass_removed, v_n, restitution, ext_compression=0.0, ext_recovery=0.0):
    """Normal velocity after an impact on the surface, in m/s.

    Paper: Eq. (29).  The removed mass joins at the end of compression, where v_n = 0.

    >>> float(surface_normal_velocity(1.0, 1.0, -2.0, 0.5))
    0.5
    """
    return (ext_recovery - restitution * (mass * v_n + ext_compression)) / (mass + mass_removed)


@formula
def effective_modulus(modulus_i, modulus_j):
    """E* of two bodies from their E/(1 - nu^2), in Pa."""
    return modulus_i * modulus_j / (modulus_i + modulus_j)


@formula
def impact_duration(mass, radius, effective_modulus, speed):
    """Hertz's duration delta t of an elastic impact, in s.

    2.87 (m^2/(R E*^2 v))^(1/5); for two particles the effective mass and radius.  The paper leaves the
    duration open.

    >>> float(impact_duration(1.0, 1.0, 1.0, 1.0))
    2.87
    """
    return HERTZ * (mass * mass / (radius * effective_modulus * effective_modulus * speed)) ** 0.2


@formula
def compression_impulse(external_force, duration, time_step, restitution):
    """External impulse over the compression phase, E1 = E_n min(delta t, dt)/(1+e), in N s.

    Paper: the integrals of Eqs. (9) and (29), with delta t_1 = delta t/(1+e): then a constant force drops
    out of the rebound, and a resting contact returns exactly -E.
    """
    return external_force * np.minimum(duration, time_step) / (1.0 + restitution)


@formula
def mean_load(mass, v_n, restitution, external_force, duration):
    """Mean force P = J/delta t of an impact on the surface, in N: the load of Eq. (32).

    Paper: Eq. (30).  `external_force` is E_n at first contact; the duration is never capped here, so that
    the load does not depend on the time step.
    """
    ext = compression_impulse(external_force, duration, math.inf, restitution)
    return surface_normal_impulse(mass, v_n, restitution, ext) / duration
