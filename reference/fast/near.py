"""Pairs that may touch, in two lists: those within a wide skin, and of these the nearly touching.

The wide list holds as long as no particle has left its place, relative to the mean of all, by half of the
skin that the narrow list leaves; the narrow one as long as boxes of velocities (`watch.py`) keep any two from
coming nearer by its skin.  Between its makings positions along x and y are not wrapped, so that the image of
the second particle that the first one meets stays the same: each pair keeps the way to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.contact import effective_modulus
from reference.neighbors import half_period, minimum_image, nearest_image, neighbor_pairs, shift_to_image
from reference.timestep import wrap

FEW = 200  # particles, up to which all pairs are looked at
WIDE, NARROW = 1.0, 0.1  # skins, of the largest diameter; those of many particles are in `ways.py`


@inner
def settle(s, n, periods):
    """Wrap the positions of n particles, as is done before pairs are listed."""
    for i in range(n):
        s.x[i], s.y[i], s.z[i] = wrap(s.x[i], periods[0]), wrap(s.y[i], periods[1]), wrap(s.z[i], periods[2])


class Origin(NamedTuple):
    """Where particles were when the wide list was made."""

    x: np.ndarray  # (N,), m
    y: np.ndarray
    z: np.ndarray


class Fact(NamedTuple):
    """What a pair in the narrow list has: these are the places among its FACTS numbers."""

    reach: int = 0  # square of the distance at which it touches, m2
    rigid: int = 1  # R E*^2, m Pa2
    shift_x: int = 2  # from the second particle to the image of it that the first one meets, m
    shift_y: int = 3


F = Fact()
FACTS = len(F)


class Lists(NamedTuple):
    """Room for as many pairs as are in the wide list, P.

    Numbers of particles are unsigned: of others compiled code asks at each use whether they are negative.
    """

    wide: np.ndarray  # (P, 2), particles
    narrow: np.ndarray  # (2 P,), particles of those that are nearly touching, two and two
    facts: np.ndarray  # (FACTS P,), what does not change of each of these, see `Fact`


@inner
def lists_of(wide):
    """Lists for a wide list of pairs."""
    pairs = wide.shape[0]
    return Lists(wide.astype(np.uint32), np.empty(2 * pairs, np.uint32), np.empty(FACTS * pairs))


@inner
def squares_from(x, y, z, i, length_x, length_y, length_z, half_x, half_y, half_z, square):
    """Squared distances, to the nearest image, of particle i from the ones after it, into `square`."""
    for j in range(i + 1, square.size):
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        dx = dx - length_x if dx > half_x else (dx + length_x if dx < -half_x else dx)
        dy = dy - length_y if dy > half_y else (dy + length_y if dy < -half_y else dy)
        dz = dz - length_z if dz > half_z else (dz + length_z if dz < -half_z else dz)
        square[j] = dx * dx + dy * dy + dz * dz


@inner
def pairs_of_few(s, n, cutoff, periods):
    """As `neighbor_pairs`, by looking at all pairs: with few particles vector instructions beat cells."""
    length_x, length_y, length_z = periods[0], periods[1], periods[2]
    half_x, half_y, half_z = half_period(length_x), half_period(length_y), half_period(length_z)
    square = np.empty(n)
    pairs, found = np.empty((n * (n - 1) // 2, 2), np.int64), 0
    for i in range(n):
        squares_from(s.x, s.y, s.z, i, length_x, length_y, length_z, half_x, half_y, half_z, square)
        for j in range(i + 1, n):
            if square[j] < cutoff * cutoff:
                pairs[found, 0], pairs[found, 1] = i, j
                found += 1
    return pairs[:found]


@inner
def list_wide(s, wide, largest, periods, origin):
    """All pairs (P, 2) closer than 1 + `wide` times the largest diameter; positions go to `origin`."""
    n, cutoff = origin.x.shape[0], (1.0 + wide) * largest
    position = np.empty((n, 3))
    for i in range(n):
        position[i, 0], position[i, 1], position[i, 2] = s.x[i], s.y[i], s.z[i]
        origin.x[i], origin.y[i], origin.z[i] = position[i]
    if n <= FEW:
        return pairs_of_few(s, n, cutoff, periods)
    return neighbor_pairs(position, cutoff, periods)


@inner
def ways_from(s, origin, periods, apart):
    """How far each particle is from its origin, relative to the mean of all, m; `apart` (N,)."""
    n = origin.x.shape[0]
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(n):
        mx += minimum_image(s.x[i] - origin.x[i], periods[0])
        my += minimum_image(s.y[i] - origin.y[i], periods[1])
        mz += minimum_image(s.z[i] - origin.z[i], periods[2])
    mx, my, mz = mx / n, my / n, mz / n
    for i in range(n):
        dx = minimum_image(s.x[i] - origin.x[i], periods[0]) - mx
        dy = minimum_image(s.y[i] - origin.y[i], periods[1]) - my
        dz = minimum_image(s.z[i] - origin.z[i], periods[2]) - mz
        apart[i] = math.sqrt(dx * dx + dy * dy + dz * dz)


@inner
def farthest(apart):
    """The longest of the ways `apart` (N,), or one that is not a number."""
    most = 0.0
    for i in range(apart.size):
        if not apart[i] <= most:
            most = apart[i]
    return most


@inner
def list_narrow_of(s, lists, skin, periods):
    """List those of the wide pairs that are closer than touching and `skin`; return how many they are.

    Of each R E*^2 is kept: what Hertz's duration needs of a pair that does not change.
    """
    wide, narrow, facts, at = lists.wide, lists.narrow, lists.facts, 0
    half_x, half_y, half_z = half_period(periods[0]), half_period(periods[1]), half_period(periods[2])
    for pair in range(wide.shape[0]):
        i, j = wide[pair, 0], wide[pair, 1]
        dx, dy = s.x[j] - s.x[i], s.y[j] - s.y[i]
        shift_x, shift_y = shift_to_image(dx, periods[0], half_x), shift_to_image(dy, periods[1], half_y)
        dx, dy, dz = dx + shift_x, dy + shift_y, nearest_image(s.z[j] - s.z[i], periods[2], half_z)
        touching = s.radius[i] + s.radius[j]
        reach = touching + skin
        if dx * dx + dy * dy + dz * dz < reach * reach:
            narrow[2 * at], narrow[2 * at + 1] = i, j
            modulus = effective_modulus(s.modulus[i], s.modulus[j])
            facts[FACTS * at + F.reach] = touching * touching
            facts[FACTS * at + F.rigid] = s.radius[i] * s.radius[j] / touching * modulus * modulus
            facts[FACTS * at + F.shift_x], facts[FACTS * at + F.shift_y] = shift_x, shift_y
            at += 1
    return at


@part
def fastest(x_low, x_high, y_low, y_high, z_low, z_high, mean_x, mean_y):
    """The highest speed in a box of velocities, relative to a mean, m/s."""
    a, b, c = max(x_high - mean_x, mean_x - x_low), max(y_high - mean_y, mean_y - y_low), max(z_high, -z_low)
    return math.sqrt(a * a + b * b + c * c)


@inner
def mean(values, n):
    """Mean of the first n values."""
    total = 0.0
    for i in range(n):
        total += values[i]
    return total / n
