"""What an impact's load removes: stress under a point load, yield radius, and the spherical cap.

The stress is differentiated from the displacement of an elastic half-space under a point load, the yield
radius found by root finding, and the cap integrated; none of the paper's Eqs 32 to 36 is used.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq


class Removal(NamedTuple):
    """Cap taken from the surface by one impact."""

    yield_radius: float  # m, at most the radius of the sphere
    depth: float  # m
    volume: float  # m3


def point_load_stress(load: float, r: float, z: float, poisson_ratio: float) -> np.ndarray:
    """Stress tensor in a half-space under a normal point load, from its displacement field.

    Displacement times 4 pi G/P: u_r = r z/g^3 - (1-2 nu) r/(g (g+z)), u_z = z^2/g^3 + 2 (1-nu)/g, with
    g = sqrt(r^2 + z^2); the strain is its derivative by a complex step, exact to round-off, and the stress
    follows from Hooke's law.
    Parameters: load, N, pressing; r, m, from the axis; z, m, into the solid; poisson_ratio in [0, 0.5).
    Returns (3, 3) in (r, theta, z), Pa, tension positive.

    >>> stress = point_load_stress(2 * np.pi, 1.0, 0.0, 0.0)
    >>> np.diag(stress).round(12).tolist()
    [1.0, -1.0, 0.0]
    """
    nu = poisson_ratio
    step = 1e-30 * np.hypot(r, z)

    def radial_over_r(r: complex, z: complex) -> complex:
        g = np.sqrt(r * r + z * z)
        return z / g**3 - (1 - 2 * nu) / (g * (g + z))

    def axial(r: complex, z: complex) -> complex:
        g = np.sqrt(r * r + z * z)
        return z * z / g**3 + 2 * (1 - nu) / g

    r_c, z_c = complex(r, step), complex(z, step)
    e_r = (r_c * radial_over_r(r_c, z)).imag / step
    e_theta = radial_over_r(r, z)
    e_z = axial(r, z_c).imag / step
    e_rz = 0.5 * ((r * radial_over_r(r, z_c)).imag + axial(r_c, z).imag) / step
    strain = np.array([[e_r, 0.0, e_rz], [0.0, e_theta, 0.0], [e_rz, 0.0, e_z]])
    dilation = nu / (1 - 2 * nu) * np.trace(strain) * np.eye(3)
    return load / (2 * np.pi) * (strain + dilation)


def tensor_von_mises(stress: np.ndarray) -> float:
    """Von Mises stress as the norm of the deviator, sqrt(3/2 s:s).

    >>> tensor_von_mises(np.diag([3.0, 0.0, 0.0]))
    3.0
    """
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    return float(np.sqrt(1.5 * np.sum(deviator**2)))


def yield_radius(load: float, poisson_ratio: float, yield_stress: float) -> float:
    """Radius on the free surface at which the von Mises stress under a point load equals the yield stress.

    Paper: what Eq. (34) states, found as a root.  An incompressible solid has no stress there: 0.
    Parameters: load, N; yield_stress, Pa.  Returns m, not limited by the size of the sphere.

    >>> round(yield_radius(2 * np.pi, 0.0, 3**0.5), 12)
    1.0
    """
    if load <= 0 or poisson_ratio >= 0.5:
        return 0.0
    scale = np.sqrt(load / yield_stress)

    def excess(q: float) -> float:
        stress = point_load_stress(load, q * scale, 0.0, poisson_ratio)
        return tensor_von_mises(stress) / yield_stress - 1

    return float(scale * brentq(excess, 1e-6, 1.0, xtol=1e-18, rtol=1e-15))


def cap_depth(cap_radius: float, radius: float) -> float:
    """Depth of the spherical cap whose rim has the given radius, from the angle it subtends.

    >>> round(cap_depth(3.0, 5.0), 12)
    1.0
    """
    return float(2 * radius * np.sin(0.5 * np.arcsin(cap_radius / radius)) ** 2)


def cap_volume(depth: float, radius: float) -> float:
    """Volume of a spherical cap by quadrature of its slices.

    >>> round(cap_volume(1.0, 1.0) / np.pi, 12)
    0.666666666667
    """
    return float(quad(lambda s: np.pi * s * (2 * radius - s), 0.0, depth, epsabs=0.0, epsrel=1e-13)[0])


def removal(load: float, radius: float, poisson_ratio: float, yield_stress: float) -> Removal:
    """Cap removed by a mean load, at most a hemisphere of the sphere.

    Paper: what Eqs. (32)-(36) state.  Parameters: load, N; radius, m, of the sphere; yield_stress, Pa.

    >>> round(removal(1e9, 1.0, 0.3, 1.0).depth, 12)
    1.0
    """
    x_p = min(yield_radius(load, poisson_ratio, yield_stress), radius)
    depth = cap_depth(x_p, radius)
    return Removal(x_p, depth, cap_volume(depth, radius))
