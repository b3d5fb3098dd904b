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
from reference.fast.bins import bin_of
from reference.fast.groups import unite
from reference.fast.known import COLUMNS, K
from reference.neighbors import half_period, nearest_image

WIDTH = len(col.COLUMNS)  # of a ledger row
# Of its volume, or of a node spacing: a removal that differs by less is the same one.  Positions are
# rounded anew in each window, by 1e-16 of the period, which is 1e-11 of a volume; and 1e-9 of a depth (nm)
# is 1e-18 m, as much as positions are rounded by in any case.
SAME = 1e-9


class Harvest(NamedTuple):
    """Ledger rows of all runs of a block, for N particles; there may be room for more.

    Pieces are numbered on from run to run.
    """

    rows: np.ndarray  # (rows, WIDTH)
    found_by: np.ndarray  # (rows,), by which piece
    removals: np.ndarray  # (rows,), numbers of those that remove something
    used: np.ndarray  # (2,), how many rows there are, and how many of them remove something
    piece: np.ndarray  # (N,), in which a particle was last


@inner
def harvest_of(n):
    """Nothing yet, of n particles."""
    return Harvest(
        np.empty((n, WIDTH)), np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(2, np.int64),
        np.empty(n, np.int64),
    )  # fmt: skip


@inner
def copy_rows(source, target, begin, at, count):
    """Copy rows begin ... begin + count - 1 of `source` (..., columns) to `target`, from `at` on.

    Assigned to each other, Numba would compile for seconds what it says where shapes differ.
    """
    for k in range(count):
        for column in range(source.shape[1]):
            target[at + k, column] = source[begin + k, column]


@inner
def bring_in(harvest, found, parts, pieces):
    """The harvest with the rows of all chunks of a run, whose first piece is number `pieces`."""
    for piece in range(parts.cuts.size - 1):
        for k in range(parts.cuts[piece], parts.cuts[piece + 1]):
            harvest.piece[parts.member[k]] = pieces + piece
    used, removing = harvest.used
    total = used + found.used.sum()
    if total > harvest.found_by.size:
        room = 2 * total
        wider = Harvest(
            np.empty((room, WIDTH)), np.empty(room, np.int64), np.empty(room, np.int64), harvest.used,
            harvest.piece,
        )  # fmt: skip
        copy_rows(harvest.rows, wider.rows, 0, 0, used)
        for k in range(used):
            wider.found_by[k], wider.removals[k] = harvest.found_by[k], harvest.removals[k]
        harvest = wider
    for chunk in range(found.used.size):
        copy_rows(found.rows, harvest.rows, found.begins[chunk], used, found.used[chunk])
        for _ in range(found.used[chunk]):
            harvest.found_by[used] = harvest.piece[int(harvest.rows[used, col.I])]
            harvest.removals[removing] = used
            removing += 1 if harvest.rows[used, col.REMOVED_VOLUME] > 0.0 else 0
            used += 1
    harvest.used[0], harvest.used[1] = used, removing
    return harvest


@part
def counts(harvest, k):
    """Whether row k is of the last run of its particle."""
    return harvest.found_by[k] == harvest.piece[int(harvest.rows[k, col.I])]


@part
def step_of(out, t_start, dt):
    """The step of a ledger row."""
    return int((out[col.TIME] - t_start) / dt + 0.5)


@part
def place_of(out, t_start, dt, first):
    """Where a ledger row belongs: 3 times its step in the block; of a step surface, pairs, pad."""
    kind = int(out[col.KIND])
    at = 0 if kind == col.KIND_SURFACE else (1 if kind == col.KIND_PAIR else 2)
    return 3 * (step_of(out, t_start, dt) - first) + at


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
def steps_until_lowered(harvest, i_node, j_node, shape, spacing, t_start, dt, first, steps):
    """After how many of a block's steps someone first takes something off next to a node; or `steps`."""
    for k in harvest.removals[: harvest.used[1]]:
        out = harvest.rows[k]
        if counts(harvest, k):
            i, j = math.floor(out[col.X] / spacing), math.floor(out[col.Y] / spacing)
            if (i_node - i) % shape[0] <= 1 and (j_node - j) % shape[1] <= 1:
                steps = min(steps, step_of(out, t_start, dt) - first + 1)
    return steps


