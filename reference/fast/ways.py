"""How far each of many particles may go in a block, and which pairs that brings near each other.

A particle may go as far as its box of velocities lets it (`watch.py`), and some more, relative to the mean of
all: contacts give it other boxes.  How far it has really gone, at most, is known when its piece has moved;
who has gone farther than that may have missed somebody.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from reference.compiled import inner
from reference.fast.groups import unite
from reference.neighbors import half_period, nearest_image

STEPS = 64  # of a block, at most
WIDE_SKIN = 1.5  # skin of the list of pairs from which those of a block are taken, of the largest diameter
LEEWAY = 0.1  # of the largest diameter, in as many steps: what a particle may go beyond its box
ANEW = 1.1  # times as far as it has gone may a particle go when it is moved again


class Reach(NamedTuple):
    """How far N particles may get, relative to the mean of all, m."""

    way: np.ndarray  # (N,), in this block
    apart: np.ndarray  # (N,), how far they are from where they were when the wide list was made


@inner
def allow_ways(reach, pace, steps, fixed, most):
    """Have particles go as far as their `pace` (N,) lets them in so many steps and more, up to `most` (m)."""
    way = reach.way
    for i in range(way.size):
        way[i] = min(steps * (fixed.dt * pace[i] + fixed.leeway), most)


@inner
def is_wide_enough(reach, largest):
    """Whether all pairs that may touch on their ways are in the wide list."""
    enough = True
    for i in range(reach.way.size):
        enough &= reach.apart[i] + reach.way[i] <= 0.5 * WIDE_SKIN * largest
    return enough


@inner
def list_reachable(s, lists, reach, periods):
    """List those of the wide pairs that may touch each other on their ways; return how many they are."""
    wide, narrow, way, at = lists.wide, lists.narrow, reach.way, 0
    half_x, half_y, half_z = half_period(periods[0]), half_period(periods[1]), half_period(periods[2])
    for pair in range(wide.shape[0]):
        i, j = wide[pair, 0], wide[pair, 1]
        square = square_of(s, i, j, periods, half_x, half_y, half_z)
        within = s.radius[i] + s.radius[j] + way[i] + way[j]
        narrow[2 * at], narrow[2 * at + 1] = i, j
        at += 1 if square < within * within else 0
    return at


@inner
def square_of(s, i, j, periods, half_x, half_y, half_z):
    """Squared distance of particles i and j, to the nearest image, m2."""
    dx = nearest_image(s.x[j] - s.x[i], periods[0], half_x)
    dy = nearest_image(s.y[j] - s.y[i], periods[1], half_y)
    dz = nearest_image(s.z[j] - s.z[i], periods[2], half_z)
    return dx * dx + dy * dy + dz * dz


@inner
def admit_strayed(s, lists, near, reach, gone, periods, parent, again):
    """Where particles have `gone` (N,) farther than they might, list those whom they may have missed.

    Both become of one group, which is marked in `again`; from then on they may go as far, and more.  Returns
    how many pairs are listed, `near` of them before.
    """
    way, some = reach.way, False
    for k in range(way.size):
        some |= gone[k] > way[k]
    if not some:
        return near
    farther = np.where(gone > way, ANEW * gone, way)
    wide, narrow = lists.wide, lists.narrow
    half_x, half_y, half_z = half_period(periods[0]), half_period(periods[1]), half_period(periods[2])
    for pair in range(wide.shape[0]):
        i, j = wide[pair, 0], wide[pair, 1]
        if farther[i] > way[i] or farther[j] > way[j]:
            square, touching = square_of(s, i, j, periods, half_x, half_y, half_z), s.radius[i] + s.radius[j]
            before, now = touching + way[i] + way[j], touching + farther[i] + farther[j]
            if square < now * now and not square < before * before:
                narrow[2 * near], narrow[2 * near + 1] = i, j
                near += 1
                unite(parent, np.int64(i), np.int64(j))
                again[i] = True
    way[:] = farther
    return near
