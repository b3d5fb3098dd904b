"""Laws of timestep.py: implicit Euler, the fixed point and its ratio, the adaptive step, frozen contacts.

Runs of whole cases are in `test_simulation.py`; here the kernel is called on arrays.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import close

from reference import exact, state
from reference import ledger as col
from reference.collisions import empty_work
from reference.neighbors import neighbor_pairs
from reference.schemes import Numerics, collide, iterate_fixed_point, step_factor
from reference.state import DEPOSIT_NONE, DEPOSIT_VOLUME, FLOW_COUETTE, FLOW_NONE, FLOW_UNIFORM, Model
from reference.timestep import DONE, MAX_SHRINK, MIN_SHRINK, STEP_VANISHED, P, advance, new_progress, wrap

pytestmark = pytest.mark.nojit
D, DENSITY, VISCOSITY = 9e-7, 3950.0, 1e-3  # alumina of 0.9 um in a fluid as viscous as water
MASS = DENSITY * np.pi * D**3 / 6
TAU = exact.stokes_time(MASS, D, VISCOSITY)  # 177.75 ns
BOX, TOL = 1e-5, 1e-6
FALL = np.array([5e-6, 5e-6, 5e-6]), np.array([0.3, -0.1, 0.2])  # position and velocity to start from
BY_SCHEME = pytest.mark.parametrize("fixed_point", [False, True], ids=["point_implicit", "fixed_point"])


def model(**changes):
    """A box without flow, periodic along x and y; soft copper below, if anything."""
    fields = dict.fromkeys(Model._fields, 0.0)
    fields |= {"length_x": BOX, "length_y": BOX, "restitution": 0.5, "viscosity": VISCOSITY}
    fields |= {"surface_modulus": 1.36e11, "surface_density": 8960.0, "poisson_ratio": 0.34}
    fields |= {"yield_stress": 8.2e6, "acceleration": 1.0, "spacing": BOX / 4}
    fields |= {"flow": FLOW_NONE, "deposit": DEPOSIT_NONE}
    fields |= {"has_surface": False, "mass_pickup": True, "has_pad": False, "has_pairs": True}
    return Model(**(fields | changes))


def stokes(u=(0.0, 0.0, 0.0), **changes):
    """A uniform flow u of so thin a fluid that its drag is Stokes's at any speed."""
    u_x, u_y, u_z = map(float, u)
    return model(flow=FLOW_UNIFORM, fluid_density=1e-9, flow_x=u_x, flow_y=u_y, flow_z=u_z, **changes)


class Particles:
    """Arrays that `advance` moves, and its scalars."""

    def __init__(self, position, velocity, heights=None):
        self.position = np.array(position, dtype=float, ndmin=2)
        self.velocity = np.array(velocity, dtype=float, ndmin=2)
        n = len(self.position)
        self.mass, self.diameter, self.modulus = np.full(n, MASS), np.full(n, D), np.full(n, 3.89e11)
        self.heights = np.zeros((0, 0)) if heights is None else heights
        self.rows, self.scalars = col.empty_ledger(1000), new_progress()

    def advance(self, model, duration, time_step, fixed_point=False, first_step=None, **options):
        """Advance by `duration` in steps of at most `time_step`; return the status."""
        part = {"tolerance": TOL, "iterations": 8, "printed_norm": False, "iterated_contacts": False}
        part["ledger_speed"] = 0.0
        numerics = Numerics(time_step=time_step, fixed_point=fixed_point, **(part | options))
        self.scalars[P.step] = self.scalars[P.step] or first_step or time_step
        t_end, steps = self.scalars[P.time] + duration, max(1, round(duration / time_step))
        return advance(model, numerics, self.scalars, t_end, steps, self.arrays, self.heights, self.rows)

    @property
    def arrays(self):
        return state.Particles(self.position, self.velocity, self.mass, self.diameter, self.modulus)

    def work(self, dt):
        """What a step fills, as the paper's iteration finds it: r^0 = r + dt v."""
        work = empty_work(len(self.mass))
        work.velocity[:], work.trial[:] = self.velocity, self.position + dt * self.velocity
        return work

    @property
    def contacts(self):
        return self.rows[: int(self.scalars[P.rows])]


