"""The wafer surface: a periodic triangulated heightfield (Sections 2.3 and 4, Eq 44).

z[i, j] is the node at (i h, j h); square (i, j) has two triangles that share the diagonal from (i, j) to
(i+1, j+1): number 2 (i ny + j) holds node (i+1, j), the next one node (i, j+1).  Here live height, closest
point, volume, lowering of nodes, asperities and flatness; not when and how much is removed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from reference.compiled import kernel
from reference.triangle import closest_point_on_triangle

ROUNDING = 1e-9  # of the radius: far more than the heights' own


@kernel
def _locate(z, spacing, x, y):
    """Square (i, j) below (x, y), wrapped, and the position (a, b) in it, each in [0, 1)."""
    u, w = x / spacing, y / spacing
    i, j = math.floor(u), math.floor(w)
    return i % z.shape[0], j % z.shape[1], u - i, w - j


@kernel
def _triangle_nodes(z, i, j, a, b):
    """Node indices and barycentric weights of the triangle that holds (a, b) of square (i, j)."""
    i1, j1 = (i + 1) % z.shape[0], (j + 1) % z.shape[1]
    if a >= b:
        return (i, j, 1.0 - a), (i1, j, a - b), (i1, j1, b)
    return (i, j, 1.0 - b), (i1, j1, a), (i, j1, b - a)


@kernel
def height_at(z, spacing, x, y):
    """Height of the surface at (x, y), in m."""
    i, j, a, b = _locate(z, spacing, x, y)
    (i0, j0, w0), (i1, j1, w1), (i2, j2, w2) = _triangle_nodes(z, i, j, a, b)
    return w0 * z[i0, j0] + w1 * z[i1, j1] + w2 * z[i2, j2]


@kernel
def closest_point(z, spacing, px, py, pz, radius):
    """Closest point of the surface within `radius` of (px, py, pz).

    Returns (found, qx, qy, qz, distance, triangle); q belongs to the periodic image nearest to p.
    """
    n_x, n_y = z.shape
    best, qx, qy, qz, triangle = radius * radius, 0.0, 0.0, 0.0, -1
    for i in range(math.floor((px - radius) / spacing), math.floor((px + radius) / spacing) + 1):
        x0, x1 = i * spacing, (i + 1) * spacing
        i0 = i % n_x
        i1 = i0 + 1 if i0 + 1 < n_x else 0
        away_x = max(x0 - px, px - x1, 0.0)
        for j in range(math.floor((py - radius) / spacing), math.floor((py + radius) / spacing) + 1):
            y0, y1 = j * spacing, (j + 1) * spacing
            j0 = j % n_y
            j1 = j0 + 1 if j0 + 1 < n_y else 0
            z00, z10, z01, z11 = z[i0, j0], z[i1, j0], z[i0, j1], z[i1, j1]
            away_y = max(y0 - py, py - y1, 0.0)
            away_z = max(pz - max(z00, z10, z01, z11), min(z00, z10, z01, z11) - pz, 0.0)
            if away_x * away_x + away_y * away_y + away_z * away_z > best:
                continue
            for side in range(2):
                if side == 0:
                    x, y, z_side = closest_point_on_triangle(
                        px, py, pz, x0, y0, z00, x1, y0, z10, x1, y1, z11
                    )
                else:
                    x, y, z_side = closest_point_on_triangle(
                        px, py, pz, x0, y0, z00, x1, y1, z11, x0, y1, z01
                    )
                square = (x - px) ** 2 + (y - py) ** 2 + (z_side - pz) ** 2
                if square < best:
                    best, qx, qy, qz = square, x, y, z_side
                    triangle = 2 * (i0 * n_y + j0) + side
    return triangle >= 0, qx, qy, qz, math.sqrt(best), triangle


@kernel
def surface_contact(z, spacing, px, py, pz, radius):
    """Contact of a sphere with the surface: (found, overlap, nx, ny, nz, qx, qy, qz, triangle).

    The normal points from the closest point to the centre; it is vertical when the centre is on or below
    the surface, where the sphere touches at the point above its centre.
    """
    ground = height_at(z, spacing, px, py)
    if pz <= ground:
        i, j, a, b = _locate(z, spacing, px, py)
        triangle = 2 * (i * z.shape[1] + j) + (0 if a >= b else 1)
        return True, radius + ground - pz, 0.0, 0.0, 1.0, px, py, ground, triangle
    reach = min(radius, pz - ground + ROUNDING * radius)  # the point below the centre is on the surface
    found, qx, qy, qz, distance, triangle = closest_point(z, spacing, px, py, pz, reach)
    if not found:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1
    n_x, n_y, n_z = (px - qx) / distance, (py - qy) / distance, (pz - qz) / distance
    return True, radius - distance, n_x, n_y, n_z, qx, qy, qz, triangle


@kernel
def remove_volume(z, spacing, x, y, volume):
    """Take exactly `volume` (m3) off the triangle at (x, y): node a falls by V lambda_a/h^2."""
    i, j, a, b = _locate(z, spacing, x, y)
    fall = volume / (spacing * spacing)
    for i_node, j_node, weight in _triangle_nodes(z, i, j, a, b):
        z[i_node, j_node] -= weight * fall


@kernel
def lower_node(z, spacing, x, y, depth):
    """Lower the node nearest to (x, y) by `depth` (m)."""
    i, j = math.floor(x / spacing + 0.5), math.floor(y / spacing + 0.5)
    z[i % z.shape[0], j % z.shape[1]] -= depth


class Heightfield:
    """A periodic triangulated surface.

    Parameters: `z` (nx, ny) node heights in m, copied; `spacing` h in m.  The periods are nx h and ny h.
    Raises ValueError for a spacing that is not positive, or heights that are not a finite 2-D array.

    >>> Heightfield([[0.0, 0.0], [0.0, 2.0]], 1.0).volume()
    2.0
    """

    def __init__(self, z: ArrayLike, spacing: float) -> None:
        self.z = np.array(z, dtype=np.float64, order="C")
        self.spacing = float(spacing)
        if self.z.ndim != 2 or self.z.size == 0 or not np.isfinite(self.z).all():
            raise ValueError(f"z must be a finite two-dimensional array, got shape {self.z.shape}")
        if not (math.isfinite(self.spacing) and self.spacing > 0.0):
            raise ValueError(f"spacing must be positive, got {spacing}")

    def height(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Height at (x, y), in m; arrays broadcast."""
        points = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        flat = [
            height_at(self.z, self.spacing, a, b) for a, b in zip(*(p.ravel() for p in points), strict=True)
        ]
        return np.reshape(flat, points[0].shape)[()]

    def volume(self) -> float:
        """Integral of z over one period, h^2 times the sum of the heights, in m3."""
        return float(self.spacing**2 * self.z.sum())

    def closest_point(
        self, point: Sequence[float] | np.ndarray, radius: float
    ) -> tuple[np.ndarray, float, int] | None:
        """Closest point of the triangles within `radius`: (point (3,), distance, triangle), or None."""
        px, py, pz = (float(c) for c in point)
        found, qx, qy, qz, distance, triangle = closest_point(self.z, self.spacing, px, py, pz, float(radius))
        return (np.array([qx, qy, qz]), distance, int(triangle)) if found else None

    def remove_volume(self, x: float, y: float, volume: float) -> None:
        """Take exactly `volume` (m3) off the three nodes of the triangle at (x, y).

        Departure: the paper does not say where the material is taken from.
        """
        _require_finite(x, y, volume)
        remove_volume(self.z, self.spacing, float(x), float(y), float(volume))

    def lower_node(self, x: float, y: float, depth: float) -> None:
        """Lower the node nearest to (x, y) by `depth` (m), as the paper's pictures imply."""
        _require_finite(x, y, depth)
        lower_node(self.z, self.spacing, float(x), float(y), float(depth))


