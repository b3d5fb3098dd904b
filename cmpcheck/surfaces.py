"""The surface of a run as triangles, and as it was at every output time.

A run folder holds the first and the last surface; those between follow from the contact ledger.  File formats
are `export.py`, pictures `figures/`.
"""

from __future__ import annotations

import numpy as np

from reference.heightfield import Heightfield
from reference.recording import Run

EPS = np.finfo(float).eps


def surface_mesh(surface: Heightfield) -> tuple[np.ndarray, np.ndarray]:
    """One period of the surface as an open patch: points (M, 3) in m, and triangles (K, 3) of point indices.

    The triangles have the diagonal, the order and the numbers of `reference/heightfield.py` and point up; the
    nodes of the first row and column appear again at the far edges.

    >>> points, triangles = surface_mesh(Heightfield([[0.0, 1.0]], 1.0))
    >>> points.shape, triangles.tolist()
    ((6, 3), [[0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2]])
    """
    z = np.pad(surface.z, ((0, 1), (0, 1)), mode="wrap")
    i, j = np.indices(z.shape)
    points = np.stack([i * surface.spacing, j * surface.spacing, z], axis=-1).reshape(-1, 3)
    node = np.arange(z.size).reshape(z.shape)
    here, right, above, beyond = node[:-1, :-1], node[1:, :-1], node[:-1, 1:], node[1:, 1:]
    triangles = np.stack([here, right, beyond, here, beyond, above], axis=-1).reshape(-1, 3)
    return points, triangles


def surfaces_over_time(run: Run) -> list[Heightfield] | None:
    """The surface at each of the run's times, by repeating the removals of its contact ledger.

    None when there is no surface, or when the removals do not lead from the first surface to the last, as in
    a run whose ledger is not whole.  Removals are taken to act at the time of their ledger row.
    """
    if run.surface_initial is None or run.surface is None:
        return None
    removal, now = run.case.removal, Heightfield(run.surface_initial.z, run.surface_initial.spacing)
    hits = run.contacts[run.contacts["removed_volume"] > 0.0].sort_values("time", kind="stable")
    # a hit that begins at an output time acts in the step after it
    done_by = np.searchsorted(hits["time"].to_numpy(), run.times)
    done_by[-1] = len(hits)
    columns = [hits[name].to_numpy() for name in ("x", "y", "depth", "removed_volume")]
    surfaces, done = [], 0
    for upto in done_by:
        for x, y, depth, volume in zip(*(column[done:upto] for column in columns), strict=True):
            assert removal is not None
            if removal.deposit == "node_depth":
                now.lower_node(x, y, removal.acceleration * depth)
            else:
                now.remove_volume(x, y, removal.acceleration * volume)
        done = upto
        surfaces.append(Heightfield(now.z, now.spacing))
    # The same falls in another order, as in an engine that ends its contacts later: one rounding for each
    rounding = (1 + len(hits)) * EPS * max(np.abs(run.surface_initial.z).max(), np.abs(run.surface.z).max())
    return surfaces if np.allclose(now.z, run.surface.z, rtol=0.0, atol=rounding) else None