@BY_SCHEME
@pytest.mark.parametrize("ratio, steps", [(0.02, 50), (0.1, 7)])
def test_stokes_drag_is_implicit_euler_to_rounding(fixed_point, ratio, steps):
    """Factor (1 + dt/tau)^-n; the fixed point is asked for 1e-15 and so stops within round-off of it."""
    u, one = np.array([0.05, 0.0, -0.02]), Particles(*FALL)
    options = {"tolerance": 1e-15, "iterations": 40} if fixed_point else {}
    status = one.advance(stokes(u), steps * ratio * TAU, ratio * TAU, fixed_point, **options)
    assert status == DONE
    assert one.scalars[P.steps] == steps
    close(one.velocity[0], exact.implicit_euler_speed(steps, FALL[1], u, ratio * TAU, TAU), scale=0.3)
    # the twin: explicit Euler, (1 - dt/tau)^n, is told apart
    assert np.abs(u + (FALL[1] - u) * (1 - ratio) ** steps - one.velocity[0]).max() > 1e-4


@BY_SCHEME
def test_a_call_without_a_step_changes_nothing(fixed_point):
    """So that a run may be interrupted and gone on with anywhere."""
    one = Particles(*FALL)
    one.advance(stokes(), 3 * TAU, TAU / 10, fixed_point)
    before = one.scalars.copy(), one.position.copy(), one.velocity.copy()
    numerics = Numerics(TAU / 10, fixed_point, TOL, 8, False, False, 0.0)
    now = one.scalars[P.time]
    assert advance(stokes(), numerics, one.scalars, now, 0, one.arrays, one.heights, one.rows) == DONE
    for old, new in zip(before, (one.scalars, one.position, one.velocity), strict=True):
        assert np.array_equal(old, new)


@BY_SCHEME
def test_the_error_is_of_first_order_in_the_step(fixed_point):
    end = exact.stokes_motion([TAU], *FALL, np.zeros(3), TAU)
    errors = []
    for steps in (32, 64, 128):
        one = Particles(*FALL)
        one.advance(stokes(), TAU, TAU / steps, fixed_point, tolerance=1e-12, iterations=30)
        errors.append([one.velocity[0] - end.velocities[0], one.position[0] - end.positions[0]])
    # (1 + h)^(-1/h) = exp(-1) (1 + h/2 - 5 h^2/24 ...): the ratio of errors departs from 2 by about h/2
    np.testing.assert_allclose(np.divide(errors[0], errors[1]), 2.0, rtol=1 / 32, atol=0)
    np.testing.assert_allclose(np.divide(errors[1], errors[2]), 2.0, rtol=1 / 64, atol=0)


def sweep(ratio, sweeps):
    """Changes of r in sweeps of the paper's iteration with dt = ratio tau, and their relative sizes."""
    dt, one = ratio * TAU, Particles(*FALL)
    work, changes, errors = one.work(dt), [], []
    for _ in range(sweeps):
        before = work.trial.copy()
        change, move, _ = iterate_fixed_point(stokes(), dt, np.nan, one.arrays, work)
        changes.append(work.trial[0] - before[0])
        errors.append(change / move)
    return np.array(changes), errors


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.9, 5.0])
def test_the_fixed_point_contracts_by_minus_dt_over_tau(ratio):
    changes, _ = sweep(ratio, 5)
    expected = exact.fixed_point_ratio(ratio * TAU, TAU) * changes[:-1]
    # differences of positions of 5e-6 m, whose unit in the last place is 8e-22 m, grown by the ratio
    np.testing.assert_allclose(changes[1:], expected, rtol=1e-12, atol=4e-21 * (1 + ratio))
    assert np.all(np.abs(changes[4]) < np.abs(changes[0])) == (ratio < 1)  # beyond tau it diverges


