"""Collisions and wall impacts of reference.exact, checked by other routes: conservation, limits, stiff ODEs.

No model file takes part: these tests say that the yardstick is straight.  Doctests are collected by pytest.
"""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, directions, masses, repeatable, speeds, unit, vectors
from scipy.integrate import solve_ivp
from scipy.special import beta

from reference import exact

UP = np.array([0.0, 0.0, 1.0])


def approaching(v_i, v_j, n, speed):
    """Change v_j so that the two approach along n with the given speed."""
    return v_j + ((v_i - v_j) @ n - speed) * n


@repeatable
@given(masses, masses, vectors, vectors, directions, speeds, unit, unit)
def test_a_collision_conserves_momentum_and_accounts_for_its_energy(m_i, m_j, v_i, v_j, n, speed, e, mu):
    v_j = approaching(v_i, v_j, n, speed)
    hit = exact.pair_collision(m_i, m_j, v_i, v_j, n, e, mu)
    scale = (m_i + m_j) * (1.0 + speed)
    close(m_i * hit.velocity_i + m_j * hit.velocity_j, m_i * v_i + m_j * v_j, scale)
    before = 0.5 * m_i * v_i @ v_i + 0.5 * m_j * v_j @ v_j
    after = 0.5 * m_i * hit.velocity_i @ hit.velocity_i + 0.5 * m_j * hit.velocity_j @ hit.velocity_j
    close(hit.energy_lost, before - after, scale=before + after)
    assert hit.energy_lost >= -ROUND * (before + after)
    close(m_i * (hit.velocity_i - v_i), hit.friction_impulse - hit.normal_impulse * n, scale)
    close((hit.velocity_j - hit.velocity_i) @ n, e * speed, scale=1.0 + speed)


@repeatable
@given(masses, masses, speeds, unit)
def test_the_centre_of_mass_and_the_linear_system_agree(m_i, m_j, speed, e):
    hit = exact.pair_collision(m_i, m_j, [speed, 0, 0], [0, 0, 0], [1, 0, 0], e)
    line = exact.normal_impact(m_i, m_j, speed, 0.0, e)
    close(line.compression_impulse + line.recovery_impulse, hit.normal_impulse)
    close([line.velocity_i, line.velocity_j], [hit.velocity_i[0], hit.velocity_j[0]], scale=speed)


@pytest.mark.parametrize("side, sticks", [(1 - 1e-9, True), (1 + 1e-9, False)])
def test_spheres_stick_up_to_the_cone_of_static_friction(side, sticks):
    e, mu, v_n = 0.5, 0.3, 2.0
    v_t = side * mu * (1 + e) * v_n
    hit = exact.pair_collision(1e-15, 3e-15, [0, 0, 0], [-v_n, v_t, 0], [1, 0, 0], e, mu, 0.2)
    assert hit.sticks is sticks
    slip = (hit.velocity_j - hit.velocity_i)[1]
    left = 0.0 if sticks else v_t - 0.2 * (1 + e) * v_n
    close(slip, left, scale=v_t)


@pytest.mark.parametrize("damping", [0.0, 0.1, 0.4])
def test_a_stiff_spring_and_dashpot_gives_the_same_collision(damping):
    m_i, m_j, v, omega = 1.0, 3.0, 2.0, 1e3
    m_eff = m_i * m_j / (m_i + m_j)
    stiffness, viscous = m_eff * omega**2, 2 * damping * m_eff * omega

    def rate(_, y):  # overlap, v_i, v_j, impulse
        force = stiffness * y[0] + viscous * (y[1] - y[2])
        return [y[1] - y[2], -force / m_i, force / m_j, force]

    def parted(t, y):
        return y[0] if t > 0 else 1.0

    parted.terminal, parted.direction = True, -1
    run = solve_ivp(rate, (0, 1.0), [0, v, 0, 0], "DOP853", events=parted, rtol=1e-11, atol=1e-14)
    e = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    hit = exact.pair_collision(m_i, m_j, [v, 0, 0], [0, 0, 0], [1, 0, 0], e)
    # 1e-8: the integrator's tolerance over some hundred steps
    close(run.y[1:, -1], [hit.velocity_i[0], hit.velocity_j[0], hit.normal_impulse], rtol=1e-8)


def elastic_contact_under_load(m_i, m_j, v, force_i, force_j):
    """Impulses of an elastic spring between two bodies under constant forces, and the phases' durations."""
    stiffness = 0.75e4

    def rate(_, y):
        spring = stiffness * y[0]
        return [y[1] - y[2], (force_i - spring) / m_i, (force_j + spring) / m_j, spring]

    def deepest(_, y):
        return y[1] - y[2]

    def parted(t, y):
        return y[0] if t > 0 else 1.0

    deepest.direction = -1
    parted.terminal, parted.direction = True, -1
    run = solve_ivp(rate, (0, 1.0), [0, v, 0, 0], "DOP853", events=(deepest, parted), rtol=1e-11, atol=1e-14)
    return run.t_events[0][0], run.t[-1], run.y[:, -1]


