"""Where and when a sphere in straight flight first touches a plane or a triangulated surface.

Faces, edges and vertices are each met exactly, by linear and quadratic equations in time; no closest
point is searched.  What happens at the touch is in `wall.py`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

Candidate = tuple[float, np.ndarray, str]  # time, point of contact, feature


class SurfaceTouch(NamedTuple):
    """First touch of a sphere and a surface."""

    time: float  # s
    centre: np.ndarray  # (3,) of the sphere, m, unwrapped along its flight
    point: np.ndarray  # (3,) of contact, m, in the same image
    normal: np.ndarray  # (3,) from the point to the centre
    feature: str  # plane | face | edge | vertex


def quadratic_touch(separation: np.ndarray, velocity: np.ndarray, distance: float) -> np.ndarray:
    """Earliest time t >= 0 at which |separation + velocity t| falls to `distance`; inf if it never does.

    Parameters: separation and velocity (..., 3), m and m/s; distance, m.  Returns (...), s.
    Raises ValueError when the separation is below the distance from the start.

    >>> float(quadratic_touch(np.array([5.0, 0, 0]), np.array([-1.0, 0, 0]), 2.0))
    3.0
    """
    excess = np.sum(separation**2, axis=-1) - distance**2
    if np.any(excess < -1e-9 * distance**2):
        raise ValueError(f"overlap at the start: separation below the contact distance {distance} m")
    half_slope = np.sum(separation * velocity, axis=-1)
    discriminant = half_slope**2 - np.sum(velocity**2, axis=-1) * excess
    meets = (half_slope < 0) & (discriminant >= 0)
    root = np.sqrt(np.where(meets, discriminant, 0.0))
    time = np.maximum(excess, 0.0) / np.where(meets, root - half_slope, 1.0)
    return np.where(meets, time, np.inf)


def broken_line(
    times: ArrayLike, position: ArrayLike, velocity: ArrayLike, kink: float, velocity_after: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of straight flight whose velocity changes once, at time `kink`.

    Parameters: times (T,), s; position (3,), m, at time 0; velocities (3,), m/s; kink, s.
    Returns: positions (T, 3) and velocities (T, 3); at the kink itself the velocity after it.

    >>> positions, _ = broken_line([3.0], [0.0, 0.0, 2.0], [0.0, 0.0, -1.0], 2.0, [0.0, 0.0, 0.5])
    >>> float(positions[0, 2])
    0.5
    """
    t = np.asarray(times, float)[:, None]
    before, after = np.asarray(velocity, float), np.asarray(velocity_after, float)
    positions = np.asarray(position, float) + before * np.minimum(t, kink) + after * np.maximum(t - kink, 0.0)
    return positions, np.where(t < kink, before, after)


def meet_plane(position: ArrayLike, velocity: ArrayLike, radius: float, height: float = 0.0) -> SurfaceTouch:
    """First touch of a sphere in straight flight with the plane z = height, from above.

    Raises ValueError when the sphere does not descend or starts below the touch.

    >>> meet_plane([0.0, 0.0, 3.0], [1.0, 0.0, -1.0], 1.0).time
    2.0
    """
    position, velocity = np.asarray(position, float), np.asarray(velocity, float)
    gap = position[2] - radius - height
    if velocity[2] >= 0 or gap < 0:
        raise ValueError("the sphere must start above the plane and descend")
    time = gap / -velocity[2]
    centre = position + velocity * time
    up = np.array([0.0, 0.0, 1.0])
    return SurfaceTouch(float(time), centre, centre - radius * up, up, "plane")