@pytest.mark.parametrize("ratio", [1.5, 20.0, 1000.0])
def test_point_implicit_is_stable_beyond_the_relaxation_time(ratio):
    one = Particles(*FALL)
    assert one.advance(stokes(), 3 * ratio * TAU, ratio * TAU) == DONE
    close(one.velocity[0], FALL[1] / (1 + ratio) ** 3)


def test_the_schemes_agree_where_both_converge():
    """Each step of the fixed point errs by up to TOL dt/tau/(1 - dt/tau) of its speed; 40 steps add up."""
    one, other = Particles(*FALL), Particles(*FALL)
    one.advance(stokes(), 4 * TAU, TAU / 10)
    other.advance(stokes(), 4 * TAU, TAU / 10, True)
    assert other.scalars[P.steps] == one.scalars[P.steps] == 40
    np.testing.assert_allclose(other.velocity, one.velocity, rtol=0, atol=40 * TOL * 0.1 / 0.9 * 0.3)
    assert not np.array_equal(other.velocity, one.velocity)  # they do not share their arithmetic


def restarts(ratio):
    """dt/tau of the first accepted step and the number of restarts, by Eqs (42) and (43) from `ratio` on."""
    for rejected in range(50):
        _, errors = sweep(ratio, 8)
        if min(errors) <= TOL:
            return ratio, rejected
        ratio *= min(max(step_factor(errors[-1], errors[0], 8, TOL, 8), MIN_SHRINK), MAX_SHRINK)
    raise AssertionError("no step was accepted")


@pytest.mark.parametrize("ratio", [0.5, 1.5, 5.0, 50.0])
def test_a_rejected_step_leaves_no_trace(ratio):
    """Begun with a step that is too long, or with the one that the restarts come down to: the same run."""
    first, rejected = restarts(ratio)
    one, other = Particles(*FALL), Particles(*FALL)
    for particles, step in (one, ratio * TAU), (other, first * TAU):
        assert particles.advance(stokes(), 50 * TAU, ratio * TAU, True, first_step=step) == DONE
    assert rejected >= 1
    assert one.scalars[P.rejected] - other.scalars[P.rejected] == rejected
    assert one.scalars[P.steps] == other.scalars[P.steps]
    # the first step differs by the rounding of its length, 1e-15, which 50 tau of relaxation do not amplify
    np.testing.assert_allclose(one.position, other.position, rtol=1e-12, atol=0)
    assert first < 0.2  # (dt/tau)^8 = 1e-6 at 0.178


@given(st.floats(-4.0, 0.0), st.floats(-3.0, 1.0), st.integers(2, 12), st.integers(2, 12))
def test_phi_leads_to_the_tolerance_in_the_wanted_number_of_iterations(first, ratio, k, wanted):
    """Increments e_1 q^(k-1) with q ~ dt: after Phi they are e_1 (Phi q)^(k_d-1) = TOL."""
    first_error, q = 10.0**first, 10.0**ratio
    phi = step_factor(first_error * q ** (k - 1), first_error, k, TOL, wanted)
    close(first_error * (phi * q) ** (wanted - 1), TOL, rtol=1e-10)  # powers up to 11 of rounded roots


def test_phi_as_printed_misses_the_tolerance():
    """The twin: exponents 1/k_d and 1/k take the increment eps_1 for the error e^0."""
    first_error, q = 0.5, 2.0
    printed = (TOL / first_error) ** (1 / 8) / (q**7) ** (1 / 8)
    assert first_error * (printed * q) ** 7 > 5 * TOL
    close(first_error * (step_factor(first_error * q**7, first_error, 8, TOL, 8) * q) ** 7, TOL, rtol=1e-10)


def test_phi_is_infinite_where_nothing_changed():
    assert step_factor(0.0, 0.0, 1, TOL, 8) == np.inf
    assert step_factor(0.0, 1e-3, 3, TOL, 8) == np.inf