def test_external_forces_enter_each_phase_as_in_an_elastic_contact():
    m_i, m_j, v, force_i, force_j = 1.0, 3.0, 2.0, 40.0, -10.0
    half, whole, (_, v_i, v_j, impulse) = elastic_contact_under_load(m_i, m_j, v, force_i, force_j)
    phases = (force_i * half, force_j * half, force_i * (whole - half), force_j * (whole - half))
    line = exact.normal_impact(m_i, m_j, v, 0.0, 1.0, *phases)
    got = [line.velocity_i, line.velocity_j, line.compression_impulse + line.recovery_impulse]
    # 1e-7: the integrator's tolerance, and the event's, over some hundred steps
    close(got, [v_i, v_j, impulse], rtol=1e-7)
    # the twin: forces divided by each other's mass
    swapped = exact.normal_impact(m_i, m_j, v, 0.0, 1.0, phases[0] * m_i / m_j, phases[1] * m_j / m_i)
    assert abs(swapped.compression_impulse - line.compression_impulse) > 0.01 * impulse


def test_a_pair_that_parts_does_not_collide():
    with pytest.raises(ValueError, match="do not approach"):
        exact.pair_collision(1.0, 1.0, [0, 0, 0], [1, 0, 0], [1, 0, 0], 1.0)


@repeatable
@given(vectors, vectors, directions)
def test_first_touch_is_the_first_time_at_the_contact_distance(offset, v_i, n):
    i = exact.Sphere(1.0, 0.7, 3 * offset, v_i)
    aim = 2.0 * n + 0.9 * np.cross(n, offset)  # close to a hit, not always one
    j = exact.Sphere(1.0, 0.4, i.position + 4 * n, v_i - aim)
    touch = exact.first_touch(i, j)
    times = np.linspace(0, 4, 2001)
    gaps = np.linalg.norm(4 * n - aim * times[:, None], axis=1) - 1.1
    if touch is None:
        assert gaps.min() >= 0
        return
    assert np.all(gaps[times < touch.time * (1 - 1e-12)] > 0)
    close(np.linalg.norm(touch.centre_j - touch.centre_i), 1.1)
    close(touch.centre_i, i.position + touch.time * i.velocity, scale=10.0)
    close(touch.point, touch.centre_j - 0.4 * touch.normal, scale=10.0)


def test_a_sphere_is_met_through_the_periodic_boundary():
    i = exact.Sphere(1.0, 0.5, np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]))
    j = exact.Sphere(1.0, 0.5, np.array([9.0, 0, 0]), np.array([0.0, 0, 0]))
    assert exact.first_touch(i, j, until=100.0) is None
    touch = exact.first_touch(i, j, periods=(10.0, 10.0, 0.0), until=100.0)
    assert touch is not None
    close([touch.time, *touch.normal, touch.centre_j[0]], [1.0, -1.0, 0.0, 0.0, -1.0])
    assert exact.first_touch(i, j, periods=(10.0, 10.0, 0.0), until=0.9) is None


def test_overlapping_spheres_are_refused():
    i = exact.Sphere(1.0, 1.0, np.zeros(3), np.zeros(3))
    with pytest.raises(ValueError, match="overlap at the start"):
        exact.first_touch(i, i._replace(position=np.array([1.0, 0, 0])))


def test_the_pair_flies_straight_before_and_after_its_collision():
    i = exact.Sphere(1e-15, 0.5e-6, np.array([0, 0, 5e-6]), np.array([1.0, 0.1, 0]))
    j = exact.Sphere(2e-15, 0.7e-6, np.array([5e-6, 0.3e-6, 5e-6]), np.array([-1.0, 0, 0]))
    times = np.linspace(0, 4e-6, 41)
    path = exact.pair_trajectory(times, i, j, 0.5, 0.3)
    centre = np.einsum("p,tpk->tk", [1 / 3, 2 / 3], path.positions)
    start = (i.position + 2 * j.position) / 3
    drift = (i.velocity + 2 * j.velocity) / 3
    close(centre, start + drift * times[:, None], scale=1e-5)
    gaps = np.linalg.norm(path.positions[:, 1] - path.positions[:, 0], axis=1)
    assert gaps.min() >= 1.2e-6 * (1 - ROUND)
    close(np.diff(path.positions, axis=0)[-1], path.velocities[-1] * 1e-7, scale=1e-5)