@inner
def removes(harvest):
    """Whether anybody takes something off the surface."""
    some = False
    for k in harvest.removals[: harvest.used[1]]:
        some |= counts(harvest, k)
    return some


class Chains(NamedTuple):
    """Some rows of N particles that remove something: one linked list each."""

    first: np.ndarray  # (N,), row, or -1
    after: np.ndarray  # (rows,)


@inner
def chains_of(harvest, n, since):
    """The rows that count of those of n particles whose piece is number `since` or a later one."""
    chains = Chains(np.full(n, -1, np.int32), np.empty(harvest.used[0], np.int32))
    for k in harvest.removals[: harvest.used[1] if n > 0 else 0]:
        i = int(harvest.rows[k, col.I])
        if harvest.piece[i] >= since and counts(harvest, k):
            chains.after[k], chains.first[i] = chains.first[i], k
    return chains


@inner
def is_repeated(harvest, chains, k, spacing):
    """Whether the particle of row k, which counts no longer, has removed the same again, to round-off."""
    old = harvest.rows[k]
    m = np.int64(chains.first[int(old[col.I])])
    while m >= 0:
        out = harvest.rows[m]
        if out[col.TIME] == old[col.TIME]:
            apart = max(abs(out[col.X] - old[col.X]), abs(out[col.Y] - old[col.Y]))
            change = abs(out[col.REMOVED_VOLUME] - old[col.REMOVED_VOLUME])
            return apart <= SAME * spacing and change <= SAME * old[col.REMOVED_VOLUME]
        m = np.int64(chains.after[m])
    return False


@inner
def spread_removals(harvest, bins, world, met_surface, close, within, parent, again, run, since):
    """Have those around removals know of them, if one or the other is of this `run` and it may matter.

    Who is in another piece, `close` (m) to a removal, and has touched the surface since, becomes one group
    with the particle that removes, which is marked in `again`; and so does who has looked, `within` (m, more)
    of it, at a removal of the same piece that is no longer as it was then.  From others the surface can only
    be farther away than it was, but another triangle may be the closest: they forget which are close, if they
    have not looked since.  The pieces of the run are numbered from `since` on.
    """
    s, known = world.s, world.w.known
    across, along = bins.first.shape
    length_x, length_y, spacing = world.model.length_x, world.model.length_y, world.model.spacing
    half_x, half_y = half_period(length_x), half_period(length_y)
    chains = chains_of(harvest, parent.size if run > 0 else 0, since)
    for k in harvest.removals[: harvest.used[1]]:
        out = harvest.rows[k]
        x, y, mover = out[col.X], out[col.Y], int(out[col.I])
        a, b = bin_of(x, length_x, across), bin_of(y, length_y, along)
        holds, moved = counts(harvest, k), harvest.piece[mover] >= since
        if not holds and (not moved or is_repeated(harvest, chains, k, spacing)):
            continue
        if not moved and bins.run[a, b] < run:
            continue
        step = step_of(out, world.t_start, world.fixed.dt)
        for da in range(-1, 2):
            for db in range(-1, 2):
                i = np.int64(bins.first[(a + da) % across, (b + db) % along])
                while i >= 0:
                    dx = nearest_image(s.x[i] - x, length_x, half_x)
                    dy = nearest_image(s.y[i] - y, length_y, half_y)
                    square, told = dx * dx + dy * dy, moved or harvest.piece[i] >= since
                    if told and square <= within * within:
                        others = harvest.piece[i] != harvest.found_by[k]
                        has_looked = known[COLUMNS * i + K.looked] > step
                        if not holds:
                            joins = not others and has_looked
                        else:
                            joins = others and met_surface[i] > step and square <= close * close
                        if joins:
                            again[mover] |= unite(parent, mover, i)
                        elif holds and (others or not has_looked):
                            known[COLUMNS * i + K.until] = -1.0
                    i = np.int64(bins.after[i])