@pytest.mark.parametrize("ratio", [0.3, 0.5, 0.9])
def test_a_step_predicted_by_phi_converges_as_predicted(ratio):
    """At dt eight sweeps do not converge; at Phi dt they do, in not much less; at 2 Phi dt they do not."""
    _, before = sweep(ratio, 8)
    phi = step_factor(before[-1], before[0], 8, TOL, 8)
    _, after = sweep(phi * ratio, 8)
    _, beyond = sweep(2 * phi * ratio, 8)
    assert before[-1] > TOL
    assert after[-1] <= TOL < after[-3]  # eps_1 falls with dt as well, which Eq (43) leaves aside
    assert beyond[-1] > TOL


def test_time_advances_by_the_step_just_used():
    """A particle that moves with the fluid measures the time while another one forces restarts."""
    u = 0.2
    two = Particles([(1e-6, 2e-6, 2e-6), (1e-6, 6e-6, 6e-6)], [(u, 0, 0), (0.1, 0.4, -0.2)])
    open_box = stokes((u, 0, 0), length_x=0.0, length_y=0.0)
    two.advance(open_box, 3.3 * TAU, 5 * TAU, True)
    two.advance(open_box, 2.7 * TAU, 5 * TAU, True)
    assert two.scalars[P.rejected] >= 2  # the sums of rejected and of next steps are something else
    close(two.position[0, 0] - 1e-6, u * two.scalars[P.time], rtol=1e-11)  # some 100 additions
    close(two.scalars[P.time], 6 * TAU, rtol=1e-8)  # an interval ends within 1e-9 of the largest step


def test_the_step_grows_back_by_doubling_to_its_limit_and_no_further():
    one = Particles(*FALL)
    one.advance(stokes(), 3 * TAU, TAU / 50, True, first_step=TAU / 5000)
    close(one.scalars[P.step], TAU / 50)
    # 1, 2, ..., 64 of TAU/5000 in seven steps; 14873 of 15000 are left for steps of 100, and a rest
    assert one.scalars[P.steps] == 7 + 148 + 1


def test_a_step_cut_short_by_the_end_of_an_interval_is_taken_up_again():
    one = Particles(*FALL)
    for _ in range(10):
        one.advance(stokes(), 2.1 * TAU / 50, TAU / 50, True)
    assert one.scalars[P.steps] == 10 * 3


@pytest.mark.parametrize("printed", [False, True], ids=["displacement", "printed"])
def test_the_printed_norm_accepts_what_the_displacement_norm_rejects(printed):
    """Far from the origin sum |r| hides any velocity: with dt = 5 tau each step multiplies it by -4."""
    far, open_box = Particles((100.0, 50.0, 50.0), (0.1, 0.05, -0.1)), stokes(length_x=0.0, length_y=0.0)
    assert far.advance(open_box, 20 * TAU, 5 * TAU, True, printed_norm=printed) == DONE
    speed = np.linalg.norm(far.velocity)
    assert (far.scalars[P.rejected] == 0) == printed
    if printed:
        close(speed, 0.15 * 4.0**4, rtol=1e-9)  # 38 m/s out of 15 cm/s, in a fluid at rest
    else:
        assert speed < 0.15 * (1 + 5.0) ** -4  # what implicit Euler keeps in its four longest steps


def test_the_printed_norm_depends_on_the_origin():
    rejected = []
    for shift in (0.0, 100.0):
        one = Particles(FALL[0] + shift, FALL[1])
        one.advance(stokes(length_x=0.0, length_y=0.0), 5 * TAU, 5 * TAU, True, printed_norm=True)
        rejected.append(one.scalars[P.rejected])
    assert rejected[0] > 0
    assert rejected[1] == 0


def head_on(gap):
    """Two spheres about to meet, at 1 m/s."""
    return Particles([(4e-6, 5e-6, 5e-6), (4e-6 + D + gap, 5e-6, 5e-6)], [(0.5, 0, 0), (-0.5, 0, 0)])


