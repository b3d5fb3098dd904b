"""Laws of heightfield.py: the triangles and their periods, closest points, contact, and removal."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rounding import close, repeatable
from scipy.integrate import dblquad
from scipy.optimize import minimize

from reference import exact
from reference.heightfield import Heightfield, closest_point, surface_contact
from reference.triangle import closest_point_on_triangle

pytestmark = pytest.mark.nojit
seeds = st.integers(0, 10_000)
places = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
SPACING = 0.5  # with 6 x 4 nodes: periods 3 and 2


def rough(seed, height=0.6):
    return Heightfield(np.random.default_rng(seed).uniform(0.0, height, (6, 4)), SPACING)


def all_triangles(field, around, reach):
    """Corners (n, 3, 3) and numbers (n,) of every triangle of every image within reach of (x, y)."""
    z, h = field.z, field.spacing
    n_x, n_y = z.shape
    low = np.floor((np.asarray(around[:2]) - reach) / h).astype(int) - 1
    high = np.floor((np.asarray(around[:2]) + reach) / h).astype(int) + 1
    corners, numbers = [], []
    for i in range(low[0], high[0] + 1):
        for j in range(low[1], high[1] + 1):
            a, b, c, d = (
                np.array([p * h, q * h, z[p % n_x, q % n_y]])
                for p, q in [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            )
            corners += [(a, b, c), (a, c, d)]
            first = 2 * ((i % n_x) * n_y + j % n_y)
            numbers += [first, first + 1]
    return np.array(corners), np.array(numbers)


def distances(corners, p):
    """Distance of p to each triangle: the least of its foot on the plane, if inside, and its three edges."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    height = np.sum((p - a) * normal, axis=1)
    foot = p - height[:, None] * normal
    inside = np.ones(len(a), bool)
    nearest = np.full(len(a), np.inf)
    for start, end in [(a, b), (b, c), (c, a)]:
        side = end - start
        inside &= np.sum(np.cross(side, foot - start) * normal, axis=1) >= 0
        t = np.clip(np.sum((p - start) * side, axis=1) / np.sum(side**2, axis=1), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(start + t[:, None] * side - p, axis=1))
    return np.where(inside, np.abs(height), nearest)


@pytest.mark.parametrize("seed", range(5))
def test_the_brute_force_yardstick_is_the_minimum_of_the_distance(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (3, 3))
    p = rng.uniform(-1, 1, 3)

    def square(weights):
        return np.sum((corners.T @ [1 - sum(weights), *weights] - p) ** 2)

    found = minimize(
        square,
        [0.3, 0.3],
        method="SLSQP",
        bounds=[(0, 1)] * 2,
        constraints={"type": "ineq", "fun": lambda w: 1 - w[0] - w[1]},
        options={"ftol": 1e-14},
    )
    close(distances(corners[None], p)[0] ** 2, found.fun, rtol=1e-6)  # the minimiser's own tolerance


@settings(repeatable, max_examples=200)
@given(seeds)
def test_the_closest_point_of_one_triangle_lies_in_any_of_its_regions(seed):
    rng = np.random.default_rng(seed)
    corners, p = rng.uniform(-1, 1, (3, 3)), rng.uniform(-2, 2, 3)
    q = np.array(closest_point_on_triangle(*p, *corners.ravel()))
    close(np.linalg.norm(q - p), distances(corners[None], p)[0], scale=1.0)
    close(distances(corners[None], q)[0], 0.0, scale=10.0)  # q is on the triangle


@repeatable
@given(seeds, places, st.floats(-0.3, 1.2), st.sampled_from([0.2, 0.7, 2.3]))
def test_the_closest_point_is_the_closest_of_all_triangles_and_images(seed, place, z, radius):
    field, p = rough(seed), np.array([*place, z])
    corners, numbers = all_triangles(field, p, radius)
    distance = distances(corners, p)
    found = field.closest_point(p, radius)
    if distance.min() > radius:
        assert found is None
        return
    assert found is not None
    point, reported, triangle = found
    close(reported, distance.min(), scale=40.0)
    close(np.linalg.norm(point - p), reported, scale=40.0)
    close(field.height(*point[:2]), point[2], scale=40.0)
    ties = numbers[distance <= distance.min() + 1e-9]
    assert triangle in ties
    assert (triangle == ties).any()


def test_reach_ends_at_the_radius():
    flat = Heightfield(np.zeros((4, 4)), SPACING)
    assert flat.closest_point([0.3, 0.4, 0.75], 0.75 * (1 - 1e-9)) is None
    found = flat.closest_point([0.3, 0.4, 0.75], 0.75 * (1 + 1e-9))
    assert found is not None
    close(found[0], [0.3, 0.4, 0.0], scale=1.0)
    close(found[1], 0.75)