def _require_finite(x: float, y: float, amount: float) -> None:
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(amount) and amount >= 0.0):
        raise ValueError(f"({x}, {y}) and {amount}; allowed: finite numbers, and an amount >= 0")


def raise_squares(nodes: int, size: float, height: float, corners: Iterable[Sequence[int]]) -> Heightfield:
    """A flat surface of `nodes` x `nodes` with squares of four nodes raised to `height` (m).

    Paper: Section 4.  `corners` (n, 2) holds the lower-left node of each square; squares are periodic.
    """
    z = np.zeros((nodes, nodes))
    for i, j in corners:
        z[np.ix_([i % nodes, (i + 1) % nodes], [j % nodes, (j + 1) % nodes])] = height
    return Heightfield(z, size / nodes)


def asperity_surface(
    nodes: int, size: float, height: float, density: float, rng: np.random.Generator
) -> Heightfield:
    """A random rough surface: N_a = rho_a n^2 squares of four nodes raised to h_a, which may overlap.

    Paper: Section 4, with rho_a = 2 N_a/N_e and two elements per square, N_e = 2 n^2.
    Parameters: nodes n per side, size D (m), height h_a (m), density rho_a, a numpy Generator.
    """
    return raise_squares(nodes, size, height, rng.integers(0, nodes, size=(round(density * nodes**2), 2)))


def flatness(z: ArrayLike, z_initial: ArrayLike, z_target: float, exponent: float) -> float:
    """Cost Pi of a surface: 1 at the start, 0 when every node has reached the target height.

    Paper: Eq. (44).  Heights in m, any shape; exponent q > 0.
    Raises ValueError where it is undefined: a surface that starts at the target height, two shapes, q <= 0.

    >>> flatness([0.0, 1.0], [0.0, 2.0], 0.0, 2)
    0.25
    """
    if not exponent > 0.0:
        raise ValueError(f"exponent {exponent}; allowed: > 0")
    start = np.abs(np.asarray(z_initial, dtype=float) - z_target)
    scale = start.max(initial=0.0)
    if scale == 0.0:
        raise ValueError(f"flatness is undefined: the surface starts at the target height {z_target} m")
    now = np.abs(np.asarray(z, dtype=float) - z_target)
    if now.shape != start.shape:
        raise ValueError(f"flatness needs the same nodes twice, got shapes {now.shape} and {start.shape}")
    return float(((now / scale) ** exponent).sum() / ((start / scale) ** exponent).sum())