@pytest.mark.parametrize("iterated", [False, True], ids=["frozen", "iterated"])
def test_frozen_contacts_need_no_restart_and_iterated_ones_do(iterated):
    pair = head_on(3.3e-9)
    assert pair.advance(stokes(), 10e-9, 1e-9, True, iterated_contacts=iterated) == DONE
    assert len(pair.contacts) == 1
    assert (pair.scalars[P.rejected] == 0) == (not iterated)
    assert (pair.scalars[P.steps] == 10) == (not iterated)


def test_contacts_at_the_iterate_form_a_two_cycle():
    """Overlap, bounce, no overlap, no bounce, overlap, ...: the iterate never settles."""
    dt, pair, fluid = 1e-9, head_on(0.3e-9), stokes()
    pairs = neighbor_pairs(pair.position, 2 * D, np.array([BOX, BOX, 0.0]))
    work, found, changes = pair.work(dt), [], []
    for _ in range(12):
        moved = pair.arrays._replace(position=work.trial)
        found.append(collide(fluid, dt, 0.0, np.nan, pairs, moved, pair.heights, work, pair.rows, 0))
        changes.append(iterate_fixed_point(fluid, dt, np.nan, pair.arrays, work)[0])
    assert found == [1, 0] * 6
    # (1+e) v dt for each of two, for ever; the drag, dt/tau, of a velocity that turns from -e v to v
    np.testing.assert_allclose(changes[1:], 2 * 1.5 * 0.5 * dt, rtol=3 * dt / TAU, atol=0)


def on_the_floor(velocity, restitution=0.5, **changes):
    """A particle that touches the floor, and a flow of 0.5 m/s that presses it there."""
    one = Particles((3e-6, 4e-6, D / 2 * (1 - 1e-9)), (0.0, 0.0, velocity), heights=np.zeros((4, 4)))
    return one, stokes((0, 0, -0.5), has_surface=True, restitution=restitution, **changes)


@BY_SCHEME
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.5, 1.0])
def test_a_resting_contact_returns_exactly_minus_the_force(fixed_point, restitution):
    """With delta t_1 = delta t/(1+e), J = -E dt - (1+e) m v, and here v is 1e-14 m/s."""
    dt, force = 1e-9, -0.5 * MASS / TAU
    one, floor = on_the_floor(-1e-14, restitution)
    one.advance(floor, dt, dt, fixed_point)
    (contact,) = one.contacts
    assert contact[col.DURATION] > dt
    rest = 2 * MASS * 1e-14
    np.testing.assert_allclose(contact[col.NORMAL_IMPULSE], -force * dt, rtol=1e-12, atol=rest)
    assert abs(one.velocity[0, 2]) <= 0.5 * dt / TAU * TOL  # at rest, but for the fixed point's tolerance
    # the twin: compression over half of the contact gives (1+e)/2 of the force, right at e = 1 only
    half = -(1 + restitution) / 2 * force * dt
    assert (abs(half - contact[col.NORMAL_IMPULSE]) < rest) == (restitution == 1.0)


def test_a_constant_force_drops_out_of_the_rebound():
    """m v' = -e m v + dt k (v - v'), h = dt k/m: of the drag only its change during the step is left."""
    (one, floor), dt = on_the_floor(-0.05), 1e-11
    one.advance(floor, dt, dt)
    h = dt / TAU
    assert one.contacts[0, col.DURATION] > dt
    close(one.velocity[0, 2], (0.5 * 0.05 - h * 0.05) / (1 + h))
    assert abs(one.velocity[0, 2] / 0.025 - 1) < 4 * h < abs(0.5 * h / 0.025)  # h u would be seen


@BY_SCHEME
def test_the_mass_picked_up_shares_the_momentum(fixed_point):
    one, _ = on_the_floor(-1.0)
    one.velocity[0, 0] = 0.4
    floor = model(has_surface=True, deposit=DEPOSIT_VOLUME)
    one.advance(floor, 1e-9, 1e-9, fixed_point)
    gained = one.contacts[0, col.REMOVED_MASS]
    assert gained > 1e-4 * MASS
    close(one.velocity[0], np.array([0.4, 0.0, 0.5]) * MASS / (MASS + gained))


