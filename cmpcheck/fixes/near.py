"""Squares of the surface that hold what a particle may touch, remembered from one step to the next.

Where a particle was searched from, its closest point was at a distance d.  Moved by s, it has its closest
point at d + s or less, which from where it was is d + 2 s or less: triangles that were farther need not be
searched as long as it has not moved by more, and as no removal has changed the surface.  What is found
is that of `heightfield.surface_contact` to the bit: the same triangles are asked in the same order.
Nothing depends on what is remembered but the time it takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cmpcheck.fixes.kernels import uncounted
from reference.compiled import inlined
from reference.triangle import closest_point_on_triangle

MOST_SQUARES = 6  # a particle that needs more is searched for each time
STEPS_AHEAD = 100.0  # for which a particle's squares shall do, at the speed it has
WIDEST = 0.02  # of the radius: the longest way for which they are to do
ROUNDING = 1e-9  # of the radius: far more than that of positions and heights


class Near(NamedTuple):
    """What is remembered of N particles, by tag."""

    place: np.ndarray  # (N, 4), where it was searched from, and how far it may go, m; -1: nothing is known
    fallen: np.ndarray  # (N,), how often the surface had fallen
    number: np.ndarray  # (N,), how many squares
    sides: np.ndarray  # (N, MOST_SQUARES), of each square the first triangle, 1, the second, 2, or both, 3
    corners: np.ndarray  # (N, MOST_SQUARES, 8), its x0, x1, y0, y1, z00, z10, z01, z11, m


def empty_near(n: int) -> Near:
    """For `n` particles, of which nothing is known yet."""
    place = np.zeros((n, 4))
    place[:, 3] = -1.0
    return Near(
        place, np.zeros(n, np.int64), np.zeros(n, np.int32), np.zeros((n, MOST_SQUARES), dtype=np.int32),
        np.zeros((n, MOST_SQUARES, 8)),
    )  # fmt: skip


@inlined
def is_near(near, k, falls, px, py, pz):
    """Whether what is remembered of particle k still holds at a position."""
    if near.fallen[k] != falls:
        return False
    dx, dy, dz, way = px - near.place[k, 0], py - near.place[k, 1], pz - near.place[k, 2], near.place[k, 3]
    return way >= 0.0 and dx * dx + dy * dy + dz * dz <= way * way


@inlined
def beyond(p, low, high):
    """How far p is outside of [low, high]."""
    return max(low - p, p - high, 0.0)


@inlined
def closest_of(side, px, py, pz, x0, x1, y0, y1, z00, z10, z01, z11):
    """Closest point of triangle `side` of a square."""
    if side == 0:
        return closest_point_on_triangle(px, py, pz, x0, y0, z00, x1, y0, z10, x1, y1, z11)
    return closest_point_on_triangle(px, py, pz, x0, y0, z00, x1, y1, z11, x0, y1, z01)


@inlined
def contact_nearby(near, k, px, py, pz, radius):
    """Contact of particle k with its squares, what `surface_contact` returns but the triangle."""
    best, qx, qy, qz, found = radius * radius, 0.0, 0.0, 0.0, False
    for m in range(np.uint32(near.number[k])):
        x0, x1 = near.corners[k, m, 0], near.corners[k, m, 1]
        y0, y1 = near.corners[k, m, 2], near.corners[k, m, 3]
        z00, z10 = near.corners[k, m, 4], near.corners[k, m, 5]
        z01, z11 = near.corners[k, m, 6], near.corners[k, m, 7]
        away_x, away_y = beyond(px, x0, x1), beyond(py, y0, y1)
        away_z = beyond(pz, min(z00, z10, z01, z11), max(z00, z10, z01, z11))
        if away_x * away_x + away_y * away_y + away_z * away_z > best:
            continue
        for side in range(2):
            if near.sides[k, m] & (1 + side):
                x, y, z_side = closest_of(side, px, py, pz, x0, x1, y0, y1, z00, z10, z01, z11)
                square = (x - px) ** 2 + (y - py) ** 2 + (z_side - pz) ** 2
                if square < best:
                    best, qx, qy, qz, found = square, x, y, z_side, True
    if not found:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    distance = math.sqrt(best)
    return (
        True, radius - distance, (px - qx) / distance, (py - qy) / distance, (pz - qz) / distance, qx, qy, qz
    )  # fmt: skip


@uncounted
def remember(near, k, falls, z, spacing, px, py, pz, distance, way):
    """Note the squares of particle k that it may touch on a `way` (m), its closest point `distance` (m) off.

    Nothing is remembered of one whose centre might reach the surface, or that has too many.
    """
    n_x, n_y = z.shape
    near.place[k, 3] = -1.0
    if not distance > 2.0 * way:
        return
    reach, count = (distance + 2.0 * way) * (1.0 + ROUNDING), 0
    for i in range(math.floor((px - reach) / spacing), math.floor((px + reach) / spacing) + 1):
        for j in range(math.floor((py - reach) / spacing), math.floor((py + reach) / spacing) + 1):
            x0, x1, y0, y1 = i * spacing, (i + 1) * spacing, j * spacing, (j + 1) * spacing
            i0, j0 = i % n_x, j % n_y
            i1 = i0 + 1 if i0 + 1 < n_x else 0
            j1 = j0 + 1 if j0 + 1 < n_y else 0
            z00, z10, z01, z11 = z[i0, j0], z[i1, j0], z[i0, j1], z[i1, j1]
            away_x, away_y = beyond(px, x0, x1), beyond(py, y0, y1)
            away_z = beyond(pz, min(z00, z10, z01, z11), max(z00, z10, z01, z11))
            if away_x * away_x + away_y * away_y + away_z * away_z > reach * reach:
                continue
            sides = 0
            for side in range(2):
                x, y, z_side = closest_of(side, px, py, pz, x0, x1, y0, y1, z00, z10, z01, z11)
                if (x - px) ** 2 + (y - py) ** 2 + (z_side - pz) ** 2 <= reach * reach:
                    sides += 1 + side
            if sides > 0:
                if count == MOST_SQUARES:
                    return
                near.sides[k, count] = sides
                for column, corner in enumerate((x0, x1, y0, y1, z00, z10, z01, z11)):
                    near.corners[k, count, column] = corner
                count += 1
    near.place[k, 0], near.place[k, 1], near.place[k, 2], near.place[k, 3] = px, py, pz, way
    near.fallen[k], near.number[k] = falls, count
