"""The Python fix inside LAMMPS: surface contact in both forms, drag, removal, pairs, restarts, ranks."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from cmpcheck.engines.lammps_library import EngineError, available, open_lammps
from cmpcheck.fixes import python_driver
from cmpcheck.fixes.calibration import damping_ratio, spring
from cmpcheck.fixes.slurry import DEFINE_STATE, SlurryFix
from reference.state import DEPOSIT_NONE, DEPOSIT_VOLUME, FLOW_NONE, FLOW_UNIFORM, Model

pytestmark = pytest.mark.skipif(not available()[0], reason=available()[1])

EPS = np.finfo(float).eps
RADIUS, DENSITY = 0.5e-6, 3950.0
MASS = DENSITY * math.pi / 6.0 * (2.0 * RADIUS) ** 3
T_C = 1e-9  # s, duration of a soft contact
IMPACT_DURATION = 2e-9  # s, the model's delta t
NO_PAIRS = "pair_style zero 2.0\npair_coeff * *"


def make_model(**changes):
    """A flat box of 10 um, no fluid, no removal; soft material, so that removal weighs."""
    constants = {
        "length_x": 10e-6, "length_y": 10e-6, "length_z": 0.0, "restitution": 0.5, "static_friction": 0.0,
        "dynamic_friction": 0.0, "impact_duration": IMPACT_DURATION, "flow": FLOW_NONE,
        "fluid_density": 1000.0, "viscosity": 1e-3, "flow_x": 0.0, "flow_y": 0.0, "flow_z": 0.0,
        "wall_speed": 0.0, "gap": 1e-5,
        "has_surface": True, "spacing": 1e-6, "surface_modulus": 1e11, "surface_density": 8960.0,
        "poisson_ratio": 0.34, "yield_stress": 6e6, "deposit": DEPOSIT_NONE, "acceleration": 1.0,
        "mass_pickup": True, "threshold_velocity": 0.01, "has_pad": False, "pad_restitution": 0.5,
        "pad_descent": 0.0, "pad_minimum": 0.0,
    }  # fmt: skip
    return Model(**(constants | changes))


REMOVING = {"deposit": DEPOSIT_VOLUME}


def deck(positions, velocities, dt, pair=NO_PAIRS, state=DEFINE_STATE, commands="", check="yes"):
    """A LAMMPS deck with these spheres (um, um/us), without `run`; dt in s."""
    lines = ["units micro", "atom_style sphere 1", "atom_modify map array", "boundary p p f"]
    lines += ["processors * 1 1"]  # ranks meet at x = 5
    lines += ["region box block 0 10 0 10 -5 10", "create_box 1 box"]
    lines += [f"create_atoms 1 single {x!r} {y!r} {z!r}" for x, y, z in np.array(positions).tolist()]
    lines += [f"set type 1 diameter {2e6 * RADIUS} density {DENSITY * 1e-3}"]
    for i, (vx, vy, vz) in enumerate(np.array(velocities).tolist()):
        lines += [f"set atom {i + 1} vx {vx!r} vy {vy!r} vz {vz!r}"]
    lines += [pair, "neighbor 0.3 bin", f"neigh_modify every 1 delay 0 check {check}", commands]
    lines += ["fix integrate all nve", state, "fix slurry all external pf/callback 1 1"]
    lines += [f"timestep {dt * 1e6!r}", "thermo 1000000"]
    return "\n".join(lines)


def attach(lmp, n, model, heights=None, **options):
    heights = np.zeros((10, 10)) if heights is None else heights
    options = {"contact_duration": T_C, "case": "test"} | options
    fix = SlurryFix(lmp, "slurry", model, np.full(n, 3.9e11), heights, **options)
    fix.attach()
    return fix


def simulate(positions, velocities, dt, steps, model, runs=1, heights=None, deck_options=None, **options):
    """Run a deck with the fix; a list of steps gives as many `run` commands."""
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lmp.commands_string(deck(positions, velocities, dt, **(deck_options or {})))
    fix = attach(lmp, len(positions), model, heights, **options)
    for count in steps if isinstance(steps, list) else [steps]:
        lmp.command(f"run {count}")
        fix.check()
    return fix


def last_velocity(fix):
    return fix.trajectory()[2][-1]


def drop(dt, model, speed=1.0, **options):
    """16 particles fall on the surface at 16 sub-step phases; the contact is over after 4 t_c."""
    gap = speed * dt * 1e6 * (2.0 + (np.arange(16) + 0.5) / 16.0)
    positions = np.column_stack([0.3 + 0.6 * np.arange(16), np.full(16, 5.0), RADIUS * 1e6 + gap])
    steps = round(4 * T_C / dt)
    return simulate(positions, [(0.0, 0.0, -speed)] * 16, dt, steps, model, sample_every=steps, **options)


@pytest.mark.nojit
@pytest.mark.parametrize("restitution", [0.05, math.exp(-2.0), 0.2, 0.5, 0.8, 1.0])
def test_spring_and_dashpot_rebound_with_the_restitution_after_the_contact_duration(restitution):
    spring_t, damping_t = np.array(spring(restitution, T_C)) * [T_C**2, T_C]  # in units of t_c and v
    motion = np.array([[0.0, 1.0], [-spring_t, -damping_t]])

    def after(time):
        """Velocity, and force on unit mass, of a particle that meets the surface at time 0 with v = -1."""
        height, velocity = expm(motion * time) @ [0.0, -1.0]
        return velocity, -spring_t * height - damping_t * velocity

    velocity, force = after(1.0)
    # Sums of terms of at most damping_t or spring_t, with the rounding of a matrix exponential.
    scale = 100 * EPS * (1.0 + damping_t + spring_t)
    assert velocity == pytest.approx(restitution, rel=0.0, abs=scale)
    assert force == pytest.approx(0.0, rel=0.0, abs=scale * (damping_t + spring_t))
    assert all(after(time)[1] > 0.0 for time in np.linspace(0.01, 0.99, 99))


@pytest.mark.nojit
def test_a_soft_contact_cannot_have_restitution_zero():
    with pytest.raises(ValueError, match="restitution = 0"):
        damping_ratio(0.0)
    with pytest.raises(EngineError, match="restitution = 0"):
        attach(None, 1, make_model(restitution=0.0))


@pytest.mark.parametrize("restitution", [0.05, 0.2, 0.5, 0.8, 1.0])
def test_soft_restitution_converges_at_second_order_in_the_mean_over_phases(restitution):
    errors = []
    for steps_per_contact in (25, 50, 100):
        fix = drop(T_C / steps_per_contact, make_model(restitution=restitution), form="soft")
        rebound = last_velocity(fix)[:, 2]
        errors.append(abs(rebound.mean() - restitution))
        contacts = fix.contacts()
        assert len(contacts) == 16
        # One impulse is one change of momentum, and its work one change of energy: 200 additions each.
        np.testing.assert_allclose(contacts.normal_impulse, MASS * (rebound + 1.0), rtol=200 * EPS, atol=0.0)
        lost = 0.5 * MASS * (1.0 - rebound**2)
        np.testing.assert_allclose(contacts.energy_lost, lost, rtol=0.0, atol=200 * EPS * 0.5 * MASS)
        # Each begins and ends within a step; the mean over phases is better than half a step.
        assert abs(contacts.contact_time.mean() - T_C) < 0.5 * T_C / steps_per_contact
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    # The dashpot switches on between two steps: an error of first order whose mean over the phases is of
    # second.  Without a dashpot (e = 1) velocity Verlet on a spring is one order better in the mean.
    assert orders[-1] == pytest.approx(4.0 if restitution == 1.0 else 2.0, abs=0.1)


@pytest.mark.nojit
@pytest.mark.parametrize("restitution", [0.0, 0.2, 0.5, 1.0])
def test_impulsive_rebound_is_exact_without_drag(restitution):
    fix = drop(T_C / 10, make_model(restitution=restitution), form="impulse")
    contacts = fix.contacts()
    # v' = v + J/m through two unit conversions and two half steps: 12 roundings of at most eps/2.
    np.testing.assert_allclose(last_velocity(fix)[:, 2], restitution, rtol=0.0, atol=6 * EPS)
    np.testing.assert_allclose(contacts.normal_impulse, (1.0 + restitution) * MASS, rtol=8 * EPS, atol=0.0)
    lost = 0.5 * MASS * (1.0 - restitution**2)
    np.testing.assert_allclose(contacts.energy_lost, lost, rtol=0.0, atol=8 * EPS * MASS)


@pytest.mark.nojit
@pytest.mark.parametrize("compiled", [True, False])
def test_impacts_too_slow_for_a_row_push_as_those_that_have_one(compiled):
    model = make_model(flow=FLOW_UNIFORM, flow_x=0.5, flow_z=-0.2, fluid_density=1.0)
    positions, velocities, heights = scatter(1)
    loud, quiet = (
        simulate(
            positions, velocities, T_C / 5, 1000, model, heights=heights, form="impulse", sample_every=50,
            compiled=compiled, ledger_speed=speed,
        )
        for speed in (0.0, 10.0)
    )  # fmt: skip
    assert len(loud.contacts()) >= 16
    assert len(quiet.contacts()) == 0
    for a, b in zip(loud.trajectory(), quiet.trajectory(), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_a_contact_that_is_there_at_the_start_is_counted_for_the_half_step_that_it_acts(form):
    start = [(5.0, 5.0, 0.5 - 1e-4)]
    fix = simulate(start, [(0.0, 0.0, -1.0)], T_C / 20, 100, make_model(), form=form, sample_every=100)
    (impulse,), rebound = fix.contacts().normal_impulse, last_velocity(fix)[0, 2]
    assert impulse == pytest.approx(MASS * (rebound + 1.0), rel=100 * EPS, abs=0.0)
    if form == "impulse":
        assert rebound == pytest.approx(0.5, abs=6 * EPS)


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_an_impact_removes_the_cap_and_the_particle_carries_it(form):
    model = make_model(**REMOVING)
    vx, vz, dt = 0.7, -1.0, T_C / 20
    fix = simulate([(5.3, 5.1, 0.502)], [(vx, 0.0, vz)], dt, 120, model, form=form, sample_every=120)
    impact = fix.contacts().iloc[0]
    load = 1.5 * MASS / IMPACT_DURATION
    x_p = math.sqrt(math.sqrt(3.0) * load * 0.32 / (2.0 * math.pi * 6e6))
    depth = RADIUS - math.sqrt(RADIUS**2 - x_p**2)
    volume = math.pi * depth * (3.0 * x_p**2 + depth**2) / 6.0
    gained = 8960.0 * volume
    assert 1e-4 < gained / MASS < 1e-2  # enough to be seen
    # depth cancels R/depth = 20 digits-worth of eps; the rest is a dozen roundings.
    assert impact.load == pytest.approx(load, rel=20 * EPS, abs=0.0)
    assert impact.removed_volume == pytest.approx(volume, rel=200 * EPS, abs=0.0)
    mass = fix.trajectory()[3]
    assert mass[-1, 0] - mass[0, 0] == pytest.approx(gained, abs=4 * EPS * MASS)
    lost = -fix.heights.sum() * 1e-12  # of a surface that started at z = 0; three nodes
    assert lost == pytest.approx(volume, rel=200 * EPS, abs=0.0)
    assert lost * 8960.0 == pytest.approx(mass[-1, 0] - mass[0, 0], abs=4 * EPS * MASS)
    # (m + dm) v_t' = m v_t, exactly; the normal part has the form's own accuracy.
    velocity, m_after = last_velocity(fix)[0], MASS + gained
    assert m_after * velocity[0] == pytest.approx(MASS * vx, rel=10 * EPS, abs=0.0)
    assert m_after * velocity[2] + MASS == pytest.approx(impact.normal_impulse, rel=200 * EPS, abs=0.0)
    energy = 0.5 * MASS * (vx**2 + vz**2) - 0.5 * m_after * (velocity @ velocity)
    assert impact.energy_lost == pytest.approx(energy, abs=200 * EPS * MASS)


@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_slow_impacts_remove_nothing(form):
    fix = drop(T_C / 20, make_model(**REMOVING, threshold_velocity=1.0 + 1e-9), form=form)
    assert fix.contacts().removed_volume.max() == 0.0
    assert not fix.heights.any()


def test_drag_is_second_order_in_the_step():
    model = make_model(flow=FLOW_UNIFORM, flow_x=1.0, has_surface=False, fluid_density=1.0)
    tau = DENSITY * (2.0 * RADIUS) ** 2 / (18.0 * model.viscosity)
    errors = []
    for steps in (20, 40, 80):
        fix = simulate([(5.0, 5.0, 5.0)], [(0.0, 0.0, 1.0)], tau / steps, steps, model, sample_every=steps)
        errors.append(abs(last_velocity(fix)[0] - [1.0 - math.exp(-1.0), 0.0, math.exp(-1.0)]).max())
    # e^-h - (1 - h + h^2/2) = -h^3/6 per step, h = 1/steps: 1/6 h^2 e^-1 in all.
    assert errors[-1] == pytest.approx(math.exp(-1.0) / 6.0 / 80**2, rel=0.1, abs=0.0)
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(2.0, abs=0.1)


def test_a_particle_that_moves_with_the_fluid_keeps_its_velocity_to_the_bit():
    model = make_model(flow=FLOW_UNIFORM, flow_x=0.3, flow_y=-0.7, flow_z=0.1)
    fix = simulate([(5.0, 5.0, 5.0)], [(0.3, -0.7, 0.1)], 1e-9, 100, model, sample_every=100)
    assert last_velocity(fix)[0].tolist() == [0.3, -0.7, 0.1]


def test_positions_are_wrapped_even_where_lammps_has_not_done_so_yet():
    fix = simulate([(9.99, 0.01, 5.0)], [(1.0, -1.0, 0.0)], 1e-9, 50, make_model(), sample_every=50)
    # 50 additions in units of the box.
    np.testing.assert_allclose(
        fix.trajectory()[1][-1, 0], [0.04e-6, 9.96e-6, 5e-6], rtol=0.0, atol=50 * EPS * 10e-6
    )


def test_a_particle_pressed_on_the_surface_rests_in_the_impulse_form():
    model = make_model(flow=FLOW_UNIFORM, flow_z=-0.5, fluid_density=1.0, impact_duration=1e-7)
    tau = DENSITY * (2.0 * RADIUS) ** 2 / (18.0 * model.viscosity)
    dt = tau / 1000
    touching = [(5.0, 5.0, 0.5 - 1e-9)]
    fix = simulate(touching, [(0.0, 0.0, 0.0)], dt, 900, model, form="impulse", sample_every=1)
    # One step without contact gives u dt/tau; the impulse returns it times e < 1 and cancels E meanwhile.
    assert abs(fix.trajectory()[2][:, 0, 2]).max() < 2.0 * 0.5 * dt / tau


def scatter(seed, removing=True):
    """Positions and velocities of 16 particles about to hit the surface, and a bumpy surface."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(2.4 + 2.5 * np.arange(4), 1.25 + 2.5 * np.arange(4))
    z = 0.62 + 0.05 * rng.random(16)
    x, y = (x.ravel() + 0.3 * rng.random(16)) % 10.0, y.ravel() + 0.3 * rng.random(16)
    positions = np.column_stack([x, y, z])
    velocities = np.column_stack([3.0 * rng.standard_normal((16, 2)), -1.0 - rng.random(16)])
    return positions, velocities, 0.1e-6 * rng.random((10, 10))


