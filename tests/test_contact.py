"""Laws of the impulses of contact.py: momentum, restitution, Coulomb friction, mass pick-up, duration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, directions, masses, repeatable, speeds, unit, vectors
from scipy.spatial.transform import Rotation

from reference import contact, exact

UP = np.array([0.0, 0.0, 1.0])
pytestmark = pytest.mark.nojit
forces = st.floats(-0.5, 0.5)  # external impulse of a phase, in units of the momentum of approach


def restitution_of(mass_i, mass_j, v_in, v_jn, impulse, e, ext_i, ext_j):
    """Ratio of recovery to compression impulse when `impulse` acts, from momentum alone (no E in recovery).

    Compression must bring both to one velocity, which fixes its share of the impulse.
    """
    compression = (v_in + ext_i / mass_i - v_jn - ext_j / mass_j) / (1 / mass_i + 1 / mass_j)
    return impulse / compression - 1


@repeatable
@given(masses, masses, speeds, unit, forces, forces)
def test_the_impulse_has_the_asked_restitution_with_unequal_masses_and_external_forces(
    m_i, m_j, speed, e, push_i, push_j
):
    v_in, v_jn = 0.3 + speed, 0.3
    scale = m_i * m_j / (m_i + m_j) * speed
    ext_i, ext_j = push_i * scale, push_j * scale
    impulse = contact.pair_normal_impulse(m_i, m_j, v_in, v_jn, e, ext_i, ext_j)
    # the velocities 0.3 cancel: their round-off is 0.3/0.01 of the approach at worst, hence 1e-11
    line = exact.normal_impact(m_i, m_j, v_in, v_jn, e, ext_i, ext_j)
    close(impulse, line.compression_impulse + line.recovery_impulse, rtol=1e-11)
    close(restitution_of(m_i, m_j, v_in, v_jn, impulse, e, ext_i, ext_j), e, rtol=1e-10, scale=100.0)


def test_the_printed_masses_under_the_integrals_miss_the_restitution():
    m_i, m_j, v, e, ext_i = 1e-15, 3e-15, 1.0, 0.5, 2e-16
    swapped = contact.pair_normal_impulse(m_i, m_j, v, 0.0, e, ext_i * m_i / m_j, 0.0)
    right = contact.pair_normal_impulse(m_i, m_j, v, 0.0, e, ext_i, 0.0)
    assert abs(restitution_of(m_i, m_j, v, 0.0, swapped, e, ext_i, 0.0) - e) > 0.1
    close(restitution_of(m_i, m_j, v, 0.0, right, e, ext_i, 0.0), e)
    # with equal masses, or without forces, nobody would notice
    close(contact.pair_normal_impulse(m_i, m_i, v, 0.0, e, ext_i, 0.0), 1.5 * 0.5 * (m_i * v + ext_i))


def test_the_head_on_impulse_in_numbers():
    # m* = 0.75 kg, approach 4 m/s, e = 0.5
    assert contact.pair_normal_impulse(1.0, 3.0, 3.0, -1.0, 0.5) == 4.5


@repeatable
@given(masses, masses, st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), unit, forces, forces)
def test_newtons_third_law_holds_under_exchange_of_the_particles(m_i, m_j, v_i, v_j, e, push_i, push_j):
    ext_i, ext_j = push_i * m_i, push_j * m_j
    one = contact.pair_normal_impulse(m_i, m_j, v_i, v_j, e, ext_i, ext_j)
    other = contact.pair_normal_impulse(m_j, m_i, -v_j, -v_i, e, -ext_j, -ext_i)
    close(one, other, scale=10.0 * min(m_i, m_j))


@repeatable
@given(masses, masses, speeds, unit, st.floats(-100.0, 100.0))
def test_the_impulse_is_galilean_invariant(m_i, m_j, speed, e, drift):
    moving = contact.pair_normal_impulse(m_i, m_j, drift + speed, drift, e)
    close(moving, contact.pair_normal_impulse(m_i, m_j, speed, 0.0, e), scale=200.0 * min(m_i, m_j))


@repeatable
@given(masses, masses, speeds, unit, st.floats(1e-3, 1e3))
def test_the_impulse_scales_with_mass_and_with_speed(m_i, m_j, speed, e, factor):
    impulse = contact.pair_normal_impulse(m_i, m_j, speed, 0.0, e)
    close(contact.pair_normal_impulse(factor * m_i, factor * m_j, speed, 0.0, e), factor * impulse)
    close(contact.pair_normal_impulse(m_i, m_j, factor * speed, 0.0, e), factor * impulse)


def test_a_contact_never_pulls():
    assert contact.pair_normal_impulse(1.0, 2.0, -1.0, 0.0, 0.5) == 0.0
    assert contact.pair_normal_impulse(1.0, 2.0, 1.0, 0.0, 0.5, -5.0, 0.0) == 0.0
    assert contact.surface_normal_impulse(1.0, 1.0, 0.5) == 0.0
    assert contact.surface_normal_impulse(1.0, -1.0, 0.5, 5.0) == 0.0


def test_impulses_broadcast():
    mass = np.array([[1.0], [2.0]])
    v = np.array([1.0, 2.0, -1.0])
    got = contact.pair_normal_impulse(mass, mass, v, 0.0, 1.0)
    close(got, [[1.0, 2.0, 0.0], [2.0, 4.0, 0.0]])
    close(contact.surface_normal_impulse(mass, -v, 1.0), 2 * got)
    slips = np.array([[1.0, 0, 0], [0, 0, 0], [0, 30.0, 40.0]])
    friction = contact.pair_friction_impulse(2.0, 2.0, slips, np.array([10.0, 10.0, 1.0]), 0.3, 0.2)
    close(friction, [[1.0, 0, 0], [0, 0, 0], [0, 0.12, 0.16]])


def collide(m_i, m_j, v_i, v_j, n, e, mu_s, mu_d):
    """Velocities after a collision, assembled from the model's impulses."""
    normal = contact.pair_normal_impulse(m_i, m_j, v_i @ n, v_j @ n, e)
    slip = v_j - v_i - ((v_j - v_i) @ n) * n
    friction = contact.pair_friction_impulse(m_i, m_j, slip, normal, mu_s, mu_d)
    change = friction - normal * n
    return v_i + change / m_i, v_j - change / m_j, normal, friction


