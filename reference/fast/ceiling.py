"""How high the surface can be around a particle: a map of its maxima, which tells most that they are free.

Squares of the surface as in `heightfield.py`.  The surface only falls, so that an old map is a bound too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import kernel

REMAP = 16384  # steps, after which the map is made anew


class Ceiling(NamedTuple):
    """Highest nodes around each square of the surface."""

    height: np.ndarray  # (nx, ny), m
    across: np.ndarray  # (nx, ny), the same along x alone, m
    reach: float  # how far around a square the map looks, m


def ceiling_over(heights, spacing, reach):
    """A map that looks `reach` (m) or somewhat farther around each square."""
    span = math.ceil(reach / spacing) if heights.size > 0 else 0
    c = Ceiling(np.empty(heights.shape), np.empty(heights.shape), spacing * span)
    raise_ceiling(heights, span, c.height, c.across)
    return c


@kernel
def raise_ceiling(heights, span, height, across):
    """Fill `height` (nx, ny) with the highest node of those within `span` squares of each."""
    n_x, n_y = heights.shape
    for i in range(n_x):
        for j in range(n_y):
            across[i, j] = heights[i, j]
        for k in range(i - span, i + span + 2):
            for j in range(n_y):
                across[i, j] = max(across[i, j], heights[k % n_x, j])
        for j in range(n_y):
            height[i, j] = across[i, j]
        for k in range(-span, span + 2):
            shift = k % n_y
            for j in range(n_y - shift):
                height[i, j] = max(height[i, j], across[i, j + shift])
            for j in range(n_y - shift, n_y):
                height[i, j] = max(height[i, j], across[i, j + shift - n_y])


@kernel
def highest_node(heights):
    """Indices of the highest node; (0, 0) where there is none."""
    top_x, top_y = 0, 0
    for i in range(heights.shape[0]):
        for j in range(heights.shape[1]):
            if heights[i, j] > heights[top_x, top_y]:
                top_x, top_y = i, j
    return top_x, top_y