def everything(fix):
    contacts = fix.contacts().drop(columns="kind").to_numpy(dtype=float)
    return [contacts, *fix.trajectory(), fix.heights]


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
@pytest.mark.parametrize("hertz", [False, True])
def test_compiled_and_plain_form_agree(form, hertz):
    changes = {"impact_duration": 0.0} if hertz else {}
    model = make_model(**REMOVING, **changes, flow=FLOW_UNIFORM, flow_x=0.5, flow_z=-0.2, fluid_density=1.0)
    positions, velocities, heights = scatter(1)
    forms = [
        simulate(
            positions,
            velocities,
            T_C / 5,
            1000,
            model,
            heights=heights,
            form=form,
            sample_every=50,
            compiled=compiled,
        )
        for compiled in (True, False)
    ]
    assert len(forms[0].contacts()) >= 16
    for compiled, plain in zip(everything(forms[0]), everything(forms[1]), strict=True):
        if hertz:  # a fifth root may differ in its last place, and impacts carry that on
            np.testing.assert_allclose(compiled, plain, rtol=1e-13, atol=1e-13 * np.abs(plain).max())
        else:
            np.testing.assert_array_equal(compiled, plain)


@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_run_after_run_accumulates_nothing_twice(form):
    positions, velocities, heights = scatter(2)
    model = make_model(**REMOVING, flow=FLOW_UNIFORM, flow_z=-0.2)
    options = {"heights": heights, "form": form, "sample_every": 100}
    once = simulate(positions, velocities, T_C / 10, 2000, model, **options)
    often = simulate(positions, velocities, T_C / 10, [1, 2, 597] + 100 * [4] + [1000], model, **options)
    for a, b in zip(everything(once), everything(often), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("how", ["displace_atoms all move 0 0 -2.1", "set group all diameter 5.2"])
def test_what_a_deck_does_between_runs_is_seen(how):
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lmp.commands_string(deck([(2.5, 5.0, 2.6), (7.5, 5.0, 2.6)], [(0.0, 0.0, -0.1)] * 2, T_C / 10))
    fix = attach(lmp, 2, make_model(), form="impulse")
    lmp.command("run 10")
    fix.check()
    assert len(fix.contacts()) == 0
    lmp.commands_string(how)
    lmp.command("run 20")
    fix.check()
    assert sorted(fix.contacts().i) == [0, 1]


def test_contacts_survive_a_restart(tmp_path):
    positions, velocities, heights = scatter(3)
    model, steps = make_model(**REMOVING, flow=FLOW_UNIFORM, flow_x=0.5, flow_z=-0.2), 2000
    whole = simulate(positions, velocities, T_C / 10, steps, model, heights=heights, sample_every=steps)
    contacts = whole.contacts()
    inside = int((contacts.time[7] + 0.5 * contacts.contact_time[7]) / (T_C / 10))  # in the middle of one
    first = simulate(positions, velocities, T_C / 10, inside, model, heights=heights)
    first.lmp.command(f"write_restart {tmp_path / 'state'}")
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    again = deck([], [], T_C / 10).splitlines()
    keep = [line for line in again if line.startswith(("fix", "pair", "neigh", "timestep", "thermo"))]
    lmp.commands_string("\n".join(["atom_modify map array", f"read_restart {tmp_path / 'state'}", *keep]))
    second = attach(lmp, 16, model, first.heights, sample_every=steps)
    lmp.command(f"run {steps - inside}")
    second.check()
    rows = np.concatenate([everything(first)[0], everything(second)[0]])
    np.testing.assert_array_equal(rows[np.lexsort((rows[:, 1], rows[:, 0]))], everything(whole)[0])
    np.testing.assert_array_equal(second.heights, whole.heights)
    np.testing.assert_array_equal(last_velocity(second), last_velocity(whole))


@pytest.mark.nojit
@pytest.mark.parametrize("compiled", [True, False])
def test_a_state_that_is_not_finite_stops_the_run_and_names_step_and_particle(compiled):
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lmp.commands_string(deck([(2.0, 5.0, 5.0), (7.0, 5.0, 5.0)], [(0.0, 0.0, 0.0)] * 2, 1e-9))
    fix = attach(lmp, 2, make_model(), compiled=compiled)
    lmp.command("run 10")
    fix.check()
    lmp.numpy.extract_atom("v")[1, 2] = np.nan
    lmp.command("run 10")
    with pytest.raises(EngineError, match=r"test: step 11, particle 1: .* not finite"):
        fix.check()
    assert lmp.extract_global("ntimestep") == 11  # it did not go on


@pytest.mark.parametrize("compiled", [True, False])
def test_a_full_ledger_stops_the_run(compiled):
    positions, velocities, heights = scatter(4)
    with pytest.raises(EngineError, match=r"test: step \d+, particle \d+: the contact ledger is full"):
        simulate(
            positions, velocities, T_C / 10, 2000, make_model(), heights=heights, max_contacts=3,
            compiled=compiled,
        )  # fmt: skip


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_a_particle_that_passes_through_the_surface_in_one_step_is_an_error(compiled, form):
    with pytest.raises(EngineError, match=r"particle 0: .* below the surface"):
        simulate([(5.0, 5.0, 1.0)], [(0.0, 0.0, -2.0)], 1e-6, 3, make_model(), form=form, compiled=compiled)


def test_an_exception_in_the_callback_surfaces(monkeypatch):
    def broken(*_arguments):
        raise ZeroDivisionError("broken on purpose")

    monkeypatch.setattr(python_driver.plain, "advance_particles", broken)
    with pytest.raises(EngineError, match="broken on purpose"):
        simulate([(5.0, 5.0, 5.0)], [(0.0, 0.0, 0.0)], 1e-9, 10, make_model(), compiled=False)


@pytest.mark.parametrize(
    "options, message",
    [({"state": ""}, "property/atom d2_cmpcheck"),
     ({"state": "fix cmpcheck_state all property/atom d2_cmpcheck 3 d2_cmpcheck_given 4"}, "d2_cmpcheck 49"),
     ({"state": "fix cmpcheck_state all property/atom d2_cmpcheck 49"}, "d2_cmpcheck_given 4"),
     ({"commands": "create_atoms 1 single 1 1 9"}, "3 atoms"),
     ({"commands": "group first id 1\ndelete_atoms group first compress no\ncreate_atoms 1 single 1 1 9"},
      "tags must be 1 ... 2")],
)  # fmt: skip
def test_a_deck_that_does_not_fit_is_refused(options, message):
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lmp.commands_string(deck([(2.0, 5.0, 5.0), (7.0, 5.0, 5.0)], [(0.0, 0.0, 0.0)] * 2, 1e-9, **options))
    with pytest.raises(EngineError, match=message):
        attach(lmp, 2, make_model())


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("sample_every", [0, 1])
def test_forces_are_added_once_at_the_first_step_and_at_later_ones(compiled, sample_every):
    """At step 0 LAMMPS adds as well: nothing.  With a trajectory the fix adds after a look at the others."""
    model = make_model(flow=FLOW_UNIFORM, flow_x=1.0, has_surface=False, fluid_density=1.0)
    stokes = 3.0 * math.pi * model.viscosity * 2.0 * RADIUS
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lmp.commands_string(deck([(5.0, 5.0, 5.0)], [(0.0, 0.0, 0.0)], 1e-12))
    fix = attach(lmp, 1, model, compiled=compiled, sample_every=sample_every)
    for command in ("run 0", "run 0", "run 1", "run 3 pre no"):
        lmp.command(command)
        fix.check()
        f, v = (lmp.numpy.extract_atom(name)[0] for name in ("f", "v"))
        slip = np.array([1.0, 0.0, 0.0]) - v
        # the velocity of half a step ago, and less: dt/tau of the slip
        np.testing.assert_allclose(f, stokes * slip * 1e9, rtol=1e-12 / (MASS / stokes), atol=0.0)


def test_the_fix_acts_on_all_atoms_or_is_refused():
    lmp = open_lammps(["-screen", "none", "-log", "none"])
    lines = deck([(2.0, 5.0, 5.0), (7.0, 5.0, 5.0)], [(0.0, 0.0, 0.0)] * 2, 1e-9)
    lmp.commands_string(lines.replace("fix slurry all", "group first id 1\nfix slurry first"))
    with pytest.raises(EngineError, match="the group first: the deck must use `fix slurry all external"):
        attach(lmp, 2, make_model())


GRANULAR = "comm_modify vel yes\npair_style granular\npair_coeff * * hooke {k} {e} tangential linear_nohistory 30 {mu} damping coeff_restitution"  # noqa: E501


def granular(restitution=0.5, friction=0.0):
    """LAMMPS's own contacts, of about T_C: k = m* (pi/t_c)^2."""
    stiffness = 0.5 * MASS * 1e15 * (math.pi / (T_C * 1e6)) ** 2
    return {"pair": GRANULAR.format(k=stiffness, e=restitution, mu=friction)}


@pytest.mark.parametrize("compiled", [True, False])
def test_a_native_contact_is_followed_with_its_impulse_and_energy(compiled):
    velocities = [(1.0, 0.3, 0.0), (-0.5, 0.0, 0.2)]
    fix = simulate(
        [(4.499, 5.0, 5.0), (5.501, 5.0, 5.0)], velocities, T_C / 100, 300, make_model(), sample_every=300,
        form="observe", observe_pairs=True, deck_options=granular(friction=0.4), compiled=compiled,
    )  # fmt: skip
    (contact,) = fix.contacts().itertuples()
    after, before = last_velocity(fix), np.array(velocities)
    momentum = MASS * (after[0] - before[0])
    assert (contact.kind, contact.i, contact.j) == ("pair", 0, 1)
    impulse = np.array([-contact.nx, -contact.ny, -contact.nz]) * contact.normal_impulse
    assert np.linalg.norm(momentum - impulse) == pytest.approx(contact.friction_impulse, rel=1e-9, abs=0.0)
    assert np.linalg.norm(momentum) == pytest.approx(
        math.hypot(contact.normal_impulse, contact.friction_impulse), rel=300 * EPS, abs=0.0
    )
    lost = 0.5 * MASS * ((before**2).sum() - (after**2).sum())
    assert contact.energy_lost == pytest.approx(lost, abs=300 * EPS * MASS)
    speed = (before[0] - before[1]) @ [contact.nx, contact.ny, contact.nz]
    assert contact.approach_speed == pytest.approx(speed, rel=10 * EPS, abs=0.0)
    assert contact.contact_time == pytest.approx(T_C, rel=0.1, abs=0.0)
    assert contact.load == pytest.approx(1.5 * 0.5 * MASS * speed / IMPACT_DURATION, rel=10 * EPS, abs=0.0)


def test_contacts_that_overlap_in_time_claim_no_impulse():
    positions = [(3.998, 5.0, 5.0), (5.0, 5.0, 5.0), (6.002, 5.0, 5.0)]
    velocities = [(1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-1.0, 0.0, 0.0)]
    fix = simulate(
        positions, velocities, T_C / 50, 300, make_model(), form="observe", observe_pairs=True,
        deck_options=granular(),
    )  # fmt: skip
    contacts = fix.contacts()
    assert len(contacts) == 2
    assert contacts.normal_impulse.isna().all()
    assert (contacts.approach_speed > 0.9).all()


@pytest.mark.parametrize("compiled", [True, False])
def test_an_impulse_waits_for_a_pair_force_but_not_for_ever(compiled):
    # A particle on the surface is struck from above and pressed down for about one contact duration.
    positions = [(5.0, 5.0, 0.5 - 1e-4), (5.0, 5.0, 1.5)]
    dt = T_C / 100
    fix = simulate(
        positions, [(0.0, 0.0, 0.0), (0.0, 0.0, -1.0)], dt, 400, make_model(), form="impulse",
        observe_pairs=True, deck_options=granular(1.0), compiled=compiled,
    )  # fmt: skip
    contacts = fix.contacts()
    surface, pair = (contacts[contacts.kind == kind].iloc[0] for kind in ("surface", "pair"))
    # Equal masses, e = 1: all of the momentum has arrived when the pair force ends, not the part at first.
    assert surface.approach_speed == pytest.approx(1.0, rel=1e-3, abs=0.0)
    assert surface.time == pytest.approx(pair.time + dt, abs=2 * dt)


RANKS_SCRIPT = """
import hashlib, json, sys
sys.path[:0] = {paths!r}
from mpi4py import MPI
from test_fix import *
positions, velocities, heights = scatter(9)
model = make_model(**REMOVING, flow=FLOW_UNIFORM, flow_x=0.5, flow_z=-0.2)
said = []
for form in ("soft", "impulse"):
    fix = simulate(positions, velocities, T_C / 10, 3000, model, heights=heights, form=form, sample_every=100,
                   observe_pairs=True, contact_duration=50 * T_C, deck_options={{"check": "no"}})
    said.append(hashlib.sha256(b"".join(a.tobytes() for a in everything(fix))).hexdigest())
    contacts = fix.contacts()
    end = contacts.x + contacts.contact_time * velocities[contacts.i, 0]
    said.append([len(contacts), int(((contacts.x < 5e-6) != (end < 5e-6)).sum())])
try:
    simulate(positions, velocities, T_C / 10, 2000, model, heights=heights, max_contacts=0)
except EngineError as error:
    said.append(str(error))
nlocal = fix.lmp.extract_setting("nlocal")
assert 0 < nlocal < 16 or MPI.COMM_WORLD.size == 1, nlocal
everyone = MPI.COMM_WORLD.gather(said)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everyone))
"""


def run_ranks(ranks, tmp_path):
    """What each rank says: a digest of all results and the number of contacts per form, and an error."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    (tmp_path / "ranks.py").write_text(RANKS_SCRIPT.format(paths=paths))
    mpiexec = Path(sys.executable).parent / "mpiexec"
    if not mpiexec.exists():
        pytest.skip("no mpiexec beside this Python")
    command = [str(mpiexec), "-n", str(ranks), sys.executable, str(tmp_path / "ranks.py")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_two_ranks_give_the_same_bits_as_one(tmp_path):
    """Particles change ranks in flight and in contact: the ranks meet at x = 5 um."""
    (one,) = run_ranks(1, tmp_path)
    first, second = run_ranks(2, tmp_path)
    assert one == first == second
    assert one[1][0] >= 16
    assert one[3][0] >= 16
    assert one[1][1] > 0  # contacts that begin on one rank and end on the other
    assert "the contact ledger is full" in one[4]