@repeatable
@given(seeds, places, st.floats(0.0, 1.0), st.integers(-3, 3), st.integers(-3, 3))
def test_the_surface_is_periodic_in_both_directions(seed, place, z, along_x, along_y):
    field = rough(seed)
    here = np.array([*place, z])
    shift = np.array([along_x * 6 * SPACING, along_y * 4 * SPACING, 0.0])
    close(field.height(*(here + shift)[:2]), field.height(*place), scale=100.0)
    one, other = field.closest_point(here, 0.9), field.closest_point(here + shift, 0.9)
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        close(other[1], one[1], scale=100.0)


def test_half_a_period_is_none():
    field = rough(0)
    assert abs(field.height(0.1 + 1.5, 0.2) - field.height(0.1, 0.2)) > 1e-3
    assert abs(field.height(0.1, 0.2 + 1.0) - field.height(0.1, 0.2)) > 1e-3


@pytest.mark.parametrize("i, j", [(0, 0), (5, 3), (2, 3), (5, 1)])
def test_each_square_is_cut_along_its_rising_diagonal(i, j):
    field = rough(1)
    z, h = field.z, SPACING
    far, right, up = z[(i + 1) % 6, (j + 1) % 4], z[(i + 1) % 6, j], z[i, (j + 1) % 4]
    close(field.height(i * h, j * h), z[i, j])
    close(field.height((i + 0.5) * h, (j + 0.5) * h), (z[i, j] + far) / 2)
    close(field.height((i + 0.75) * h, (j + 0.25) * h), (z[i, j] + 2 * right + far) / 4)
    close(field.height((i + 0.25) * h, (j + 0.75) * h), (z[i, j] + 2 * up + far) / 4)
    assert abs((z[i, j] + far) - (right + up)) > 1e-3  # else the other diagonal would do


@pytest.mark.parametrize("i, j", [(0, 0), (5, 3), (2, 1)])
def test_triangles_are_numbered_by_square_lower_first(i, j):
    field = Heightfield(np.zeros((6, 4)), SPACING)
    for a, b, side in [(0.7, 0.2, 0), (0.2, 0.7, 1)]:
        found = field.closest_point([(i + a) * SPACING, (j + b) * SPACING, 0.01], 0.1)
        assert found is not None
        assert found[2] == 2 * (i * 4 + j) + side


def test_height_broadcasts():
    field = rough(2)
    x, y = np.array([[0.1], [0.9]]), np.array([0.2, 0.3, 1.4])
    heights = field.height(x, y)
    assert heights.shape == (2, 3)
    assert heights[1, 2] == field.height(0.9, 1.4)


def test_the_volume_is_the_integral_of_the_height():
    field = rough(3)
    total = 0.0
    for i in range(6):
        for j in range(4):  # each triangle on its own: the integrand is linear there
            x, y = i * SPACING, j * SPACING
            lower = dblquad(lambda b, a: field.height(a, b), x, x + SPACING, y, lambda a, x=x, y=y: y + a - x)
            upper = dblquad(
                lambda b, a: field.height(a, b), x, x + SPACING, lambda a, x=x, y=y: y + a - x, y + SPACING
            )
            total += lower[0] + upper[0]
    close(field.volume(), total, rtol=1e-9)  # on the diagonal itself the quadrature never evaluates


@repeatable
@given(seeds, places, st.floats(-1.0, 0.0))
def test_a_centre_below_the_surface_is_lifted_straight_up(seed, place, depth):
    field, radius = rough(seed), 0.3
    x, y = place
    ground = field.height(x, y)
    hit = surface_contact(field.z, SPACING, x, y, ground + depth, radius)
    assert hit[0]
    assert hit[2:5] == (0.0, 0.0, 1.0)
    close(hit[1], radius - depth, scale=10.0)
    close(hit[5:8], [x, y, ground], scale=40.0)


@repeatable
@given(seeds, places, st.floats(0.01, 0.6))
def test_a_centre_above_the_surface_is_pushed_away_from_the_closest_point(seed, place, lift):
    field, radius = rough(seed), 0.4
    p = np.array([*place, field.height(*place) + lift])
    found, overlap, *rest = surface_contact(field.z, SPACING, *p, radius)
    nearest = field.closest_point(p, radius)
    assert found == (nearest is not None)
    if nearest is None:
        return
    normal, q = np.array(rest[:3]), np.array(rest[3:6])
    close(q, nearest[0], scale=40.0)
    close(overlap, radius - nearest[1], scale=40.0)
    # the distance is at least 0.01 cos(slope) > 1e-3, so the normal carries 40/1e-3 of round-off
    close(normal, (p - nearest[0]) / nearest[1], scale=40.0 / nearest[1])
    close(np.linalg.norm(normal), 1.0)
    assert normal[2] > 0


