"""Bins of the plane: who is around a place on the surface, among particles that it may matter to."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part

UNLISTED = -2


class Bins(NamedTuple):
    """Which of N particles, not all, are in which bin: one linked list each."""

    first: np.ndarray  # (bins along x, bins along y), the first particle, or -1
    after: np.ndarray  # (N,), the next one in the same bin, or -1; `UNLISTED` of a particle that is in none
    run: np.ndarray  # (bins along x, bins along y), the last run of somebody who is in this bin or next to it


@part
def bin_of(x, length, bins):
    """Number of the bin, along one axis, of a wrapped position; `length` is the period."""
    return min(int(x / length * bins), bins - 1)


@inner
def empty_bins(n, width, length_x, length_y):
    """Bins, at least `width` (m) wide, in which none of n particles is yet."""
    shape = max(1, int(length_x / width)), max(1, int(length_y / width))
    return Bins(np.full(shape, -1, np.int32), np.full(n, UNLISTED, np.int32), np.zeros(shape, np.int32))


@inner
def enlist(bins, s, member, wanted, length_x, length_y, run):
    """List those of the particles `member` that are `wanted` (N,); in a later `run`, note where all are."""
    across, along = bins.first.shape
    for k in range(member.size):
        i = member[k]
        lists = wanted[i] and bins.after[i] == UNLISTED
        if not lists and run == 0:
            continue
        a, b = bin_of(s.x[i], length_x, across), bin_of(s.y[i], length_y, along)
        if lists:
            bins.after[i], bins.first[a, b] = bins.first[a, b], i
        if run > 0:
            for da in range(-1, 2):
                for db in range(-1, 2):
                    bins.run[(a + da) % across, (b + db) % along] = run
