"""The part of the surface around a piece of many particles, copied to memory of its own.

There the piece lowers it by what its particles remove, and no other piece sees that.  Within it, positions
count from its first node, so that the loop for few takes it for a whole surface; who is in it never comes
near its rim.  Where it would be as wide as the surface it is all of it, and periodic like it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.fast.events import told_of
from reference.neighbors import half_period, nearest_image


class Window(NamedTuple):
    """Which nodes of the surface it has, by axis: the number of the first one, and how many."""

    first_x: int
    first_y: int
    count_x: int
    count_y: int


class Copies(NamedTuple):
    """The surface in a window, (nodes along x, along y) each."""

    heights: np.ndarray  # m
    above: np.ndarray  # the map of its maxima, m, see `Ceiling`
    changed: np.ndarray  # for the step of the last removal near a square, none yet, see `Watch`


@inner
def margin_of(model, fixed, largest, way):
    """How far around its particles a window must reach, m, when these move by `way` (m) at most."""
    look = (
        2.0 * fixed.room + 3.0 * model.spacing
    )  # found in one look, a triangle is asked again after another
    told = (told_of(model, largest) + 2) * model.spacing
    return way + 0.5 * largest + max(look, told)


@inner
def nodes_around(position, member, length, spacing, nodes, margin):
    """The first node and the number of nodes along an axis, within `margin` (m) of the particles `member`."""
    if nodes == 0:
        return 0, 0
    start, low, high, half = position[member[0]], 0.0, 0.0, half_period(length)
    for k in range(member.size):
        away = nearest_image(position[member[k]] - start, length, half)
        low, high = min(low, away), max(high, away)
    first, last = math.floor((start + low - margin) / spacing), math.ceil((start + high + margin) / spacing)
    if last - first + 1 >= nodes:
        return 0, nodes
    return first % nodes, last - first + 1


@inner
def window_of(model, s, member, shape, margin):
    """The window around the particles `member` of a surface of this `shape`."""
    first_x, count_x = nodes_around(s.x, member, model.length_x, model.spacing, shape[0], margin)
    first_y, count_y = nodes_around(s.y, member, model.length_y, model.spacing, shape[1], margin)
    return Window(first_x, first_y, count_x, count_y)


@inner
def cut_out(source, window, target):
    """Copy what is in the window of `source` (nx, ny) to `target` (nodes in it,), row by row."""
    n_x, n_y = source.shape
    nodes, until_end = source.reshape(-1), min(window.count_y, n_y - window.first_y)
    for a in range(window.count_x):
        row = window.first_x + a if window.first_x + a < n_x else window.first_x + a - n_x
        begin = a * window.count_y
        copy_nodes(nodes, row * n_y + window.first_y, target, begin, until_end)
        copy_nodes(nodes, row * n_y, target, begin + until_end, window.count_y - until_end)


@part
def copy_nodes(source, begin, target, at, count):
    """Copy numbers begin ... begin + count - 1 of `source` (n,) to `target`, from `at` on."""
    for k in range(np.uint64(count)):
        target[np.uint64(at) + k] = source[np.uint64(begin) + k]


@inner
def copies_of(heights, above, window, flat, flat_steps):
    """Copies of what is in a window, in the memory `flat` (2 nodes of it or more) and `flat_steps`."""
    nodes, shape = window.count_x * window.count_y, (window.count_x, window.count_y)
    copies = Copies(
        flat[:nodes].reshape(shape), flat[nodes : 2 * nodes].reshape(shape), flat_steps[:nodes].reshape(shape)
    )
    cut_out(heights, window, flat[:nodes])
    cut_out(above, window, flat[nodes : 2 * nodes])
    copies.changed[:] = -1
    return copies


@inner
def nodes_to(position, first, nodes, spacing):
    """How many nodes to add to a position (m, wrapped) so that it counts from node `first` of the surface."""
    return nodes - first if position < first * spacing else -first
