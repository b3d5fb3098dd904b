"""Elastic and damped contacts of spheres with springs: stiffnesses, deepest approach, force, duration.

Hertz's contact (force K d^1.5) and a spring-dashpot (force k d).  How an oblique impact leaves is
`oblique.py`; the paper's own duration of an impact is `wall.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

BETA = math.gamma(0.4) * math.gamma(0.5) / math.gamma(0.9)  # Euler's B(2/5, 1/2)


class ElasticImpact(NamedTuple):
    """The extremes of an elastic impact."""

    deepest: float  # approach, m
    force: float  # the largest, N
    duration: float  # s


def plane_strain_modulus(young: float, poisson: float) -> float:
    """E/(1 - nu^2) of one body, Pa: the E* of a contact with a rigid one.

    >>> plane_strain_modulus(3.0, 0.5)
    4.0
    """
    return young / (1.0 - poisson**2)


def shear_modulus(young: float, poisson: float) -> float:
    """G/(2 - nu) of one body, Pa: Mindlin's G* of a contact with a rigid one; G = E/(2 (1 + nu)).

    >>> shear_modulus(4.5, 0.5)
    1.0
    """
    return young / (2.0 * (1.0 + poisson)) / (2.0 - poisson)


def in_series(first: float, second: float) -> float:
    """The modulus of two bodies in contact, each given with the other one rigid.

    >>> in_series(2.0, 2.0)
    1.0
    """
    return 1.0 / (1.0 / first + 1.0 / second)


def hertz_stiffness(modulus: float, radius: float) -> float:
    """K = (4/3) E* sqrt(R*), N/m^1.5.

    >>> hertz_stiffness(3.0, 4.0)
    8.0
    """
    return 4.0 / 3.0 * modulus * math.sqrt(radius)


def mindlin_stiffness(shear: float, radius: float) -> float:
    """8 G* sqrt(R*), N/m^1.5: times sqrt(d) it is Mindlin's tangential stiffness without slip.

    >>> mindlin_stiffness(1.0, 4.0)
    16.0
    """
    return 8.0 * shear * math.sqrt(radius)


def hertz_impact(mass: float, stiffness: float, speed: float) -> ElasticImpact:
    """Elastic impact with the force K d^1.5 (Hertz; Chung and Ooi 2011, Section 3).

    m v^2/2 = (2/5) K d^2.5 at the deepest point; the duration 2 int dd/v(d) is (4/5) B(2/5, 1/2) d/v.
    Parameters: effective mass, kg; K, N/m^1.5; speed of approach, m/s.

    >>> round(hertz_impact(1.0, 1.25, 1.0).duration, 5)
    2.94328
    """
    deepest = (1.25 * mass * speed**2 / stiffness) ** 0.4
    return ElasticImpact(deepest, stiffness * deepest**1.5, 0.8 * BETA * deepest / speed)


def spring_impact(mass: float, stiffness: float, speed: float) -> ElasticImpact:
    """Elastic impact with the force k d: half a period.  Parameters as in `hertz_impact`; k, N/m.

    >>> spring_impact(4.0, 1.0, 1.0).deepest
    2.0
    """
    frequency = math.sqrt(stiffness / mass)
    return ElasticImpact(speed / frequency, stiffness * speed / frequency, math.pi / frequency)


def damping_ratio(restitution: float) -> float:
    """The part z of critical damping that returns e = exp(-pi z/sqrt(1 - z^2)), when the force may pull.

    Hertz's contact with a dashpot c d^(1/4) obeys the same equation in x = d^(5/4) and the time
    int d^(1/4) dt (D. Antypov and J. Elliott, EPL 94 (2011) 50004), so e and z are joined alike, whatever the
    speed.  Raises ValueError for e outside (0, 1].

    >>> damping_ratio(1.0)
    0.0
    """
    if not 0.0 < restitution <= 1.0:
        raise ValueError(f"restitution = {restitution:g}: allowed: > 0, <= 1; 0 needs an infinite dashpot")
    logarithm = math.log(1.0 / restitution)
    return logarithm / math.hypot(math.pi, logarithm)


def fastest_return(restitution: float) -> float:
    """The largest speed of separation over that of approach, before the force begins to pull.

    A contact that pulls at its end returns e < this: int |F| dt = (1 + 2 fastest - e) m v.

    >>> fastest_return(1.0)
    1.0
    """
    z = damping_ratio(restitution)
    return math.exp(-z * (math.pi - 2.0 * math.asin(z)) / math.sqrt(1.0 - z * z))
