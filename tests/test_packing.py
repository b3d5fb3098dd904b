"""Laws of packing.py: no two spheres touch, all keep their limits and the surface, places are uniform."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare

from reference.heightfield import raise_squares, surface_contact
from reference.packing import PackingError, pack

pytestmark = pytest.mark.nojit
NO_SURFACE = np.zeros((0, 0)), 0.0
PERIODS = ([4.0, 4.0, 4.0], [4.0, 3.0, 0.0], [9.0, 2.1, 0.0], [2.0, 2.0, 30.0])


def gaps(position, diameter, periods):
    """Smallest distance between the surfaces of two spheres over all images, for each sphere."""
    apart = position[None] - position[:, None]
    square = np.zeros(apart.shape[:2])
    for axis, period in enumerate(periods):
        images = apart[..., axis, None] + period * np.arange(-1, 2)
        square += (images**2).min(axis=-1)
    gap = np.sqrt(square) - 0.5 * (diameter[None] + diameter[:, None])
    np.fill_diagonal(gap, np.inf)
    return gap.min(axis=1)


@settings(max_examples=40)
@given(st.integers(0, 10_000), st.integers(1, 40), st.sampled_from(PERIODS), st.floats(0.0, 0.9))
def test_no_two_spheres_touch_and_all_keep_their_limits(seed, n, periods, spread):
    rng, periods = np.random.default_rng(seed), np.array(periods)
    diameter = 0.5 * (1 + spread * rng.uniform(-1, 1, n))
    high = periods[2] or 5.0
    position = pack(diameter, periods, 0.5 * diameter, high - 0.5 * diameter, *NO_SURFACE, rng)
    # the packing compares squares of distances of order 1, rounded at 1e-16
    assert n == 1 or gaps(position, diameter, periods).min() >= -1e-14
    assert np.all(position[:, 2] >= 0.5 * diameter)
    assert np.all(position[:, 2] <= high - 0.5 * diameter)
    assert np.all((position[:, :2] >= 0) & (position[:, :2] < periods[:2]))


def test_thrown_without_looking_they_would_touch():
    """The twin: the same density at independent places."""
    rng, periods = np.random.default_rng(0), np.array([4.0, 4.0, 4.0])
    assert gaps(periods * rng.random((40, 3)), np.full(40, 0.9), periods).min() < 0
    packed = pack(np.full(40, 0.9), periods, 0.0, 4.0, *NO_SURFACE, rng)
    assert gaps(packed, np.full(40, 0.9), periods).min() >= -1e-14


def test_spheres_keep_clear_of_the_surface():
    ground = raise_squares(8, 4.0, 1.0, [[1, 2], [5, 5], [7, 0]])
    diameter = np.full(30, 0.5)
    position = pack(diameter, [4.0, 4.0, 0.0], 0.25, 2.0, ground.z, ground.spacing, np.random.default_rng(4))
    assert not any(surface_contact(ground.z, ground.spacing, *place, 0.25)[0] for place in position)
    assert position[:, 2].min() < 1.0  # some lie between the asperities
    blind = pack(diameter, [4.0, 4.0, 0.0], 0.25, 2.0, *NO_SURFACE, np.random.default_rng(4))
    assert any(surface_contact(ground.z, ground.spacing, *place, 0.25)[0] for place in blind)


def test_places_are_uniform_along_each_axis():
    """A periodic box has no preferred place, at any density: counts in 10 slices pass chi-square.

    200 independent packings of 20; particles of one packing repel and make the counts more even, not less.
    """
    periods = np.array([4.0, 3.0, 5.0])
    seeds = np.random.SeedSequence(7).spawn(200)
    places = np.concatenate(
        [pack(np.full(20, 0.6), periods, 0.0, 5.0, *NO_SURFACE, np.random.default_rng(s)) for s in seeds]
    )
    for axis, period in enumerate(periods):
        counts, _ = np.histogram(places[:, axis], bins=10, range=(0, period))
        assert chisquare(counts).pvalue > 1e-3  # fails one in a thousand seeds; this one is fixed
        skewed, _ = np.histogram(period * (places[:, axis] / period) ** 1.2, bins=10, range=(0, period))
        assert chisquare(skewed).pvalue < 1e-6  # the twin


def test_a_third_of_the_volume_can_be_filled():
    n, d = 60, 0.9
    size = (n * np.pi * d**3 / 6 / 0.33) ** (1 / 3)
    position = pack(np.full(n, d), [size] * 3, 0.0, size, *NO_SURFACE, np.random.default_rng(1))
    assert gaps(position, np.full(n, d), [size] * 3).min() >= -1e-14


@pytest.mark.parametrize("fraction", [0.5, 2.0])
def test_what_does_not_fit_is_refused_within_seconds(fraction):
    n, d = 60, 0.9
    size = (n * np.pi * d**3 / 6 / fraction) ** (1 / 3)
    start = time.perf_counter()
    with pytest.raises(PackingError, match=rf"placed \d+ of {n} particles"):
        pack(np.full(n, d), [size] * 3, 0.0, size, *NO_SURFACE, np.random.default_rng(1))
    assert time.perf_counter() - start < 20.0


def test_a_room_that_is_too_low_is_refused():
    with pytest.raises(PackingError, match="no room"):
        pack(
            np.array([1.0, 1.2]),
            [9.0, 9.0, 0.0],
            [0.5, 0.6],
            [0.5, 0.4],
            *NO_SURFACE,
            np.random.default_rng(1),
        )


def test_the_same_generator_gives_the_same_places():
    one, two, other = (
        pack(np.full(30, 0.5), [4.0, 4.0, 0.0], 0.0, 3.0, *NO_SURFACE, np.random.default_rng(s))
        for s in (1, 1, 2)
    )
    assert one.tobytes() == two.tobytes()
    assert not np.array_equal(one, other)
