"""What an impact leaves of a triangulated surface: which nodes fall, and how flat it is then.

Weights are solved for as the plane through three nodes, so that no formula of the model's surface is used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def lowered(
    z: ArrayLike, spacing: float, x: float, y: float, *, volume: float = 0.0, depth: float = 0.0
) -> np.ndarray:
    """Heights (nx, ny) after a removal at (x, y), in m.

    A `volume` (m3) is shared by the nodes of the triangle at (x, y), so that its centroid is there: the
    weights lambda of the three nodes satisfy sum lambda (x, y, 1) = (x, y, 1), and each node stands for the
    area h^2.  A `depth` (m) is taken off the nearest node.
    Parameters: z (nx, ny), m; spacing h, m; squares are cut from (i, j) to (i+1, j+1).

    >>> lowered(np.zeros((3, 3)), 1.0, 0.5, 0.25, volume=1.0)[:2, :2].tolist()
    [[-0.5, 0.0], [-0.25, -0.25]]
    """
    z = np.array(z, float)
    place = np.array([x, y]) / spacing
    corner = np.floor(place)
    if volume:
        third = [1.0, 0.0] if place[0] - corner[0] >= place[1] - corner[1] else [0.0, 1.0]
        nodes = corner + np.array([[0.0, 0.0], third, [1.0, 1.0]])
        weights = np.linalg.solve(
            np.vstack([nodes.T - corner[:, None], np.ones(3)]), [*(place - corner), 1.0]
        )
        for (i, j), weight in zip(nodes.astype(int), weights, strict=True):
            z[i % z.shape[0], j % z.shape[1]] -= weight * volume / spacing**2
    if depth:
        corners = corner + np.array([[a, b] for a in (0, 1) for b in (0, 1)])
        i, j = corners[np.argmin(np.linalg.norm(corners - place, axis=1))].astype(int)
        z[i % z.shape[0], j % z.shape[1]] -= depth
    return z


def flatness(z: ArrayLike, start: ArrayLike, target: float, exponent: float) -> float:
    """Eq (44): the mean of |z - z_o|^q over what it was at the start.

    >>> flatness([[1.0, 0.0]], [[2.0, 0.0]], 0.0, 3)
    0.125
    """
    now, then = (np.abs(np.asarray(heights, float) - target) ** exponent for heights in (z, start))
    return float(now.mean() / then.mean())