def meet_heightfield(
    z: ArrayLike, spacing: float, position: ArrayLike, velocity: ArrayLike, radius: float
) -> SurfaceTouch:
    """First touch of a sphere in straight descending flight with a periodic triangulated heightfield.

    Parameters: z (nx, ny), m, node heights, z[i, j] at (i spacing, j spacing), each square cut along the
    diagonal from (i, j) to (i+1, j+1); position (3,), m; velocity (3,), m/s, pointing down; radius, m.
    Raises ValueError when the sphere does not descend or overlaps the surface at the start.

    >>> touch = meet_heightfield(np.zeros((4, 4)), 1.0, [0.3, 0.2, 5.0], [0.0, 0.0, -1.0], 2.0)
    >>> float(touch.centre[2]), float(touch.point[2])
    (2.0, 0.0)
    """
    z = np.asarray(z, float)
    position, velocity = np.asarray(position, float), np.asarray(velocity, float)
    if velocity[2] >= 0:
        raise ValueError("the sphere must descend")
    # The touch lies between the times at which the lowest point passes the highest and the lowest node.
    nodes = np.array([z.max(), z.min()])
    entry, exit_ = np.maximum((position[2] - radius - nodes) / -velocity[2], 0.0)
    path = position[:2] + np.outer([entry, exit_], velocity[:2])
    low = np.floor((path.min(axis=0) - radius) / spacing).astype(int)
    high = np.ceil((path.max(axis=0) + radius) / spacing).astype(int)
    i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="ij")
    node = np.stack([i * spacing, j * spacing, z[i % z.shape[0], j % z.shape[1]]], axis=-1)

    candidates = [
        _meet_vertices(node.reshape(-1, 3), position, velocity, radius),
        _meet_edges(node[:-1], node[1:], position, velocity, radius),
        _meet_edges(node[:, :-1], node[:, 1:], position, velocity, radius),
        _meet_edges(node[:-1, :-1], node[1:, 1:], position, velocity, radius),
        _meet_faces(node[:-1, :-1], node[1:, :-1], node[1:, 1:], position, velocity, radius),
        _meet_faces(node[:-1, :-1], node[1:, 1:], node[:-1, 1:], position, velocity, radius),
    ]
    time, point, feature = min(candidates, key=lambda candidate: candidate[0])
    centre = position + velocity * time
    return SurfaceTouch(time, centre, point, (centre - point) / radius, feature)


def drop_onto_heightfield(z: ArrayLike, spacing: float, x: float, y: float, radius: float) -> SurfaceTouch:
    """First touch of a sphere let down vertically above (x, y): `centre[2]` is the height of its centre.

    `time` is the path in metres from the height at which the surface cannot yet be reached.

    >>> peak = np.zeros((4, 4)); peak[1, 1] = 1.0
    >>> float(drop_onto_heightfield(peak, 1.0, 1.0, 1.0, 0.5).centre[2])
    1.5
    """
    start = [x, y, float(np.max(z)) + 2.0 * radius]
    return meet_heightfield(z, spacing, start, [0.0, 0.0, -1.0], radius)


def _first(time: np.ndarray, point: np.ndarray, feature: str) -> Candidate:
    k = int(np.argmin(time))
    return float(time.flat[k]), point.reshape(-1, 3)[k], feature


def _meet_vertices(
    vertex: np.ndarray, position: np.ndarray, velocity: np.ndarray, radius: float
) -> Candidate:
    return _first(quadratic_touch(position - vertex, velocity, radius), vertex, "vertex")


def _meet_edges(
    a: np.ndarray, b: np.ndarray, position: np.ndarray, velocity: np.ndarray, radius: float
) -> Candidate:
    length = np.linalg.norm(b - a, axis=-1, keepdims=True)
    along = (b - a) / length

    def across(vector: np.ndarray) -> np.ndarray:
        return vector - np.sum(vector * along, axis=-1, keepdims=True) * along

    separation = across(position - a)
    approach = across(np.broadcast_to(velocity, a.shape))
    clear = np.sum(separation**2, axis=-1) >= radius**2  # else inside the line's tube: its end is met first
    separation = np.where(clear[..., None], separation, [radius, 0.0, 0.0])
    time = np.where(clear, quadratic_touch(separation, approach, radius), np.inf)
    finite = np.where(np.isfinite(time), time, 0.0)[..., None]
    foot = np.sum((position + velocity * finite - a) * along, axis=-1, keepdims=True)
    on_edge = ((foot >= 0) & (foot <= length))[..., 0]
    return _first(np.where(on_edge, time, np.inf), a + foot * along, "edge")


def _meet_faces(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, position: np.ndarray, velocity: np.ndarray, radius: float
) -> Candidate:
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    gap = np.sum((position - a) * normal, axis=-1) - radius
    closing = -np.sum(velocity * normal, axis=-1)
    meets = (closing > 0) & (gap >= 0)
    time = np.where(meets, gap / np.where(meets, closing, 1.0), np.inf)
    finite = np.where(meets, time, 0.0)[..., None]
    point = position + velocity * finite - radius * normal
    corners = (a, b, c)
    inside = np.ones(time.shape, bool)
    for k in range(3):
        start, end = corners[k], corners[(k + 1) % 3]
        inside &= np.sum(np.cross(end - start, point - start) * normal, axis=-1) >= 0
    return _first(np.where(inside, time, np.inf), point, "face")
