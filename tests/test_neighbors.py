"""Laws of neighbors.py: minimum images, all pairs within the cutoff and no others, and has_moved."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rounding import close

from reference import neighbors
from reference.neighbors import has_moved, minimum_image, neighbor_pairs

pytestmark = pytest.mark.nojit
PERIODS = ([1.0, 1.0, 1.0], [1.0, 2.0, 0.0], [0.7, 1.3, 2.9], [0.0, 0.0, 0.0], [3.0, 0.4, 0.0])
periods = st.sampled_from(PERIODS).map(np.array)
cutoffs = st.sampled_from([0.05, 0.13, 0.22, 0.25, 0.31, 1 / 3, 0.5, 1.1, 4.0])
seeds = st.integers(0, 10_000)
many = settings(max_examples=60)


def distances(position, period):
    """Distance of every pair over all images from -2 to 2 periods: no minimum image is assumed."""
    apart = position[None, :, :] - position[:, None, :]
    square = np.zeros(apart.shape[:2])
    for axis, length in enumerate(period):
        images = apart[:, :, axis, None] + length * np.arange(-2, 3)
        square += (images**2).min(axis=-1)
    return np.sqrt(square)


def brute_force(position, cutoff, period):
    """Pairs i < j that are surely within the cutoff, and those that round-off may put on either side."""
    apart = distances(position, period)
    upper = np.triu(np.ones_like(apart, dtype=bool), 1)
    near = upper & (np.abs(apart - cutoff) <= 1e-14 * (1 + cutoff))  # coordinates of a few units
    surely = upper & (apart < cutoff) & ~near
    return {tuple(pair) for pair in np.argwhere(surely)}, {tuple(pair) for pair in np.argwhere(near)}


def check(position, cutoff, period):
    found = neighbor_pairs(position, cutoff, period)
    pairs = [tuple(map(int, pair)) for pair in found]
    surely, near = brute_force(position, cutoff, period)
    assert len(set(pairs)) == len(pairs)  # each once
    assert surely <= set(pairs) <= surely | near
    return pairs


def scattered(rng, n, period, depth=1.7):
    return rng.random((n, 3)) * np.where(period > 0, period, depth)


@pytest.mark.skipif(not numba.config.DISABLE_JIT, reason="compiled code does not count its work")
@pytest.mark.parametrize("dimensions, sides", [(3, (6, 14)), (2, (15, 55))])
def test_the_work_is_linear_in_the_number_of_particles(monkeypatch, dimensions, sides):
    """Distances examined for each particle of a periodic cube and of a layer, one particle in each cell."""
    work = []
    for side in sides:
        axes = [np.arange(side) + 0.5] * dimensions + [np.zeros(1)] * (3 - dimensions)
        position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        calls = []
        counted = lambda d, period, calls=calls: calls.append(1) or minimum_image(d, period)  # noqa: E731
        monkeypatch.setattr(neighbors, "minimum_image", counted)
        neighbor_pairs(position, 1.0 - 1e-9, np.where(np.arange(3) < dimensions, float(side), 0.0))
        work.append(len(calls) / 3 / len(position))
    assert work[0] <= 3**dimensions / 2  # each pair of adjacent cells once
    assert work[1] == pytest.approx(work[0], rel=1e-12, abs=0)


@many
@given(seeds, st.integers(0, 60), periods, cutoffs)
def test_pairs_are_those_of_brute_force(seed, n, period, cutoff):
    check(scattered(np.random.default_rng(seed), n, period), cutoff, period)


@many
@given(seeds, st.integers(1, 60), periods, cutoffs)
def test_particles_on_the_borders_of_cells_are_found(seed, n, period, cutoff):
    """Coordinates are whole multiples of the cell, of its half and their neighbours among doubles."""
    rng = np.random.default_rng(seed)
    extent = np.where(period > 0, period, 2.0)
    cells = np.maximum(np.floor(extent / cutoff), 1)
    position = rng.integers(0, 2 * cells + 1, (n, 3)) * (extent / cells / 2)
    position = np.nextafter(position, position + rng.integers(-1, 2, (n, 3)))
    wrapped = np.where(period > 0, np.mod(position, np.where(period > 0, period, np.inf)), position)
    check(wrapped, cutoff, period)


@pytest.mark.parametrize("period", [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0]])
@pytest.mark.parametrize("cells", [1.0, 1.5, 2.0, 2.5, 2.999, 3.0, 3.5])
def test_a_box_of_few_cells_counts_no_pair_twice(period, cells):
    period = np.array(period)
    pairs = check(scattered(np.random.default_rng(0), 40, period), 1.0 / cells, period)
    assert pairs


@pytest.mark.parametrize("seed", range(3))
def test_a_dense_clump_outgrows_the_first_guess_of_room(seed):
    # 8 N + 16 pairs are reserved; all N (N - 1)/2 = 4950 of 100 particles are near
    period = np.array([10.0, 10.0, 0.0])
    position = 5.0 + 0.01 * np.random.default_rng(seed).random((100, 3))
    assert len(check(position, 1.0, period)) == 4950


@pytest.mark.parametrize("axis", range(3))
def test_pairs_reach_across_a_period_and_only_across_a_period(axis):
    period = np.array([5.0, 5.0, 5.0])
    position = np.full((2, 3), 2.5)
    position[:, axis] = 0.1, 4.9
    assert len(neighbor_pairs(position, 0.3, period)) == 1
    period[axis] = 0.0  # the twin: without the period they are 4.8 apart
    assert len(neighbor_pairs(position, 0.3, period)) == 0


def test_nobody_and_one_particle_have_no_pairs():
    period = np.array([1.0, 1.0, 0.0])
    assert neighbor_pairs(np.zeros((0, 3)), 0.1, period).shape == (0, 2)
    assert neighbor_pairs(np.full((1, 3), 0.5), 0.1, period).shape == (0, 2)


def test_a_flat_layer_needs_no_depth():
    # all at one height: an axis without a period and without extent
    rng = np.random.default_rng(3)
    position = np.column_stack([rng.random((50, 2)), np.full(50, 0.25)])
    assert check(position, 0.1, np.array([1.0, 1.0, 0.0]))


@given(seeds)
def test_the_order_of_pairs_depends_on_positions_only(seed):
    period = np.array([1.0, 1.0, 0.0])
    position = scattered(np.random.default_rng(seed), 40, period)
    one, two = neighbor_pairs(position, 0.2, period), neighbor_pairs(position.copy(), 0.2, period)
    np.testing.assert_array_equal(one, two)


@given(st.floats(-50.0, 50.0), st.sampled_from([0.4, 1.0, 3.0]))
def test_the_minimum_image_is_the_nearest(distance, period):
    image = minimum_image(distance, period)
    turns = (distance - image) / period
    assert abs(image) <= 0.5 * period * (1 + 1e-12)
    close(turns, round(turns), scale=100.0)
    assert minimum_image(distance, 0.0) == distance


@given(st.floats(0.0, 0.499))
def test_the_minimum_image_is_odd(distance):
    assert minimum_image(-distance, 1.0) == -minimum_image(distance, 1.0)


def test_has_moved_by_more_than_the_limit_and_not_by_less():
    period = np.array([1.0, 1.0, 0.0])
    before = scattered(np.random.default_rng(1), 20, period)
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    for k, factor, expected in [(0, 0.999, False), (0, 1.001, True), (19, 0.999, False), (19, 1.001, True)]:
        after = before.copy()
        after[k] += 0.1 * factor * direction
        assert has_moved(after, before, 0.1, period) == expected


def test_crossing_a_period_is_no_move_but_crossing_an_open_side_is():
    before, after = np.array([[0.001, 0.5, 0.5]]), np.array([[0.999, 0.5, 0.5]])
    assert not has_moved(after, before, 0.01, np.array([1.0, 1.0, 0.0]))
    assert has_moved(after, before, 0.01, np.array([0.0, 1.0, 0.0]))


def test_a_list_with_a_skin_misses_nobody_until_somebody_has_moved():
    """Particles fly straight; the listed pairs hold all contacts until `has_moved` says half the skin."""
    rng, period, reach, skin = np.random.default_rng(7), np.array([1.0, 1.0, 0.0]), 0.1, 0.05
    listed = scattered(rng, 80, period)
    velocity = rng.uniform(-1.0, 1.0, listed.shape)
    pairs = {tuple(pair) for pair in neighbor_pairs(listed, reach + skin, period)}
    valid, complete = [], []
    for time in np.linspace(0.0, 0.2, 41):
        position = listed + time * velocity
        position[:, :2] %= 1.0
        touching, _ = brute_force(position, reach, period)
        valid.append(not has_moved(position, listed, 0.5 * skin, period))
        complete.append(touching <= pairs)
    assert 3 <= sum(valid) < 40
    assert all(complete[: sum(valid)])
    assert not complete[-1]  # the twin: a list that is never renewed misses contacts