@repeatable
@given(masses, masses, vectors, vectors, directions, speeds, unit, unit, unit)
def test_the_collision_is_that_of_the_centre_of_mass(m_i, m_j, v_i, v_j, n, speed, e, mu_s, part):
    v_j = v_j + ((v_i - v_j) @ n - speed) * n
    hit = exact.pair_collision(m_i, m_j, v_i, v_j, n, e, mu_s, part * mu_s)
    after_i, after_j, normal, friction = collide(m_i, m_j, v_i, v_j, n, e, mu_s, part * mu_s)
    scale = 1.0 + speed
    momentum = scale * min(m_i, m_j)
    close(normal, hit.normal_impulse, scale=momentum)
    close(friction, hit.friction_impulse, scale=momentum)
    # the heavier of the two divides the impulse's round-off; the lighter, with it, sets the scale
    close(after_i, hit.velocity_i, scale=scale)
    close(after_j, hit.velocity_j, scale=scale)


def energy_lost(m_i, m_j, v_i, v_j, after_i, after_j):
    return 0.5 * (m_i * (v_i @ v_i - after_i @ after_i) + m_j * (v_j @ v_j - after_j @ after_j))


@repeatable
@given(masses, masses, speeds, unit)
def test_a_head_on_bounce_loses_its_share_of_the_relative_energy(m_i, m_j, speed, e):
    v_i, v_j = speed * UP, np.zeros(3)
    after_i, after_j, _, _ = collide(m_i, m_j, v_i, v_j, UP, e, 0.0, 0.0)
    relative = 0.5 * speed**2 / (1 / m_i + 1 / m_j)
    lost = energy_lost(m_i, m_j, v_i, v_j, after_i, after_j)
    close(lost, (1 - e**2) * relative, scale=0.5 * (m_i + m_j) * speed**2)


