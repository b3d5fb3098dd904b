"""What the pieces of a block have found, in one place: ledger rows in the order of steps, and removals.

A group may be moved more than once in a block: what its last run has found is what counts.  How pieces move
is `pieces.py`, which groups are moved again is decided in `many.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference import ledger as col
from reference.compiled import inner, part
from reference.fast.groups import bin_of, unite
from reference.fast.known import COLUMNS, K
from reference.neighbors import minimum_image

WIDTH = len(col.COLUMNS)  # of a ledger row


class Harvest(NamedTuple):
    """Ledger rows of all runs of a block, for N particles; there may be room for more."""

    rows: np.ndarray  # (rows, WIDTH)
    run: np.ndarray  # (rows,), of which run
    used: np.ndarray  # (1,), how many rows there are
    latest: np.ndarray  # (N,), the last run of a particle: 0 is that with the surface left as it is


@inner
def harvest_of(n):
    """Nothing yet, of n particles."""
    return Harvest(np.empty((n, WIDTH)), np.empty(n, np.int64), np.zeros(1, np.int64), np.zeros(n, np.int64))


@inner
def copy_rows(source, target, begin, at, count):
    """Copy rows begin ... begin + count - 1 of `source` (..., columns) to `target`, from `at` on.

    Assigned to each other, Numba would compile for seconds what it says where shapes differ.
    """
    for k in range(count):
        for column in range(source.shape[1]):
            target[at + k, column] = source[begin + k, column]


@inner
def bring_in(harvest, found, run):
    """The harvest with the rows of all chunks of a run."""
    used = harvest.used[0]
    total = used + found.used.sum()
    if total > harvest.run.size:
        room = 2 * total
        wider = Harvest(np.empty((room, WIDTH)), np.empty(room, np.int64), harvest.used, harvest.latest)
        copy_rows(harvest.rows, wider.rows, 0, 0, used)
        for k in range(used):
            wider.run[k] = harvest.run[k]
        harvest = wider
    for chunk in range(found.used.size):
        copy_rows(found.rows[chunk], harvest.rows, 0, used, found.used[chunk])
        for _ in range(found.used[chunk]):
            harvest.run[used] = run
            used += 1
    harvest.used[0] = used
    return harvest


@part
def counts(harvest, k):
    """Whether row k is of the last run of its particle."""
    return harvest.run[k] == harvest.latest[int(harvest.rows[k, col.I])]


@part
def place_of(out, t_start, dt, first):
    """Where a ledger row belongs: 3 times its step in the block; of a step surface, pairs, pad."""
    kind = int(out[col.KIND])
    at = 0 if kind == col.KIND_SURFACE else (1 if kind == col.KIND_PAIR else 2)
    return 3 * (int((out[col.TIME] - t_start) / dt + 0.5) - first) + at


@inner
def row_begins(harvest, t_start, dt, first, steps):
    """How many rows come before those of each step and kind, (3 steps + 1,)."""
    begins = np.zeros(3 * steps + 1, np.int64)
    for k in range(harvest.used[0]):
        if counts(harvest, k):
            begins[place_of(harvest.rows[k], t_start, dt, first) + 1] += 1
    for at in range(3 * steps):
        begins[at + 1] += begins[at]
    return begins


@inner
def store(harvest, begins, t_start, dt, first, rows, row):
    """Copy the rows that count to the ledger, step by step, from `row` on."""
    at = begins.copy()
    for k in range(harvest.used[0]):
        if counts(harvest, k):
            place = place_of(harvest.rows[k], t_start, dt, first)
            copy_rows(harvest.rows, rows, k, row + at[place], 1)
            at[place] += 1


@inner
def copy_nodes(source, target, spacing, harvest, first_run, again):
    """Copy heights around the removals of runs from `first_run` on, of particles that are in `again` (N,)."""
    for k in range(harvest.used[0]):
        out = harvest.rows[k]
        if out[col.REMOVED_VOLUME] <= 0.0 or harvest.run[k] < first_run or not counts(harvest, k):
            continue
        if again[int(out[col.I])]:
            i, j = math.floor(out[col.X] / spacing), math.floor(out[col.Y] / spacing)
            for a in range(i, i + 2):
                for b in range(j, j + 2):
                    x, y = a % source.shape[0], b % source.shape[1]
                    target[x, y] = source[x, y]


@inner
def steps_until_lowered(harvest, i_node, j_node, shape, spacing, t_start, dt, first, steps):
    """After how many of a block's steps someone first takes something off next to a node; or `steps`."""
    for k in range(harvest.used[0]):
        out = harvest.rows[k]
        if out[col.REMOVED_VOLUME] > 0.0 and counts(harvest, k):
            i, j = math.floor(out[col.X] / spacing), math.floor(out[col.Y] / spacing)
            if (i_node - i) % shape[0] <= 1 and (j_node - j) % shape[1] <= 1:
                steps = min(steps, place_of(out, t_start, dt, first) // 3 + 1)
    return steps


@inner
def mark_removers(harvest, again):
    """Mark the particles that take something off the surface."""
    for k in range(harvest.used[0]):
        if harvest.rows[k, col.REMOVED_VOLUME] > 0.0:
            again[int(harvest.rows[k, col.I])] = True


@inner
def spread_removals(
    harvest, bins, s, met_surface, length_x, length_y, close, within, parent, known, again
):  # fmt: skip
    """Have those around the removals know of them, as far as these matter to them.

    Who is `close` (m) and has met the surface, or is `within` (m, more) and moved while it falls, becomes one
    group with the particle that removes, which is marked in `again`.  From others the surface can only be
    farther away than it was, but another triangle may be the closest: those `within` forget which are close.
    """
    across, along = bins.first.shape
    for k in range(harvest.used[0]):
        out = harvest.rows[k]
        if out[col.REMOVED_VOLUME] <= 0.0 or not counts(harvest, k):
            continue
        x, y, mover = out[col.X], out[col.Y], int(out[col.I])
        a, b = bin_of(x, length_x, across), bin_of(y, length_y, along)
        for da in range(-1, 2):
            for db in range(-1, 2):
                i = np.int64(bins.first[(a + da) % across, (b + db) % along])
                while i >= 0:
                    dx, dy = minimum_image(s.x[i] - x, length_x), minimum_image(s.y[i] - y, length_y)
                    square = dx * dx + dy * dy
                    if square <= within * within:
                        if harvest.latest[i] > 0 or (met_surface[i] and square <= close * close):
                            again[mover] |= unite(parent, mover, i)
                        else:
                            known[COLUMNS * i + K.until] = -1.0
                    i = np.int64(bins.after[i])