@repeatable
@given(seeds, places, st.sampled_from([0.15, 0.4, 1.3]))
def test_a_sphere_let_down_touches_where_the_triangles_say(seed, place, radius):
    field = rough(seed)
    touch = exact.drop_onto_heightfield(field.z, SPACING, *place, radius)
    x, y, z = touch.centre
    sink = 1e-7 * radius
    assert not surface_contact(field.z, SPACING, x, y, z + sink, radius)[0]
    found, overlap, *rest = surface_contact(field.z, SPACING, x, y, z - sink, radius)
    assert found
    assert 0 < overlap <= sink * (1 + 1e-5)
    corners, _ = all_triangles(field, touch.centre, radius)
    others = distances(corners, touch.centre) / radius - 1
    alone = others[others > 1e-6].min(initial=np.inf) > 1e-3  # no second contact about to be made
    if alone:
        # sunk by 1e-7 R into a contact that is stable to a factor 100, the point moves by 1e-5 R
        np.testing.assert_allclose(rest[:3], touch.normal, rtol=0, atol=1e-4)
        np.testing.assert_allclose(rest[3:6], touch.point, rtol=0, atol=1e-4 * radius)


@repeatable
@given(seeds, places, st.floats(1e-6, 0.1))
def test_removal_takes_exactly_its_volume_from_one_triangle(seed, place, volume):
    field = rough(seed)
    before, total = field.z.copy(), field.volume()
    field.remove_volume(*place, volume)
    close(total - field.volume(), volume, scale=10.0)
    fall = before - field.z
    assert np.all(fall >= 0)
    assert np.count_nonzero(fall) <= 3
    # the nodes fall as their weights: the centroid of the removed volume is at the place
    i, j = np.nonzero(fall)
    x, y = np.array(place)
    nodes_x = x + (i * SPACING - x + 1.5) % 3 - 1.5
    nodes_y = y + (j * SPACING - y + 1.0) % 2 - 1.0
    close(fall[i, j] @ nodes_x / fall.sum(), x, scale=100.0 / volume)
    close(fall[i, j] @ nodes_y / fall.sum(), y, scale=100.0 / volume)


def test_removal_on_a_node_lowers_that_node_alone():
    field = Heightfield(np.ones((4, 4)), SPACING)
    field.remove_volume(3 * SPACING, 2 * SPACING, 0.05)
    expected = np.ones((4, 4))
    expected[3, 2] -= 0.05 / SPACING**2
    close(field.z, expected)


@repeatable
@given(seeds, places, st.floats(1e-3, 0.5))
def test_the_nearest_node_is_lowered_across_the_period_too(seed, place, depth):
    field = rough(seed)
    before = field.z.copy()
    field.lower_node(*place, depth)
    fall = before - field.z
    i, j = (int(k[0]) for k in np.nonzero(fall))
    assert np.count_nonzero(fall) == 1
    close(fall[i, j], depth, scale=1.0)
    away = np.array([(i * SPACING - place[0] + 1.5) % 3 - 1.5, (j * SPACING - place[1] + 1.0) % 2 - 1.0])
    assert np.all(np.abs(away) <= 0.5 * SPACING * (1 + 1e-9))


def test_a_node_next_to_the_seam_belongs_to_the_other_side():
    field = Heightfield(np.zeros((6, 4)), SPACING)
    field.lower_node(2.8, 1.9, 0.1)  # nearer to the images of node (0, 0) at 3 and 2
    assert field.z[0, 0] == -0.1


def test_a_heightfield_keeps_its_own_copy():
    z = np.zeros((4, 4))
    Heightfield(z, 1.0).lower_node(0.0, 0.0, 1.0)
    assert np.all(z == 0.0)


@pytest.mark.parametrize(
    "z, spacing", [(np.zeros(4), 1.0), (np.full((2, 2), np.nan), 1.0), (np.zeros((2, 2)), 0.0)]
)
def test_a_field_without_sense_is_refused(z, spacing):
    with pytest.raises(ValueError, match="must be"):
        Heightfield(z, spacing)


def test_the_kernel_and_the_class_agree():
    field = rough(5)
    found, *q, distance, triangle = closest_point(field.z, SPACING, 0.3, 0.2, 0.5, 1.0)
    one = field.closest_point([0.3, 0.2, 0.5], 1.0)
    assert found
    assert one is not None
    assert (list(one[0]), one[1], one[2]) == (q, distance, triangle)
