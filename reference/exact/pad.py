"""A sphere that flies along z between a wall and a pad that comes down and then rests: impact after impact.

Nothing else acts on it; friction, removal and fluid are left out.  The events are solved one by one, each as
a linear equation in time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

MOST_IMPACTS = 1000


class Pad(NamedTuple):
    """A plane above the wall."""

    height: float  # m, at time 0
    lowest: float  # m, where it stops
    descent: float  # m/s, until then
    restitution: float

    def at(self, times: ArrayLike) -> np.ndarray:
        """Its height at given times, m.

        >>> Pad(3.0, 1.0, 0.5, 1.0).at([0.0, 2.0, 9.0]).tolist()
        [3.0, 2.0, 1.0]
        """
        return np.maximum(self.height - self.descent * np.asarray(times, float), self.lowest)

    def speed_at(self, time: float) -> float:
        """Its speed, m/s, downwards."""
        return self.descent if self.height - self.descent * time > self.lowest else 0.0


class PadImpact(NamedTuple):
    """One impact."""

    time: float  # s
    kind: str  # pad | surface
    height: float  # m, of the centre
    approach_speed: float  # m/s, relative to the pad
    normal_impulse: float  # N s, > 0
    velocity: float  # m/s, along z, after it


def between_wall_and_pad(
    height: float, velocity: float, mass: float, radius: float, wall_restitution: float, pad: Pad,
    until: float,
) -> list[PadImpact]:  # fmt: skip
    """The impacts of a sphere before the time `until`.

    Paper: Eqs. (29) and (30) at the wall, z = 0, and at the pad in its own frame: J = (1 + e) m (v + V).
    Parameters: height of the centre, m; velocity along z, m/s.

    >>> hits = between_wall_and_pad(2.0, 1.0, 1.0, 1.0, 0.5, Pad(4.0, 4.0, 0.0, 0.5), 6.0)
    >>> [(hit.kind, hit.time, hit.velocity) for hit in hits]
    [('pad', 1.0, -0.5), ('surface', 5.0, 0.25)]
    """
    now, z, v = 0.0, height, velocity
    hits: list[PadImpact] = []
    rests = (pad.height - pad.lowest) / pad.descent if pad.descent > 0.0 else 0.0
    for _ in range(MOST_IMPACTS):
        times = [(np.inf, "surface")]
        if v < 0.0:
            times.append((now + (z - radius) / -v, "surface"))
        for begin, end, descent in ((now, rests, pad.descent), (max(now, rests), np.inf, 0.0)):
            start = max(begin, now)
            gap = float(pad.at(start)) - radius - (z + v * (start - now))
            if start < end and v + descent > 0.0:
                met = start + max(gap, 0.0) / (v + descent)
                if met < end:
                    times.append((met, "pad"))
                    break
        time, kind = min(times)
        if not time < until:
            return hits
        z, now = z + v * (time - now), time
        other = -pad.speed_at(time) if kind == "pad" else 0.0
        e = pad.restitution if kind == "pad" else wall_restitution
        approach = abs(v - other)
        v = other - e * (v - other)
        hits.append(PadImpact(time, kind, z, approach, (1.0 + e) * mass * approach, v))
    raise ValueError("the impacts do not end")
