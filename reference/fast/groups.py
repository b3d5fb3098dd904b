"""Groups of particles that have nothing to do with each other for some steps, and pieces of whole groups.

What a piece does by itself is `pieces.py`, when which groups become one is decided in `many.py`.  No physics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.fast.swarm import MANY
from reference.timestep import wrap

PIECE = 256  # particles, from which on a piece is large enough: what is known of them fits a core's own cache
GROUP = MANY - PIECE  # particles of a group, at most: a piece to which it is added has room for them


class Parts(NamedTuple):
    """F pieces of D particles and B pairs; no pair is between two of them."""

    member: np.ndarray  # (D,), particles, piece by piece
    cuts: np.ndarray  # (F + 1,), where in `member` the pieces begin
    pair: np.ndarray  # (B, 2), pairs, piece by piece: numbers of particles within their piece
    pair_cuts: np.ndarray  # (F + 1,)


class Bins(NamedTuple):
    """Which of N particles are in which bin of the plane: one linked list each."""

    first: np.ndarray  # (bins along x, bins along y), the first particle, or -1
    after: np.ndarray  # (N,), the next one in the same bin, or -1


@part
def root_of(parent, i):
    """The first particle of the group of particle i."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@part
def unite(parent, i, j):
    """Make one group of those of particles i and j; return whether they were two."""
    a, b = root_of(parent, i), root_of(parent, j)
    parent[max(a, b)] = min(a, b)
    return a != b


@inner
def group_pairs(parent, narrow, near):
    """Groups of the particles that `near` pairs connect, into `parent`; return how many the largest has."""
    for i in range(parent.size):
        parent[i] = i
    for k in range(near):
        unite(parent, np.int64(narrow[2 * k]), np.int64(narrow[2 * k + 1]))
    return largest_group(parent)


@inner
def largest_group(parent):
    """Have each particle point at the first one of its group; return how many the largest group has."""
    size = np.zeros(parent.size, np.int32)
    largest = 0
    for i in range(parent.size):
        parent[i] = parent[parent[i]]  # it pointed at a lower one, which points at its first one already
        size[parent[i]] += 1
        largest = max(largest, size[parent[i]])
    return largest


@inner
def part_out(parent, wanted, order, narrow, near):
    """Pieces of the groups that are `wanted` (N,), by their first particles, at which `parent` points.

    `narrow` has `near` pairs; of the two the one that comes first in `order` is the first one in its piece.
    """
    n = parent.size
    size, start, piece_of = np.zeros(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    for i in range(n):
        size[parent[i]] += 1
    cuts, pieces, placed = np.zeros(n // PIECE + 2, np.int64), 0, 0
    for i in range(n):
        if parent[i] == i and wanted[i]:
            if placed - cuts[pieces] >= PIECE:
                pieces += 1
                cuts[pieces] = placed
            start[i], piece_of[i] = placed, pieces
            placed += size[i]
    if placed > cuts[pieces]:
        pieces += 1
        cuts[pieces] = placed
    member, place = np.empty(placed, np.uint32), np.empty(n, np.uint32)
    for i in range(n):
        first = parent[i]
        if wanted[first]:
            member[start[first]], place[i] = i, start[first] - cuts[piece_of[first]]
            start[first] += 1
    pair, pair_cuts = pairs_of(parent, wanted, order, narrow, near, piece_of, place, pieces)
    return Parts(member, cuts[: pieces + 1], pair, pair_cuts)


@inner
def pairs_of(parent, wanted, order, narrow, near, piece_of, place, pieces):
    """The pairs of each piece, and where they begin: see `part_out`."""
    cuts = np.zeros(pieces + 1, np.int64)
    for k in range(near):
        first = parent[narrow[2 * k]]
        if wanted[first]:
            cuts[piece_of[first] + 1] += 1
    for piece in range(pieces):
        cuts[piece + 1] += cuts[piece]
    pair, at = np.empty((cuts[pieces], 2), np.uint32), cuts.copy()
    for k in range(near):
        i, j = narrow[2 * k], narrow[2 * k + 1]
        if wanted[parent[i]]:
            if order[i] > order[j]:
                i, j = j, i
            piece = piece_of[parent[i]]
            pair[at[piece], 0], pair[at[piece], 1] = place[i], place[j]
            at[piece] += 1
    return pair, cuts


@part
def bin_of(x, length, bins):
    """Number of the bin, along one axis, of a position; `length` is the period."""
    return min(int(wrap(x, length) / length * bins), bins - 1)


@inner
def bins_of(s, n, width, length_x, length_y):
    """Bins, at least `width` (m) wide, of the first n particles."""
    across, along = max(1, int(length_x / width)), max(1, int(length_y / width))
    bins = Bins(np.full((across, along), -1, np.int32), np.empty(n, np.int32))
    for i in range(n):
        a, b = bin_of(s.x[i], length_x, across), bin_of(s.y[i], length_y, along)
        bins.after[i], bins.first[a, b] = bins.first[a, b], i
    return bins
