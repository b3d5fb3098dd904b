"""Finnie's erosion law for one impact, and what it becomes when a soft contact is integrated through it.

The law of 1960 removes k m v^2 f(alpha) at once, from speed and angle at impact.  LIGGGHTS resolves the
contact and adds up 2 k f(gamma) |v| |F| dt while the sphere approaches, with the speed and the angle gamma of
each instant (its finnie-wear.pdf, Eq. 4.23, where gamma is taken not to change).  On a wall without friction
only the normal speed falls, and gamma goes to zero.  That integral is here in closed form, and by quadrature
over a linear spring and dashpot.  What the paper removes is in `indent.py`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq

STEEP = 1 / 3  # f = STEEP cos^2 beyond tan(alpha) = 1/3; LIGGGHTS writes 0.33333
BEND = float(np.arctan(1 / 3))  # rad


def finnie_angle(angle: float, steep: float = STEEP) -> float:
    """Finnie's function of the impact angle, measured from the surface (rad).

    I. Finnie, Wear 3 (1960) 87, with K = 2: sin 2a - 3 sin^2 a up to tan a = 1/3, then cos^2(a)/3.

    >>> round(finnie_angle(np.pi / 4), 12), finnie_angle(0.0)
    (0.166666666667, 0.0)
    """
    if angle <= BEND:
        return float(np.sin(2 * angle) - 3 * np.sin(angle) ** 2)
    return float(steep * np.cos(angle) ** 2)


def finnie_impact(mass: float, speed: float, angle: float, coefficient: float) -> float:
    """Volume that one impact removes by Finnie's law, k m v^2 f(angle), in m3.

    Parameters: mass, kg; speed, m/s; angle, rad, from the surface; coefficient, k, 1/Pa.

    >>> round(finnie_impact(2.0, 3.0, np.pi / 4, 1.0), 12)
    3.0
    """
    return coefficient * mass * speed**2 * finnie_angle(angle)


def finnie_contact(
    mass: float, speed: float, angle: float, coefficient: float, steep: float = STEEP
) -> float:
    """Volume removed by Finnie's law integrated over a contact without friction, in m3, in closed form.

    With F dt = -m du, u the normal speed, and u = v_t tan(gamma) at constant v_t, the integral over the
    approach is 2 k m v_t^2 times that of f/cos^3 over gamma from 0 to the angle of impact: neither stiffness
    nor damping enters.  f/cos^3 is 2 tan sec - 3 tan^2 sec up to tan = 1/3, then steep sec.
    Parameters: as in `finnie_impact`; steep, the factor of cos^2 at steep angles.

    >>> round(finnie_contact(1.0, 1.0, 0.001, 1.0) / 2e-6, 2)
    1.0
    """

    def logarithm(gamma: float) -> float:  # of sec + tan, the integral of sec
        return float(np.arcsinh(np.tan(gamma)))

    shallow = min(angle, BEND)
    sec, tan = 1 / np.cos(shallow), np.tan(shallow)
    integral = 2 * tan**2 / (sec + 1) - 1.5 * (sec * tan - logarithm(shallow))  # the first is 2 (sec - 1)
    if angle > BEND:
        integral += steep * (logarithm(angle) - logarithm(BEND))
    return float(2 * coefficient * mass * (speed * np.cos(angle)) ** 2 * integral)


def finnie_contact_quadrature(
    mass: float,
    speed: float,
    angle: float,
    coefficient: float,
    damping_ratio: float = 0.0,
    steep: float = STEEP,
) -> float:
    """The same by quadrature over time, force and velocity of a linear spring and dashpot, in m3.

    Time is in units of 1/w, w^2 = k/m, which drop out.  Parameters: as in `finnie_contact`; damping_ratio,
    0 <= zeta < 1.

    >>> round(finnie_contact_quadrature(1.0, 1.0, 0.5, 1.0, 0.2) / finnie_contact(1.0, 1.0, 0.5, 1.0), 9)
    1.0
    """
    u_0, v_t = speed * np.sin(angle), speed * np.cos(angle)

    def rate(t: float) -> float:
        u, acceleration = _approach(t, u_0, damping_ratio)
        law = finnie_angle(np.arctan2(max(u, 0.0), v_t), steep)
        return 2 * coefficient * law * float(np.hypot(u, v_t)) * mass * acceleration

    return _over_approach(rate, u_0, v_t, damping_ratio, coefficient * mass * speed**2)


def finnie_contact_excess(
    mass: float,
    speed: float,
    angle: float,
    coefficient: float,
    steps_per_contact: int,
    damping_ratio: float = 0.0,
    steep: float = STEEP,
) -> float:
    """How much more than the integral a sum over steps gives, to first order in the step, in m3.

    F dt = m (u_i - u_i+1) in each step, and the rest is taken at its begin: with g(u) = 2 k m f |v| the sum
    of g(u_i) (u_i - u_i+1) exceeds the integral of g du by half the step times the integral of g' a^2 over
    time, a the deceleration.  g/(2 k m v_t) is (2 q - 3 q^2)/sqrt(1 + q^2) of q = u/v_t up to 1/3, then
    steep/sqrt(1 + q^2).  At grazing incidence without damping it is pi^2/2 k m u^2 by steps.
    Parameters: as in `finnie_contact_quadrature`; a contact lasts until the force vanishes.

    >>> round(finnie_contact_excess(1.0, 1.0, 0.001, 1.0, 100) / (1e-8 * np.pi**2 / 2), 2)
    1.0
    """
    u_0, v_t = speed * np.sin(angle), speed * np.cos(angle)

    def rate(t: float) -> float:
        u, acceleration = _approach(t, u_0, damping_ratio)
        q = u / v_t
        slope = 2 - 6 * q - 3 * q**3 if q <= 1 / 3 else -steep * q
        return coefficient * mass * slope / (1 + q * q) ** 1.5 * acceleration**2

    step = 2 * np.arccos(damping_ratio) / np.sqrt(1 - damping_ratio**2) / steps_per_contact
    return float(step) * _over_approach(rate, u_0, v_t, damping_ratio, coefficient * mass * speed**2)


def _approach(t: float, u_0: float, damping_ratio: float) -> tuple[float, float]:
    """Speed of approach and deceleration at t after touch, in units of time in which w = 1."""
    damped = np.sqrt(1 - damping_ratio**2)
    decay, sine, cosine = u_0 * np.exp(-damping_ratio * t), np.sin(damped * t), np.cos(damped * t)
    u = float(decay * (cosine - damping_ratio / damped * sine))
    return u, float(decay * sine / damped) + 2 * damping_ratio * u


def _over_approach(
    rate: Callable[[float], float], u_0: float, v_t: float, damping_ratio: float, scale: float
) -> float:
    """Integral of a rate until the approach ends, in two parts: f bends where tan(gamma) = 1/3."""
    end, bend = float(np.arccos(damping_ratio) / np.sqrt(1 - damping_ratio**2)), 0.0

    def beyond(t: float) -> float:
        return _approach(t, u_0, damping_ratio)[0] - v_t / 3

    if beyond(end) < 0.0 < beyond(0.0):
        bend = float(brentq(beyond, 0.0, end, xtol=1e-15, rtol=1e-14))
    parts = ((0.0, bend), (bend, end))
    return float(sum(quad(rate, *part, epsabs=1e-13 * scale, epsrel=1e-12)[0] for part in parts))
