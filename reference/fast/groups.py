"""Groups of particles that have nothing to do with each other for some steps, and pieces of whole groups.

What a piece does by itself is `pieces.py`, when which groups become one is decided in `many.py`.  No physics.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.fast.swarm import MANY

PIECE = 256  # particles of a tile, about, and of a piece: what is known of them fits a core's own cache
FULL = 2 * PIECE  # particles from which on a piece is full
GROUP = MANY - FULL  # particles of a group, at most: a piece to which it is added has room for them


class Parts(NamedTuple):
    """F pieces of D particles and B pairs; no pair is between two of them."""

    member: np.ndarray  # (D,), particles, piece by piece
    cuts: np.ndarray  # (F + 1,), where in `member` the pieces begin
    pair: np.ndarray  # (B, 2), pairs, piece by piece: numbers of particles within their piece
    pair_cuts: np.ndarray  # (F + 1,)


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
def part_out(parent, wanted, order, tiles, narrow, near):
    """Pieces of the groups that are `wanted` (N,), by their first particles, at which `parent` points.

    A piece is of one tile: these begin at the particles `tiles`.  `narrow` has `near` pairs; of the two the
    one that comes first in `order` is the first one in its piece.
    """
    n = parent.size
    size, start, piece_of = np.zeros(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    chosen, count = np.empty(n, np.uint32), 0
    for i in range(n):
        if wanted[parent[i]]:
            size[parent[i]] += 1
            chosen[count] = i
            count += 1
    cuts, pieces, placed, tile = np.zeros(n // FULL + tiles.size + 1, np.int64), 0, 0, 0
    for i in chosen[:count]:
        if parent[i] == i:
            begun = tiles[tile]
            while tiles[tile + 1] <= i:
                tile += 1
            ends = tiles[tile] > begun or placed - cuts[pieces] >= FULL
            if ends and placed > cuts[pieces]:
                pieces += 1
                cuts[pieces] = placed
            start[i], piece_of[i] = placed, pieces
            placed += size[i]
    if placed > cuts[pieces]:
        pieces += 1
        cuts[pieces] = placed
    member, place = np.empty(placed, np.uint32), np.empty(n, np.uint32)
    for i in chosen[:count]:
        first = parent[i]
        member[start[first]], place[i] = i, start[first] - cuts[piece_of[first]]
        start[first] += 1
    pair, pair_cuts = pairs_of(parent, wanted, order, narrow, near, piece_of, place, pieces)
    return Parts(member, cuts[: pieces + 1], pair, pair_cuts)


@inner
def pairs_of(parent, wanted, order, narrow, near, piece_of, place, pieces):
    """The pairs of each piece, and where they begin: see `part_out`."""
    cuts, chosen, count = np.zeros(pieces + 1, np.int64), np.empty(near, np.uint32), 0
    for k in range(near):
        first = parent[narrow[2 * k]]
        if wanted[first]:
            cuts[piece_of[first] + 1] += 1
            chosen[count] = k
            count += 1
    for piece in range(pieces):
        cuts[piece + 1] += cuts[piece]
    pair, at = np.empty((cuts[pieces], 2), np.uint32), cuts.copy()
    for k in chosen[:count]:
        i, j = narrow[2 * k], narrow[2 * k + 1]
        if order[i] > order[j]:
            i, j = j, i
        piece = piece_of[parent[i]]
        pair[at[piece], 0], pair[at[piece], 1] = place[i], place[j]
        at[piece] += 1
    return pair, cuts
