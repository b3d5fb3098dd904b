"""Random sequential packing: particles placed one after another where they touch nothing (Section 4).

Knows diameters, periods, the surface and the room along z; what is packed and why is `process.py`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from reference.compiled import kernel
from reference.heightfield import surface_contact
from reference.neighbors import minimum_image

TRIES_PER_PARTICLE = 20_000  # random sequential packings of spheres jam near 38 % by volume


class PackingError(ValueError):
    """The particles do not fit by random sequential packing."""


@kernel
def _insert(
    candidates,
    diameter,
    z_low,
    z_high,
    periods,
    low,
    cell,
    counts,
    heights,
    spacing,
    head,
    following,
    position,
    placed,
):
    """Place particles from `placed` on at the first candidates that are free; return how many are placed.

    Candidates (C, 3) are uniform in [0, 1); `head` and `following` are the linked lists of a cell list.
    """
    n = diameter.shape[0]
    index, trial = np.empty(3, np.int64), np.empty(3)
    for c in range(candidates.shape[0]):
        if placed == n:
            break
        radius, free = 0.5 * diameter[placed], True
        trial[0], trial[1] = candidates[c, 0] * periods[0], candidates[c, 1] * periods[1]
        trial[2] = z_low[placed] + candidates[c, 2] * (z_high[placed] - z_low[placed])
        for axis in range(3):
            index[axis] = min(int((trial[axis] - low[axis]) / cell[axis]), counts[axis] - 1)
        for a in range(index[0] - 1, index[0] + 2):
            for b in range(index[1] - 1, index[1] + 2):
                for k in range(index[2] - 1, index[2] + 2):
                    if (periods[2] == 0.0 and (k < 0 or k >= counts[2])) or not free:
                        continue
                    other = head[a % counts[0], b % counts[1], k % counts[2]]
                    while other >= 0 and free:
                        square = 0.0
                        for axis in range(3):
                            d = minimum_image(position[other, axis] - trial[axis], periods[axis])
                            square += d * d
                        reach = radius + 0.5 * diameter[other]
                        free = square >= reach * reach
                        other = following[other]
        if free and heights.size > 0:
            free = not surface_contact(heights, spacing, trial[0], trial[1], trial[2], radius)[0]
        if free:
            position[placed] = trial
            following[placed] = head[index[0], index[1], index[2]]
            head[index[0], index[1], index[2]] = placed
            placed += 1
    return placed


def pack(
    diameter: np.ndarray,
    periods: ArrayLike,
    z_low: ArrayLike,
    z_high: ArrayLike,
    heights: np.ndarray,
    spacing: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Centres (N, 3), in m, of spheres placed one by one at uniformly random free places.

    Parameters: diameter (N,) in m; periods (3,) in m, 0 where not periodic; limits of z for centres, each
    (N,) or a number, in m; heights (nx, ny) of a surface to stay clear of, or (0, 0); a numpy Generator.
    Raises PackingError when a particle finds no place.
    """
    diameter = np.asarray(diameter, dtype=float)
    n, periods = diameter.size, np.asarray(periods, dtype=float)
    z_low, z_high = np.array(np.broadcast_to(z_low, n), float), np.array(np.broadcast_to(z_high, n), float)
    if (z_high < z_low).any():
        raise PackingError(f"no room for the particles along z: {z_low.max():g} m to {z_high.min():g} m")
    low = np.array([0.0, 0.0, z_low.min()])
    extent = np.array([periods[0], periods[1], periods[2] or max(z_high.max() - low[2], diameter.max())])
    counts = np.clip((extent / diameter.max()).astype(np.int64), 1, math.ceil(n ** (1 / 3)) * 4)
    head, following = np.full(counts, -1, np.int64), np.full(n, -1, np.int64)
    position, placed, batch, tries = np.empty((n, 3)), 0, max(64, n), 0
    while placed < n:
        first = placed
        placed = _insert(
            rng.random((batch, 3)), diameter, z_low, z_high, periods, low, extent / counts, counts,
            heights, spacing, head, following, position, first,
        )  # fmt: skip
        tries = 0 if placed > first else tries + batch
        if tries > TRIES_PER_PARTICLE:
            raise PackingError(
                f"random sequential packing placed {placed} of {n} particles and found no place for the next "
                f"in {tries} tries: fewer or smaller particles, or a larger box, are needed"
            )
    return position
