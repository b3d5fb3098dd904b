"""Oblique impact of a spinning sphere: rigid sliding in closed form, and elastic stick and slip integrated.

The tangential law is the one that LAMMPS (`mindlin`, `linear_history`) and LIGGGHTS (`tangential history`)
state: F_t = k_t xi, cut at mu |F_n|, where xi is the tangential displacement and k_t may depend on the depth.
Extremes of the normal motion are `hertz.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from reference.exact.hertz import damping_ratio

INERTIA = 0.4  # of a solid sphere, in m r^2
SWITCHES = 60  # between stick and slip; more is no impact
START = 1e-10  # of the deepest approach: where the integration begins


class Rebound(NamedTuple):
    """How a sphere leaves a wall that it has struck without spin."""

    normal: float  # speed away from the wall over that of approach
    tangential: float  # velocity along the wall over that before, e_t
    surface_speed: float  # of the sphere's surface times radius, r omega, m/s, rolling forward > 0
    contact: float  # tangential velocity of the point of contact, m/s

    def angle(self, speed: float) -> float:
        """Angle of the velocity of the point of contact to the normal, degrees; speed of approach, m/s."""
        return math.degrees(math.atan2(self.contact, self.normal * speed))


def sliding(normal_speed: float, tangential_speed: float, friction: float, restitution: float) -> Rebound:
    """Rigid sphere that slides until it leaves: e_t = 1 - mu (1 + e) v_n/v_t, r omega = (5/2) mu (1 + e) v_n.

    Source: Kharaz, Gorham and Salman 2001; Chung and Ooi 2011.  Speeds in m/s.
    Raises ValueError where it would stop sliding first: tan theta < (7/2) mu (1 + e).

    >>> sliding(1.0, 4.0, 0.5, 1.0).tangential
    0.75
    """
    impulse = friction * (1.0 + restitution) * normal_speed
    if tangential_speed < impulse * (1.0 + 1.0 / INERTIA):
        raise ValueError(
            f"tangential speed = {tangential_speed:g} m/s: allowed: >= {impulse * (1.0 + 1.0 / INERTIA):g}, "
            "or it does not slide to the end"
        )
    spin = impulse / INERTIA
    after = tangential_speed - impulse
    return Rebound(restitution, after / tangential_speed, spin, after - spin)


def sliding_angle(friction: float, restitution: float) -> float:
    """Angle of incidence in degrees from which on a rigid sphere slides to the end, tan = (7/2) mu (1 + e).

    >>> round(sliding_angle(0.092, 0.98), 2)
    32.52
    """
    return math.degrees(math.atan((1.0 + 1.0 / INERTIA) * friction * (1.0 + restitution)))


@dataclass(frozen=True)
class Law:
    """A contact with a rigid wall, per mass of the sphere."""

    stiffness: float  # K/m of K d^1.5, 1/(s2 m^0.5), or k/m of k d, 1/s2
    shear: float  # of (S sqrt(d)) xi, or of k_t xi, over m
    hertz: bool
    friction: float
    restitution: float
    radius: float  # m
    shortening: float = 0.0  # of the arm r - shortening * d at which friction turns the sphere

    @property
    def damping(self) -> float:
        """c/m of the dashpot's force c d^(1/4) v or c v.

        In x = d^(5/4) and the time int d^(1/4) dt a Hertz contact is a spring of (5/4) K with the same
        dashpot: c = 2 z sqrt((5/4) K m) (`hertz.damping_ratio`).
        """
        return (
            2.0 * damping_ratio(self.restitution) * math.sqrt(self.stiffness * (1.25 if self.hertz else 1.0))
        )

    def normal_force(self, d: float, v: float) -> float:
        """Force over mass at the depth d, which grows by v, m/s2."""
        if self.hertz:
            return self.stiffness * d**1.5 + self.damping * d**0.25 * v
        return self.stiffness * d + self.damping * v

    def shear_stiffness(self, d: float) -> float:
        """Tangential stiffness over mass at the depth d, 1/s2."""
        return self.shear * math.sqrt(d) if self.hertz else self.shear

    def limit(self, d: float, v: float) -> float:
        """Largest displacement xi that friction holds, m."""
        return self.friction * abs(self.normal_force(d, v)) / self.shear_stiffness(d)

    def limit_rate(self, d: float, v: float) -> float:
        """Its change in time, m/s."""
        f = self.normal_force(d, v)
        if self.hertz:
            k, c = self.stiffness, self.damping
            rate = k * v - 0.25 * c * d**-1.25 * v * v - c * d**-0.25 * f
            return self.friction * math.copysign(1.0, f) * rate / self.shear
        rate = self.stiffness * v - self.damping * f
        return self.friction * math.copysign(1.0, f) * rate / self.shear


def oblique_impact(law: Law, normal_speed: float, tangential_speed: float) -> Rebound:
    """Impact of a sphere without spin, integrated through stick and slip until the depth is 0 again.

    Parameters: speeds before, m/s, along the wall >= 0.  Raises RuntimeError when the integration fails.
    """
    deepest = (
        (1.25 * normal_speed**2 / law.stiffness) ** 0.4
        if law.hertz
        else normal_speed / math.sqrt(law.stiffness)
    )
    r, d = law.radius, START * deepest

    def slip(y: np.ndarray) -> float:
        return float(y[2] - (1.0 - law.shortening * y[0] / r) * y[3])

    def rates(_: float, y: np.ndarray, sign: float) -> list[float]:
        d, v = max(y[0], 0.0), y[1]
        f = law.normal_force(d, v)
        pull = sign * law.friction * abs(f) if sign else law.shear_stiffness(d) * y[4]
        turn = pull * (1.0 - law.shortening * d / r) / INERTIA
        return [v, -f, -pull, turn, 0.0 if sign else slip(y)]

    def left(_: float, y: np.ndarray, sign: float) -> float:
        return float(y[0])

    def switch(_: float, y: np.ndarray, sign: float) -> float:
        d, v = max(y[0], 1e-9 * START * deepest), y[1]
        return law.limit_rate(d, v) - sign * slip(y) if sign else abs(y[4]) - law.limit(d, v)

    left.terminal, left.direction = True, -1  # type: ignore[attr-defined]
    switch.terminal, switch.direction = True, 1  # type: ignore[attr-defined]
    # depth, its rate, velocity along the wall, r omega, and the displacement that friction holds
    y = np.array([d, normal_speed, tangential_speed, 0.0, tangential_speed * d / normal_speed])
    sign = 1.0 if y[4] > law.limit(d, normal_speed) else 0.0  # +-1: slips, held to that side; 0: sticks
    along = max(tangential_speed, 1e-3 * normal_speed)
    scale = np.array([deepest, normal_speed, along, along, deepest])
    t, unit = 0.0, deepest / normal_speed
    for _ in range(SWITCHES):
        done = solve_ivp(
            rates, (t, 20.0 * unit), y, "DOP853", events=(left, switch), rtol=1e-10, atol=1e-13 * scale,
            args=(sign,), max_step=0.05 * unit,
        )  # fmt: skip
        if not done.success or done.status != 1:
            raise RuntimeError(f"the impact does not end: {done.message}")
        t, y = float(done.t[-1]), done.y[:, -1]
        if len(done.t_events[0]):
            e_t = y[2] / tangential_speed if tangential_speed else math.nan
            return Rebound(-y[1] / normal_speed, e_t, float(y[3]), float(y[2] - y[3]))
        if sign:
            y[4], sign = sign * law.limit(y[0], y[1]), 0.0
        else:
            sign = math.copysign(1.0, y[4])
    raise RuntimeError(f"stick and slip change more than {SWITCHES} times")