@pytest.mark.parametrize("too_long", [False, True])
def test_removal_is_committed_once_and_for_the_accepted_step(too_long):
    """The first step, of the impact, is rejected until dt < tau; the material leaves, and joins, once."""
    one, floor = on_the_floor(-1.0, deposit=DEPOSIT_VOLUME, threshold_velocity=0.6)
    one.advance(floor, TAU, 5 * TAU if too_long else TAU / 100, True)
    assert (one.scalars[P.rejected] > 0) == too_long
    removed = one.contacts[one.contacts[:, col.REMOVED_VOLUME] > 0]
    assert removed[:, col.TIME].tolist() == [0.0]
    assert removed[0, col.REMOVED_MASS] > 1e-4 * MASS
    close(-one.heights.sum() * floor.spacing**2, removed[0, col.REMOVED_VOLUME])
    close(one.mass[0] - MASS, removed[0, col.REMOVED_MASS], scale=MASS)


@pytest.mark.filterwarnings("ignore:overflow")  # with the JIT off, of the iterates
def test_a_step_that_vanishes_is_given_up():
    """No step longer than 1e-9 of the largest is short enough: the run stops instead of creeping."""
    one = Particles(*FALL)
    assert one.advance(stokes(), 1e11 * TAU, 1e11 * TAU, True) == STEP_VANISHED
    assert one.scalars[P.time] == one.scalars[P.steps] == 0


@pytest.mark.filterwarnings("ignore:overflow")
def test_the_particle_that_made_the_step_vanish_is_named():
    two = Particles([FALL[0], FALL[0] + 2e-6], [(0.0, 0.0, 0.0), FALL[1]])
    two.mass[0] *= 1e12  # so heavy that the flow does not move it
    assert two.advance(stokes(), 1e11 * TAU, 1e11 * TAU, True) == STEP_VANISHED
    assert two.scalars[P.culprit] == 1


def test_a_restart_of_iterated_contacts_sees_the_contact_again():
    """Without a flow the contact at the start of the step is all there is: its time is 0."""
    one, floor = on_the_floor(-1.0)
    one.position[0, 2] -= 0.2e-9
    one.advance(floor._replace(flow=FLOW_NONE), 5e-9, 1e-9, True, iterated_contacts=True)
    assert one.scalars[P.rejected] >= 1
    assert one.contacts[:, col.TIME].tolist() == [0.0]


@given(st.floats(-1e-4, 1e-4), st.sampled_from([1e-6, 8e-6, 0.3]))
def test_wrapping_shifts_by_whole_periods_into_the_box(x, period):
    inside = wrap(x, period)
    assert 0.0 <= inside < period
    turns = (x - inside) / period
    close(turns, round(turns), scale=200.0)
    assert wrap(x, 0.0) == x


def test_a_shear_layer_is_implicit_euler_in_both_directions():
    """Rising through u = V z/H: v_x' = (v_x + h u(z'))/(1 + h), h = dt/tau, with z' after the step."""
    layer = model(flow=FLOW_COUETTE, wall_speed=1.0, gap=BOX, fluid_density=1e-9)
    one, h = Particles((5e-6, 5e-6, 2e-6), (0.1, 0.0, 0.3)), 0.25
    one.advance(layer, 4 * h * TAU, h * TAU)
    z, v_x, v_z = 2e-6, 0.1, 0.3
    for _ in range(4):
        v_z /= 1 + h
        z += h * TAU * v_z
        v_x = (v_x + h * z / BOX) / (1 + h)
    # solved to TOL in steps; one more sweep, of -dt/tau z'/H, follows the last change
    np.testing.assert_allclose(one.velocity[0], [v_x, 0.0, v_z], rtol=4 * TOL, atol=0)
    close(one.position[0, 2], z, scale=BOX)