@repeatable
@given(masses, masses, vectors, directions, speeds, unit, unit, unit)
def test_friction_never_creates_energy_or_reverses_the_slip(m_i, m_j, v_j, n, speed, e, mu_s, part):
    v_j = v_j - (v_j @ n + speed) * n
    after_i, after_j, normal, friction = collide(m_i, m_j, np.zeros(3), v_j, n, e, mu_s, part * mu_s)
    assert energy_lost(m_i, m_j, np.zeros(3), v_j, after_i, after_j) >= -ROUND * m_j * v_j @ v_j
    slip, left = v_j - (v_j @ n) * n, after_j - after_i
    assert left @ slip >= -ROUND * (slip @ slip + speed**2)
    assert np.linalg.norm(friction) <= mu_s * normal * (1 + ROUND)


@pytest.mark.parametrize("side, sticks", [(1 - 1e-9, True), (1 + 1e-9, False)])
def test_particles_stick_up_to_the_slip_that_static_friction_can_stop(side, sticks):
    e, mu_s, mu_d, v_n = 0.5, 0.3, 0.2, 2.0
    v_t = side * mu_s * (1 + e) * v_n
    v_j = np.array([v_t, 0.0, -v_n])
    after_i, after_j, _, _ = collide(1e-15, 3e-15, np.zeros(3), v_j, UP, e, mu_s, mu_d)
    left = 0.0 if sticks else v_t - mu_d * (1 + e) * v_n
    close((after_j - after_i)[0], left, scale=v_t)


def test_the_slip_that_just_sticks_is_included():
    # m* = 1, mu_s J = 2: both exact in binary
    assert contact.pair_friction_impulse(2.0, 2.0, [2.0, 0, 0], 4.0, 0.5, 0.25)[0] == 2.0
    assert contact.pair_friction_impulse(2.0, 2.0, [2.000001, 0, 0], 4.0, 0.5, 0.25)[0] == 1.0


def test_without_slip_there_is_no_friction():
    assert np.all(contact.pair_friction_impulse(1.0, 2.0, [0.0, 0.0, 0.0], 3.0, 0.3, 0.2) == 0.0)
    assert np.all(contact.pair_friction_impulse(1.0, 2.0, [0.0, 0.0, 0.0], 0.0, 0.0, 0.0) == 0.0)
    assert np.all(contact.pair_friction_impulse(1.0, 2.0, [1.0, 0.0, 0.0], 0.0, 0.3, 0.2) == 0.0)


@repeatable
@given(masses, masses, vectors, unit, directions)
def test_friction_turns_with_the_slip(m_i, m_j, slip, mu, axis):
    turn = Rotation.from_rotvec(2.0 * axis)
    normal = 0.5 * m_i
    one = contact.pair_friction_impulse(m_i, m_j, turn.apply(slip), normal, mu, mu)
    other = turn.apply(contact.pair_friction_impulse(m_i, m_j, slip, normal, mu, mu))
    close(one, other, scale=normal)


def test_a_tangential_force_shifts_the_slip_to_be_cancelled():
    m_i, m_j, duration = 1.0, 3.0, 0.5
    v_i, v_j, force_i, force_j = 1.0, 0.0, 4.0, 6.0
    w = (v_j - v_i) - (force_i / m_i - force_j / m_j) * duration
    friction = contact.pair_friction_impulse(m_i, m_j, [w, 0, 0], 1e9, 0.3, 0.3)[0]
    after_i = v_i + (force_i * duration + friction) / m_i
    after_j = v_j + (force_j * duration - friction) / m_j
    close(after_i, after_j)
    ignored = contact.pair_friction_impulse(m_i, m_j, [v_j - v_i, 0, 0], 1e9, 0.3, 0.3)[0]
    assert abs(ignored - friction) > 0.1


