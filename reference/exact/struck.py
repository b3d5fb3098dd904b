"""A sphere that rests on a wall and is struck along the normal: the impacts in turn, until all have parted.

Independent of the model's files.  What a contact of finite duration makes of it is no solution of Eqs (9) and
(29), and stands with the engines.
"""

from __future__ import annotations

from typing import NamedTuple

MOST_IMPACTS = 1000


class Struck(NamedTuple):
    """What has become of the two spheres; speeds are positive away from the wall."""

    lower: float  # velocity of the sphere that was at rest, m/s
    upper: float
    approaches: tuple[float, ...]  # speeds at which the lower sphere strikes the wall, m/s
    normal_impulse: float  # of the wall in all, N s


def resting_struck(mass_lower: float, mass_upper: float, speed: float, restitution: float) -> Struck:
    """Speeds after a sphere has fallen on another that rests on a wall, each impact over before the next.

    Paper: Eqs. (3)-(9) between the spheres and Eq. (29) at the wall, without external forces.  No time
    passes between the impacts.
    Parameters: masses, kg; speed of the upper sphere, m/s, positive towards the wall; restitution of both.
    Raises ValueError where the impacts do not end: two spheres and a wall collapse at small e.

    >>> resting_struck(1.0, 1.0, 1.0, 1.0)  # Newton's cradle
    Struck(lower=0.0, upper=1.0, approaches=(1.0,), normal_impulse=2.0)
    """
    lower, upper, approaches, impulse = 0.0, -speed, [], 0.0
    for _ in range(MOST_IMPACTS):
        if upper < lower:
            common = (mass_lower * lower + mass_upper * upper) / (mass_lower + mass_upper)
            lower, upper = (
                common + restitution * (common - lower),
                common + restitution * (common - upper),
            )
        elif lower < 0.0:
            approaches.append(-lower)
            impulse += (1.0 + restitution) * mass_lower * -lower
            lower *= -restitution
        else:
            return Struck(lower, upper, tuple(approaches), impulse)
    raise ValueError(f"e = {restitution}: the impacts do not end")