@repeatable
@given(masses, directions, vectors, speeds, unit, unit, st.floats(-1.0, 1.0))
def test_a_constant_force_drops_out_of_the_rebound(m, n, v, speed, e, gain, push):
    v = v - (v @ n + speed) * n
    duration = 1e-9
    force = 0.5 * push * m * speed / duration
    hit = exact.wall_impact(m, v, n, e, gain * m, force, duration)
    close(hit.velocity @ n, e * speed / (1 + gain), scale=1.0 + speed)
    close(hit.normal_impulse, (1 + e) * m * speed - force * duration, scale=m * speed)
    tangential = (v - (v @ n) * n) / (1 + gain)
    close(hit.velocity - (hit.velocity @ n) * n, tangential, scale=1.0 + speed)
    kinetic = 0.5 * m * v @ v
    close(hit.energy_lost, kinetic - 0.5 * hit.mass * hit.velocity @ hit.velocity, scale=kinetic)


def test_kinetic_energy_after_a_normal_impact():
    hit = exact.wall_impact(4.0, [0, 0, -3.0], UP, 0.5, 1.0)
    close(0.5 * hit.mass * hit.velocity @ hit.velocity, 0.5**2 * 4.0 / 5.0 * 18.0)


def test_a_vanishing_impact_returns_the_force_that_presses():
    hit = exact.wall_impact(1.0, [0, 0, -1e-300], UP, 0.5, 0.0, -7.0, 1.0)
    close(hit.normal_impulse, 7.0)
    close(hit.load, 7.0)


def test_a_wall_impact_under_load_is_that_on_a_body_without_end():
    half, whole, (_, v_after, _, impulse) = elastic_contact_under_load(1.0, 1e14, 2.0, 40.0, 0.0)
    hit = exact.wall_impact(1.0, [0, 0, -2.0], UP, 1.0, 0.0, -40.0, whole)
    # 1e-7: the integrator's tolerance; compression takes half of an elastic contact
    close([hit.velocity[2], hit.normal_impulse, whole], [-v_after, impulse, 2 * half], rtol=1e-7)


def test_hertz_duration_by_beta_function_and_by_integration():
    coefficient = (15 / 16) ** 0.4 * 0.8 * beta(0.4, 0.5)
    close(exact.hertz_integral(1.0, 1.0, 1.0, 1.0), coefficient, rtol=1e-9)
    m, radius, modulus, v = 1e-15, 0.5e-6, 1e11, 0.3
    # rounding 2.868 to 2.87 is half a unit of the last digit: at most 0.005/2.87 = 0.17 %
    close(
        exact.hertz_duration(m, radius, modulus, v), exact.hertz_integral(m, radius, modulus, v), rtol=0.0017
    )

    def rate(_, y):
        return [y[1], -4 / 3 * max(y[0], 0.0) ** 1.5]

    def parted(t, y):
        return y[0] if t > 0 else 1.0

    parted.terminal, parted.direction = True, -1
    run = solve_ivp(rate, (0, 5), [0, 1], "DOP853", events=parted, rtol=1e-11, atol=1e-13)
    close(run.t[-1], coefficient, rtol=1e-7)  # the integrator's tolerance, and the root's at low speed


def test_what_is_removed_follows_from_load_and_joins_the_sphere():
    wall = exact.Wall(0.5, 1e11, 0.3, 1e8, 9000.0, threshold_velocity=0.1)
    v = [0.3, 0.0, -0.5]
    hit = exact.removing_impact(1e-15, 0.5e-6, v, UP, wall)
    assert hit.removal.volume > 0
    close(hit.mass, 1e-15 + 9000.0 * hit.removal.volume)
    close(hit.load * exact.hertz_duration(1e-15, 0.5e-6, 1e11, 0.5), 1.5 * 1e-15 * 0.5)
    close(hit.velocity, np.array([0.3, 0.0, 0.25]) * 1e-15 / hit.mass)
    carried_off = exact.removing_impact(1e-15, 0.5e-6, v, UP, wall._replace(mass_pickup=False))
    assert (carried_off.mass, carried_off.removal) == (1e-15, hit.removal)
    slow = exact.removing_impact(1e-15, 0.5e-6, [0, 0, -0.09], UP, wall)
    assert slow.removal.volume == 0.0


def test_the_closed_forms_import_no_model_file():
    allowed = {
        "__future__",
        "collections.abc",
        "dataclasses",
        "itertools",
        "math",
        "typing",
        "numpy",
        "numpy.typing",
        "scipy.integrate",
        "scipy.optimize",
    }
    for path in Path(exact.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert all(n in allowed or n.startswith("reference.exact.") for n in names), (path.name, names)
