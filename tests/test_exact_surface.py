"""Touch and indentation in reference.exact, checked by sampling of the surface, equilibrium and geometry.

No model file takes part; what a model does on the same surface is in test_heightfield and test_removal.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, repeatable
from scipy.integrate import dblquad
from scipy.linalg import expm

from reference import exact


def stress_at(point, nu):
    """Cartesian stress of a unit load at the origin pressing along +z."""
    x, y, z = point
    r = np.hypot(x, y)
    c, s = (x / r, y / r) if r > 0 else (1.0, 0.0)
    axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return axes.T @ exact.point_load_stress(1.0, r, z, nu) @ axes


@pytest.mark.parametrize("nu", [0.0, 0.22, 0.34, 0.49])
def test_the_point_load_is_in_equilibrium(nu):
    point, step = np.array([0.3, -0.4, 0.6]), 1e-4
    shifts = step * np.eye(3)
    divergence = sum(
        (8 * (stress_at(point + d, nu) - stress_at(point - d, nu))[k]
         - (stress_at(point + 2 * d, nu) - stress_at(point - 2 * d, nu))[k]) / (12 * step)
        for k, d in enumerate(shifts)
    )  # fmt: skip
    # stress is of order 1, so is its gradient: round-off eps/step 2e-12, truncation step^4 1e-16
    np.testing.assert_allclose(divergence, 0.0, rtol=0, atol=1e-10)


@pytest.mark.parametrize("nu", [0.0, 0.34])
def test_the_tractions_on_a_hemisphere_carry_the_load(nu):
    def vertical(phi):  # traction along z on the sphere of radius 1, ring at polar angle phi
        s, c = np.sin(phi), np.cos(phi)
        stress = exact.point_load_stress(1.0, s, c, nu)
        return 2 * np.pi * s * (stress[2, 0] * s + stress[2, 2] * c)

    nodes, weights = np.polynomial.legendre.leggauss(40)
    phi = 0.25 * np.pi * (nodes + 1)
    close(0.25 * np.pi * weights @ [vertical(p) for p in phi], -1.0)


@repeatable
@given(st.floats(1e-6, 1.0), st.floats(0.0, 0.45), st.floats(1e6, 1e10))
def test_the_circle_of_yield_radius_yields_and_nothing_outside_it(load, nu, yield_stress):
    x_p = exact.yield_radius(load, nu, yield_stress)
    # x_p to 1e-14 means the stress, falling as 1/r^2, to 2e-14
    close(exact.tensor_von_mises(exact.point_load_stress(load, x_p, 0.0, nu)), yield_stress)
    assert exact.tensor_von_mises(exact.point_load_stress(load, 1.001 * x_p, 0.0, nu)) < yield_stress
    close(exact.yield_radius(4 * load, nu, yield_stress), 2 * x_p)


def test_an_incompressible_solid_does_not_yield_at_its_surface():
    assert exact.yield_radius(1.0, 0.5, 1.0) == 0.0
    assert exact.yield_radius(0.0, 0.3, 1.0) == 0.0


def test_von_mises_does_not_see_pressure_or_rotation():
    stress = np.array([[3.0, 1.0, 0.0], [1.0, -2.0, 0.5], [0.0, 0.5, 1.0]])
    turn = expm(np.array([[0, -0.3, 0.2], [0.3, 0, -0.7], [-0.2, 0.7, 0]]))
    value = exact.tensor_von_mises(stress)
    close(exact.tensor_von_mises(stress + 100 * np.eye(3)), value, scale=100.0)
    close(exact.tensor_von_mises(turn @ stress @ turn.T), value)
    a, b, c = np.linalg.eigvalsh(stress)
    close(value, np.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 2))


@repeatable
@given(st.floats(1e-3, 1.0))
def test_the_cap_has_the_rim_and_the_volume_of_its_sphere(q):
    radius = 0.45e-6
    depth = exact.cap_depth(q * radius, radius)
    close((q * radius) ** 2 + (radius - depth) ** 2, radius**2)
    rest = exact.cap_volume(2 * radius - depth, radius)
    close(exact.cap_volume(depth, radius) + rest, 4 / 3 * np.pi * radius**3)
    below = dblquad(
        lambda r, _: r * (np.sqrt(1 - r * r) - np.sqrt(1 - q * q)), 0, 2 * np.pi, 0, q, epsabs=0, epsrel=1e-9
    )
    close(exact.cap_volume(depth, radius), below[0] * radius**3, rtol=1e-7)  # the quadrature's own error


def test_no_load_removes_more_than_a_hemisphere():
    cut = exact.removal(1.0, 0.45e-6, 0.3, 1e6)
    close(cut.volume, 2 / 3 * np.pi * 0.45e-6**3)
    assert cut.yield_radius == 0.45e-6


def test_a_small_cap_keeps_all_its_digits():
    # depth = x^2/2 (1 + x^2/4 + ...) for R = 1: the next term is 1e-17 of it
    close(exact.cap_depth(1e-8, 1.0), 0.5e-16, rtol=1e-15)


def rough(seed, n=5, spacing=1.0, height=0.8):
    return np.random.default_rng(seed).uniform(0, height, (n, n)), spacing


def surface_samples(z, spacing, around, reach, n=24):
    """Points on all triangles of the squares within reach of (x, y), on a barycentric grid."""
    low = np.floor((around[:2] - reach) / spacing).astype(int)
    high = np.ceil((around[:2] + reach) / spacing).astype(int)
    a, b = (g.ravel() for g in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    points = []
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            z00, z10, z11, z01 = (
                z[(i + p) % len(z), (j + q) % len(z)] for p, q in [(0, 0), (1, 0), (1, 1), (0, 1)]
            )
            lower = z00 + a * (z10 - z00) + b * (z11 - z10)
            upper = z00 + b * (z01 - z00) + a * (z11 - z01)
            points.append(
                np.stack([(i + a) * spacing, (j + b) * spacing, np.where(a >= b, lower, upper)], axis=1)
            )
    return np.concatenate(points)


@pytest.mark.parametrize("radius", [0.2, 0.6, 2.5])
@pytest.mark.parametrize("seed", range(6))
def test_the_drop_stops_exactly_on_the_triangles(seed, radius):
    z, h = rough(seed)
    x, y = np.random.default_rng(seed + 100).uniform(-7, 12, 2)
    touch = exact.drop_onto_heightfield(z, h, x, y, radius)
    samples = surface_samples(z, h, touch.centre, radius)
    distance = np.linalg.norm(samples - touch.centre, axis=1)
    assert distance.min() >= radius * (1 - ROUND)
    close(np.linalg.norm(touch.point - touch.centre), radius)
    on_surface = np.linalg.norm(samples - touch.point, axis=1).min()
    assert on_surface <= 0.1  # the spacing of the samples along a face that rises by at most 0.8
    gap = radius**2 - np.sum((samples[:, :2] - touch.centre[:2]) ** 2, axis=1)
    lowest = np.max(np.where(gap >= 0, samples[:, 2] + np.sqrt(np.maximum(gap, 0)), -np.inf))
    assert lowest <= touch.centre[2] * (1 + ROUND)
    # a sample lies within 1/23 of the maximum, where the height is level or has a kink of slope < 2
    assert lowest >= touch.centre[2] - 0.1


@pytest.mark.parametrize("seed", range(8))
def test_oblique_flight_ends_at_the_first_triangle_reached(seed):
    rng = np.random.default_rng(seed)
    z, h = rough(seed)
    radius = 0.5
    start, v = np.array([*rng.uniform(0, 5, 2), 3.0]), np.array([*rng.uniform(-1, 1, 2), -0.5])
    touch = exact.meet_heightfield(z, h, start, v, radius)
    for earlier in np.linspace(0, 1, 40):
        centre = start + v * touch.time * earlier
        nearest = np.linalg.norm(surface_samples(z, h, centre, radius) - centre, axis=1).min()
        assert nearest >= radius * (1 - ROUND)
    i, j = np.floor(touch.point[:2] / h).astype(int)
    square = surface_samples(z, h, (np.array([i, j]) + 0.5) * h, 0.4 * h, n=200)
    assert np.linalg.norm(square - touch.point, axis=1).min() < 0.02  # samples are 1/199 apart
    assert v @ touch.normal < 0
    shifted = exact.meet_heightfield(z, h, start + np.array([10.0, -5.0, 0.0]), v, radius)
    close([shifted.time, *shifted.normal], [touch.time, *touch.normal], scale=10.0)


def test_all_kinds_of_features_are_met():
    z = np.zeros((6, 6))
    z[2:4, 2:4] = 1.0

    def met(x, y):
        return exact.drop_onto_heightfield(z, 1.0, x, y, 0.25)

    assert met(2.7, 2.4).feature == "face"
    close(met(2.7, 2.4).centre[2], 1.25)
    rim = met(2.5, 3.1)  # beside the plateau's edge y = 3, over a flank at 45 degrees
    assert rim.feature == "edge"
    close(rim.centre[2], 1.0 + np.sqrt(0.25**2 - 0.1**2))
    corner = met(3.1, 3.1)
    assert corner.feature == "vertex"
    close(corner.centre[2], 1.0 + np.sqrt(0.25**2 - 0.02))
    flank = met(2.5, 3.5)
    close(flank.normal, [0, np.sqrt(0.5), np.sqrt(0.5)], scale=1.0)
    close(flank.centre[2], 0.5 + 0.25 * np.sqrt(2))


def test_a_flat_heightfield_is_the_plane():
    start, v = [0.3, -7.7, 4.0], [3.0, 1.0, -0.5]
    plane = exact.meet_plane(start, v, 0.7, height=0.2)
    field = exact.meet_heightfield(np.full((3, 3), 0.2), 1.0, start, v, 0.7)
    close([field.time, *field.centre, *field.point], [plane.time, *plane.centre, *plane.point], scale=30.0)
    close(plane.time, 6.2)
    with pytest.raises(ValueError, match="descend"):
        exact.meet_plane(start, [0, 0, 1], 0.7)
    with pytest.raises(ValueError, match="descend"):
        exact.meet_heightfield(np.zeros((3, 3)), 1.0, start, [1, 0, 0], 0.7)
