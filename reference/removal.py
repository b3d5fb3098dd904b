"""How much material one impact removes (Eqs 32-36): Boussinesq stress, von Mises, yield radius, cap.

What the load is stands in `contact.py`; where the removed volume is taken from, in `heightfield.py`.
"""

from __future__ import annotations

import math

import numpy as np

from reference.compiled import formula


@formula
def boussinesq_stress(load, r, z, poisson_ratio):
    """Stresses (sigma_r, sigma_theta, sigma_z, tau_rz) in a half-space under a point load, in Pa.

    Paper: Eq. (32).  z (m) points into the solid, r (m) is the distance from the axis, tension is positive;
    the load (N) acts at the origin, where the stress is singular.  Arrays broadcast.
    Departure: 1/r^2 - z/(gamma r^2) is written 1/(gamma (gamma + z)), which is the same and regular on the
    axis, where sigma_r = sigma_theta = P(1-2nu)/(4 pi z^2).

    >>> s_r, s_theta, s_z, tau = boussinesq_stress(2.0 * math.pi, 0.0, 1.0, 0.25)
    >>> float(s_r), float(s_theta), float(s_z), float(abs(tau))
    (0.25, 0.25, -3.0, 0.0)
    """
    gamma = np.sqrt(r * r + z * z)
    p = load / (2.0 * math.pi)
    a = (1.0 - 2.0 * poisson_ratio) / (gamma * (gamma + z))
    b = (1.0 - 2.0 * poisson_ratio) * z / gamma**3
    sigma_r = p * (a - 3.0 * z * r * r / gamma**5)
    sigma_theta = -p * (a - b)
    sigma_z = -3.0 * p * z**3 / gamma**5
    tau_rz = -3.0 * p * r * z * z / gamma**5
    return sigma_r, sigma_theta, sigma_z, tau_rz


@formula
def von_mises(sigma_r, sigma_theta, sigma_z, tau_rz):
    """Equivalent stress of von Mises for an axisymmetric stress, in Pa; yields at >= sigma_y.

    Paper: Eq. (33).

    >>> float(von_mises(3.0, 0.0, 0.0, 0.0))
    3.0
    """
    differences = (sigma_r - sigma_theta) ** 2 + (sigma_theta - sigma_z) ** 2 + (sigma_z - sigma_r) ** 2
    return np.sqrt(0.5 * differences + 3.0 * tau_rz**2)


@formula
def yield_radius(load, poisson_ratio, yield_stress):
    """Radius x_p of the yielded zone on the surface, in m.

    Paper: Eq. (34).  Not yet limited to the particle's radius.
    """
    return np.sqrt(math.sqrt(3.0) * load * (1.0 - 2.0 * poisson_ratio) / (2.0 * math.pi * yield_stress))


@formula
def indentation_depth(yield_radius, radius):
    """Depth of the spherical cap of base radius x_p on a sphere of radius R, in m.

    Paper: Eq. (35).  x_p is limited to R: a hemisphere at most.
    Departure: written x_p^2/(R + sqrt(R^2 - x_p^2)), which does not cancel for small x_p.

    >>> float(indentation_depth(3.0, 5.0))
    1.0
    """
    x_p = np.minimum(yield_radius, radius)
    return x_p * x_p / (radius + np.sqrt((radius - x_p) * (radius + x_p)))


@formula
def cap_volume(yield_radius, depth):
    """Volume of the spherical cap, V = pi dh (3 x_p^2 + dh^2)/6, in m3.

    Paper: Eq. (36) without the density.  `yield_radius` must not exceed the sphere's radius: see `cap`.
    """
    return math.pi * depth * (3.0 * yield_radius * yield_radius + depth * depth) / 6.0


@formula
def cap(load, radius, poisson_ratio, yield_stress):
    """Cap under a load: (x_p limited to R, depth, volume), in m, m, m3.

    Paper: Eqs. (34)-(36).
    """
    x_p = np.minimum(yield_radius(load, poisson_ratio, yield_stress), radius)
    depth = indentation_depth(x_p, radius)
    return x_p, depth, cap_volume(x_p, depth)


def yield_velocity(density, effective_modulus, yield_stress):
    """Normal speed at which an impact first yields, sqrt(26 (Y/E*)^4 Y/rho), in m/s.

    The default threshold of removal; the paper has none.
    """
    return math.sqrt(26.0 * (yield_stress / effective_modulus) ** 4 * yield_stress / density)