@repeatable
@given(masses, speeds, unit, unit, forces)
def test_the_surface_gives_the_impulse_of_both_phases(m, speed, e, gain, push):
    duration = 1e-9
    force = push * m * speed / duration
    hit = exact.wall_impact(m, -speed * UP, UP, e, gain * m, force, duration)
    ext = force * duration / (1 + e)
    close(contact.surface_normal_impulse(m, -speed, e, ext), hit.normal_impulse)
    close(contact.mean_load(m, -speed, e, force, duration), hit.load)
    after = contact.surface_normal_velocity(m, gain * m, -speed, e, ext, e * ext)
    close(after, hit.velocity[2], scale=speed)
    # momentum in, impulse and force, momentum out
    close((1 + gain) * m * after, -m * speed + hit.normal_impulse + force * duration, scale=m * speed)
    close(after, e * speed / (1 + gain), scale=speed)  # a constant force drops out


@repeatable
@given(masses, speeds, unit, unit)
def test_kinetic_energy_left_by_a_normal_impact(m, speed, e, gain):
    after = contact.surface_normal_velocity(m, gain * m, -speed, e)
    ratio = (1 + gain) * m * after**2 / (m * speed**2)
    close(ratio, e**2 / (1 + gain), scale=1.0)


def test_mass_picked_up_slows_the_rebound_and_leaves_the_impulse():
    # 1 kg at 3 m/s, e = 0.5: 1.5 N s come back, to be shared by 1.5 kg
    assert contact.surface_normal_velocity(1.0, 0.5, -3.0, 0.5) == 1.0
    assert contact.surface_normal_velocity(1.0, 0.0, -3.0, 0.5) == 1.5
    assert contact.surface_normal_impulse(1.0, -3.0, 0.5) == 4.5


def test_a_resting_contact_returns_the_force_that_presses():
    duration, force = 2e-9, -3e-8
    ext = force * duration / 1.5
    close(contact.surface_normal_impulse(1e-15, 0.0, 0.5, ext), -force * duration)
    close(contact.mean_load(1e-15, 0.0, 0.5, force, duration), -force)
    # the twin: all of the force in compression returns (1 + e) times too much
    assert contact.surface_normal_impulse(1e-15, 0.0, 0.5, force * duration) > 1.4 * -force * duration


def test_the_compression_impulse_is_capped_at_the_step_and_the_load_is_not():
    assert contact.compression_impulse(3.0, 1.0, 0.5, 0.5) == 1.0
    assert contact.compression_impulse(3.0, 1.0, 2.0, 0.5) == 2.0
    close(contact.mean_load(1.0, -1.0, 0.5, -3.0, 1.0), 1.5 + 3.0)


@repeatable
@given(masses, st.floats(1e-8, 1e-4), st.floats(1e8, 1e12), speeds)
def test_the_duration_is_that_of_hertz(m, radius, modulus, speed):
    duration = contact.impact_duration(m, radius, modulus, speed)
    close(duration, exact.hertz_duration(m, radius, modulus, speed))
    # 2.87 is the integral's 2.868 rounded: half a unit of the last digit is 0.17 %
    close(duration, exact.hertz_integral(m, radius, modulus, speed), rtol=0.0017)
    close(contact.impact_duration(m, radius, modulus, 32 * speed), duration / 2)


def test_two_bodies_yield_like_springs_in_series():
    close(contact.effective_modulus(6.0, 3.0), 2.0)
    close(contact.effective_modulus(1e11, 1e11), 0.5e11)
    close(contact.effective_modulus(1e30, 7.0), 7.0)
    # alumina on copper: 1/E* = (1 - 0.22^2)/370 + (1 - 0.34^2)/120 per GPa
    compliance = (1 - 0.0484) / 370 + (1 - 0.1156) / 120
    close(contact.effective_modulus(370 / (1 - 0.0484), 120 / (1 - 0.1156)), 1 / compliance)
