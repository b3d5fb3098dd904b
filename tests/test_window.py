"""Windows on the surface (window.py): around its particles a window has the heights of the surface."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference.fast.window import copies_of, nodes_to, window_of

SPACING = 0.5
NODES = st.integers(3, 20)
FRACTIONS = st.lists(st.tuples(*2 * [st.floats(0.0, 1.0, exclude_max=True)]), min_size=1, max_size=5)


@pytest.mark.nojit
@given(n_x=NODES, n_y=NODES, fractions=FRACTIONS, margin=st.floats(0.0, 3.0))
def test_around_its_particles_a_window_has_the_heights_of_the_surface(n_x, n_y, fractions, margin):
    """Also across the periods, and where it is the whole surface; positions in it are not negative."""
    shape = n_x, n_y
    heights = np.arange(float(n_x * n_y)).reshape(shape)
    model = SimpleNamespace(length_x=n_x * SPACING, length_y=n_y * SPACING, spacing=SPACING)
    x, y = (np.array(fractions) * (model.length_x, model.length_y)).T
    window = window_of(model, SimpleNamespace(x=x, y=y), np.arange(len(x)), shape, margin)
    count = window.count_x, window.count_y
    nodes = math.prod(count)
    copies = copies_of(heights, -heights, window, np.empty(2 * nodes), np.empty(nodes, np.int64))
    assert copies.heights.shape == copies.above.shape == copies.changed.shape == count
    assert (copies.changed == -1).all()
    for position in zip(x, y, strict=True):
        shift_x = nodes_to(position[0], window.first_x, n_x, SPACING)
        shifts = shift_x, nodes_to(position[1], window.first_y, n_y, SPACING)
        assert all(p + shift * SPACING >= 0.0 for p, shift in zip(position, shifts, strict=True))
        around = [
            range(math.floor((p - margin) / SPACING), math.ceil((p + margin) / SPACING) + 1) for p in position
        ]
        for i in around[0]:
            for j in around[1]:
                there = i + shifts[0], j + shifts[1]
                for axis in range(2):
                    assert 0 <= there[axis] < count[axis] or count[axis] == shape[axis]
                there = there[0] % count[0], there[1] % count[1]
                assert copies.heights[there] == heights[i % n_x, j % n_y] == -copies.above[there]


@pytest.mark.nojit
def test_a_window_is_as_large_as_it_must_be_or_the_whole_surface():
    """Within 0.6 of two particles on both sides of the period: nodes from 9.2 to 11.3, of squares of 0.5."""
    model = SimpleNamespace(length_x=10.0, length_y=10.0, spacing=SPACING)
    s = SimpleNamespace(x=np.array([9.8, 0.7]), y=np.array([5.0, 5.0]))
    assert window_of(model, s, np.arange(2), (20, 20), 0.6) == (18, 8, 6, 5)
    assert window_of(model, s, np.arange(2), (20, 20), 4.6) == (0, 0, 20, 20)
