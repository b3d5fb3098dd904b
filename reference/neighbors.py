"""Who may touch whom: a periodic cell list, and pairs within a cutoff at a cost linear in N.

Knows positions and periods only; which pairs overlap and approach is decided in `collisions.py`.
"""

from __future__ import annotations

import math

import numpy as np

from reference.compiled import formula, kernel, part


@formula
def minimum_image(distance, period):
    """Component of a distance to the nearest periodic image; a period of 0 means not periodic."""
    if period > 0.0:
        return distance - period * math.floor(distance / period + 0.5)
    return distance


@formula
def half_period(length):
    """Half of a period, m; infinite where there is none."""
    return 0.5 * length if length > 0.0 else math.inf


@part
def shift_to_image(distance, period, half):
    """What a difference of two wrapped positions lacks of that to the nearest image, m.

    `half` is half of the period, or infinite.
    """
    if distance > half:
        return -period
    if distance < -half:
        return period
    return 0.0


@part
def nearest_image(distance, period, half):
    """`minimum_image` of a difference of two wrapped positions; `half` is half of the period, or infinite."""
    return distance + shift_to_image(distance, period, half)


@part
def _neighboring(index, count):
    """Number of a cell of `count`, of an index that is outside of them by one at most."""
    if index < 0:
        return index + count
    return index - count if index >= count else index


@kernel
def _cell_index(position, low, cell, counts, out):
    """Cell of a position along each axis, into out (3,)."""
    for axis in range(3):
        index = math.floor((position[axis] - low[axis]) / cell[axis])
        out[axis] = min(max(index, 0), counts[axis] - 1)


@kernel
def _bin_particles(position, low, cell, counts):
    """Counting sort into cells: (first (cells + 1,), order (N,)); cell c holds order[first[c]:first[c+1]]."""
    n = position.shape[0]
    home = np.empty(n, np.int64)
    first = np.zeros(counts[0] * counts[1] * counts[2] + 1, np.int64)
    index = np.empty(3, np.int64)
    for i in range(n):
        _cell_index(position[i], low, cell, counts, index)
        home[i] = (index[0] * counts[1] + index[1]) * counts[2] + index[2]
        first[home[i] + 1] += 1
    for c in range(first.size - 1):
        first[c + 1] += first[c]
    order = np.empty(n, np.int64)
    filled = first[:-1].copy()
    for i in range(n):
        order[filled[home[i]]] = i
        filled[home[i]] += 1
    return first, order


@part
def _runs_of_cells(index, reach, count, periodic):
    """Cells index - reach ... index + reach of an axis, in order, as two runs: (begin, end, begin, end)."""
    low, high = index - reach, index + reach + 1
    if not periodic:
        return max(low, 0), min(high, count), 0, 0
    if low < 0:
        return low + count, count, 0, high
    if high > count:
        return low, count, 0, high - count
    return low, high, 0, 0


@kernel
def _scan_cells(position, cutoff, periods, low, cell, counts, first, order, pairs):
    """Write each pair i < j within the cutoff to `pairs` while there is room; return how many there are.

    Cells along the last axis that has several stand one behind the other, and so do their particles.
    """
    found = 0
    index, reach = np.empty(3, np.int64), np.empty(3, np.int64)
    half_x, half_y, half_z = half_period(periods[0]), half_period(periods[1]), half_period(periods[2])
    for axis in range(3):
        reach[axis] = 0 if counts[axis] == 1 else 1
    last, middle, stride = (2, 1, counts[2]) if counts[2] > 1 else (1, 2, 1)
    for i in range(position.shape[0]):
        _cell_index(position[i], low, cell, counts, index)
        begin, end, begin_again, end_again = _runs_of_cells(
            index[last], reach[last], counts[last], periods[last] > 0.0
        )
        for a in range(index[0] - reach[0], index[0] + reach[0] + 1):
            if periods[0] == 0.0 and (a < 0 or a >= counts[0]):
                continue
            for b in range(index[middle] - reach[middle], index[middle] + reach[middle] + 1):
                if periods[middle] == 0.0 and (b < 0 or b >= counts[middle]):
                    continue
                row = _neighboring(a, counts[0]) * counts[1] * counts[2]
                row += _neighboring(b, counts[middle]) * stride
                for run in range(2 if end_again > begin_again else 1):
                    head, tail = (begin, end) if run == 0 else (begin_again, end_again)
                    for slot in range(first[row + head], first[row + tail]):
                        j = order[slot]
                        if j <= i:
                            continue
                        dx = nearest_image(position[j, 0] - position[i, 0], periods[0], half_x)
                        dy = nearest_image(position[j, 1] - position[i, 1], periods[1], half_y)
                        dz = nearest_image(position[j, 2] - position[i, 2], periods[2], half_z)
                        square = dx * dx + dy * dy + dz * dz
                        if square < cutoff * cutoff:
                            if found < pairs.shape[0]:
                                pairs[found, 0] = i
                                pairs[found, 1] = j
                            found += 1
    return found


@kernel
def _cells(position, width, periods):
    """Cells at least `width` wide: (lowest corner (3,), size (3,), number along each axis (3,))."""
    n = position.shape[0]
    low, extent, cell, counts = np.zeros(3), periods.copy(), np.ones(3), np.ones(3, np.int64)
    for axis in range(3):
        if periods[axis] == 0.0 and n > 0:
            lowest = highest = position[0, axis]
            for i in range(1, n):
                lowest, highest = min(lowest, position[i, axis]), max(highest, position[i, axis])
            low[axis], extent[axis] = lowest, highest - lowest
        if width > 0.0:
            counts[axis] = max(1, math.floor(min(extent[axis] / width, 1e6)))
    while counts[0] * counts[1] * counts[2] > 8 * n + 27:  # bounded memory for sparse systems
        counts[counts.argmax()] //= 2
    for axis in range(3):
        if counts[axis] < 3:
            counts[axis] = 1
        if extent[axis] > 0.0:
            cell[axis] = extent[axis] / counts[axis]
    return low, cell, counts


@kernel
def by_cells(position, width, periods):
    """Numbers of the particles cell by cell of a `width` (m) or more, and where the cells begin.

    Two arrays, (N,) and (cells + 1,); the rest as `neighbor_pairs`.
    """
    low, cell, counts = _cells(position, width, periods)
    first, order = _bin_particles(position, low, cell, counts)
    return order, first


@kernel
def neighbor_pairs(position, cutoff, periods):
    """All pairs i < j closer than `cutoff`, by minimum image, as an array (P, 2) of int64.

    Parameters: position (N, 3) in m, wrapped where periodic; cutoff in m; periods (3,) in m, 0 where not
    periodic.  An axis with fewer than three cells is searched whole.  The order depends on positions only.
    """
    n = position.shape[0]
    low, cell, counts = _cells(position, cutoff, periods)
    first, order = _bin_particles(position, low, cell, counts)
    pairs = np.empty((8 * n + 16, 2), np.int64)
    found = _scan_cells(position, cutoff, periods, low, cell, counts, first, order, pairs)
    if found > pairs.shape[0]:
        pairs = np.empty((found, 2), np.int64)
        _scan_cells(position, cutoff, periods, low, cell, counts, first, order, pairs)
    return pairs[:found]


@kernel
def has_moved(position, listed_position, limit, periods):
    """Whether any particle is further than `limit` from where it was when the pairs were listed."""
    for i in range(position.shape[0]):
        square = 0.0
        for axis in range(3):
            d = minimum_image(position[i, axis] - listed_position[i, axis], periods[axis])
            square += d * d
        if square > limit * limit:
            return True
    return False
