"""Laws of the LAMMPS engine: what goes in comes out, contacts obey their law at first order, drag at second,
runs repeat, and errors are one line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmpcheck.engines.lammps import LammpsEngine, output_stride
from cmpcheck.engines.lammps_library import EngineError, available
from cmpcheck.engines.lammps_setup import deck_path, effective_mass
from cmpcheck.engines.protocol import Resolution
from cmpcheck.phases import tile
from cmpcheck.study import contact_settings
from reference import exact
from reference.case import load_case
from reference.process import build_setup

pytestmark = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
UNITS = 1e-14  # relative: LAMMPS keeps um and pg, SI numbers are multiplied and divided a few times


def variant(name: str, which: str = ""):
    """The setup of a variant, the only or first one by default."""
    return build_setup(next(case for case in load_case(name).variants() if which in ("", case.variant)))


def simulate(setup, form="soft", finer=1.0, copies=1, decks=None):
    """One run at the case's own contact duration and steps, the steps divided by `finer`."""
    duration, steps = contact_settings(setup.case, "lammps")
    step = duration / steps / finer
    step = float(setup.output_times[1]) / output_stride(setup.output_times, step)
    tiled = tile(setup, copies, step) if copies > 1 else setup
    return tiled, LammpsEngine(decks).run(tiled, Resolution(step, duration, form))


@pytest.mark.parametrize("name", ["swarm", "couette_drift", "wall_bounce", "pair_slip"])
def test_a_run_starts_from_the_setup_and_has_its_output_times(name):
    setup = variant(name)
    setup = replace(setup, end_time=setup.output_times[2], output_times=setup.output_times[:3])
    setup, run = simulate(setup)
    np.testing.assert_array_equal(run.times, setup.output_times)
    np.testing.assert_allclose(run.positions[0], setup.state.position, rtol=UNITS, atol=0)
    np.testing.assert_allclose(run.velocities[0], setup.state.velocity, rtol=UNITS, atol=1e-15)
    np.testing.assert_allclose(run.masses[0], setup.state.mass, rtol=UNITS, atol=0)
    np.testing.assert_array_equal(run.diameters, setup.state.diameter)
    assert run.provenance["complete"]
    assert len(run.history) == len(run.times)


@pytest.mark.parametrize("which, restitution", [("e0.2", 0.2), ("e0.5", 0.5), ("e0.8", 0.8), ("e1", 1.0)])
def test_the_restitution_of_pairs_converges_at_first_order(which, restitution):
    errors = []
    for finer in (1, 2, 4):
        setup, run = simulate(variant("pair_head_on", which), finer=finer, copies=16)
        m = effective_mass(setup.state, setup.copies)
        assert len(run.contacts) == 16
        measured = run.contacts["normal_impulse"] / (m * run.contacts["approach_speed"]) - 1.0
        errors.append(abs(measured.mean() - restitution))
    # at touch the dashpot acts for up to a step too long or too short, 2 ln(1/e)/n of v; Verlet adds 1/n^2
    n = 200
    assert errors[-1] <= -2 * np.log(restitution) / n + 1 / n**2
    if restitution < 1.0:  # 16 phases average the start: what is left is the lag of the velocity, first order
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        np.testing.assert_allclose(orders, 1.0, rtol=0, atol=0.1)


@pytest.mark.parametrize("name, friction", [("pair_stick", 0.2), ("pair_slip", 0.3 * 1.5)])
def test_the_friction_of_pairs_tends_to_stick_or_coulomb(name, friction):
    setup = variant(name)
    duration, steps = contact_settings(setup.case, "lammps")
    errors = []
    for shorter in (1, 2, 4):
        step = duration / shorter / (4 * steps)
        step = float(setup.output_times[1]) / output_stride(setup.output_times, step)
        tiled = tile(setup, 16, step)
        run = LammpsEngine().run(tiled, Resolution(step, duration / shorter, "native"))
        m = effective_mass(tiled.state, 16)
        errors.append(float(np.mean(run.contacts["friction_impulse"] / m)) / friction - 1.0)
    # the normal turns by slip t_c/d and mixes in the normal impulse: 1.5 slip t_c/(0.75 um) of m v; and
    # friction that slips follows the normal impulse, off by 2 ln(1/e)/n/(1+e) at most
    slip = 0.2 if name == "pair_stick" else 1.0
    turn = 1.5 * slip * duration / 4 / 0.75e-6 / friction
    assert abs(errors[-1]) <= turn + (0.0 if name == "pair_stick" else 2 * np.log(2) / 200 / 1.5)
    assert abs(errors[-1]) < abs(errors[0])


def test_momentum_is_conserved_in_a_collision():
    _, run = simulate(variant("pair_slip"), copies=16)
    momentum = (run.masses[:, :, None] * run.velocities).sum(axis=1)
    scale = (run.masses * np.linalg.norm(run.velocities, axis=2)).sum(axis=1).max()
    # each of some thousand steps rounds each velocity once
    drift = np.linalg.norm(momentum - momentum[0], axis=1).max()
    assert drift <= 1e-12 * scale


def test_the_ledger_holds_the_impulse_that_changed_the_velocity():
    setup, run = simulate(variant("pair_stick"), copies=4)
    change = setup.state.mass[::2, None] * (run.velocities[-1] - run.velocities[0])[::2]
    by_copy = run.contacts.sort_values("i")
    impulse = np.hypot(by_copy["normal_impulse"], by_copy["friction_impulse"]).to_numpy()
    # the components are along the normal at first touch, the vector is the same: only rounding of some
    # hundred steps
    np.testing.assert_allclose(np.linalg.norm(change, axis=1), impulse, rtol=1e-9, atol=0)


def test_drag_in_lammps_variables_is_of_second_order():
    setup = variant("drag_relaxation")
    state, model = setup.state, setup.model
    motion = exact.drag_motion(
        setup.output_times,
        state.position[0],
        state.velocity[0],
        (model.flow_x, model.flow_y, model.flow_z),
        float(state.mass[0]),
        float(state.diameter[0]),
        model.fluid_density,
        model.viscosity,
    )
    errors = []
    for finer in (1, 2, 4):
        _, run = simulate(setup, finer=finer)
        errors.append(np.abs(run.velocities[:, 0] - motion.velocities).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2.0, rtol=0, atol=0.1)


@pytest.mark.parametrize("name", ["swarm", "wall_oblique"])
def test_a_run_repeats_to_the_last_bit(name):
    setup = variant(name)
    setup = replace(setup, end_time=setup.output_times[10], output_times=setup.output_times[:11])
    (_, one), (_, two) = (simulate(setup) for _ in range(2))
    for array in ("positions", "velocities", "masses"):
        np.testing.assert_array_equal(getattr(one, array), getattr(two, array))
    assert one.contacts.equals(two.contacts)


@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_a_wall_loses_what_the_particle_gains(form):
    setup, run = simulate(variant("wall_bounce"), form=form)
    lost = (run.surface_initial.volume() - run.surface.volume()) * setup.model.surface_density
    gained = run.masses[-1, 0] - run.masses[0, 0]
    assert gained > 0
    # the volume is a difference of sums over 64 nodes of about 1e-17 m3, of which 1e-22 is lost
    rounding = np.finfo(float).eps * 64 * run.surface_initial.spacing**2 * 1e-6
    assert lost == pytest.approx(gained, rel=1e-9, abs=rounding * setup.model.surface_density)
    assert run.history["removed_mass"].iloc[-1] == pytest.approx(gained, rel=1e-9, abs=0)


def test_the_steps_fit_the_output_times():
    assert output_stride(np.linspace(0, 1, 11), 0.025) == 4
    assert output_stride(np.linspace(0, 1, 11), 0.024) == 5
    assert output_stride(np.linspace(0, 1, 11), 3.0) == 1
    with pytest.raises(EngineError, match="equally spaced"):
        output_stride(np.array([0.0, 1.0, 3.0]), 0.1)


def user_deck(folder: Path, name: str, *replacements: tuple[str, str]) -> dict[str, Path]:
    """A user's deck for a case: the one that ships with some text replaced."""
    text = deck_path(name).read_text("utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    (folder / "in.mine").write_text(text, "utf-8")
    return {name: folder / "in.mine"}


def test_the_deck_of_a_user_is_what_is_run(tmp_path):
    frictionless = user_deck(tmp_path, "pair_slip", (" ${friction} damping", " 0 damping"))
    _, run = simulate(variant("pair_slip"), decks=frictionless)
    # what is left is the turn of the normal, 1 m/s times t_c over 0.75 um
    turn = run.provenance["contact_duration"] / 0.75e-6
    assert run.contacts["friction_impulse"][0] < turn * run.contacts["normal_impulse"][0]


@pytest.mark.parametrize(
    "name, old, new, message",
    [
        ("pair_slip", "pair_style granular", "pair_style granlar", "Unrecognized pair style 'granlar'"),
        ("pair_slip", 'if "${driver}', 'if "a${driver}', 'no line begins with  if "${driver}'),
        ("pair_slip", "atom_style sphere 1", "atom_style atomic", "atom"),
        ("pair_slip", "units micro", "units si", "units micro"),
        ("wall_bounce", "d2_cmpcheck 49", "d2_cmpcheck 3", "must define the per-atom state"),
        ("pair_slip", "<= 0.1353353", "<= 2", "restitution above exp(-2)"),
    ],
)
def test_a_deck_that_does_not_fit_is_one_line(name, old, new, message, tmp_path):
    decks = user_deck(tmp_path, name, (old, new))
    with pytest.raises(EngineError, match=re.escape(message)) as caught:
        simulate(variant(name), decks=decks)
    assert "\n" not in str(caught.value)


def test_two_coefficients_of_friction_are_refused():
    setup = variant("pair_slip")
    setup = replace(setup, model=setup.model._replace(dynamic_friction=0.2))
    with pytest.raises(EngineError, match="one coefficient"):
        simulate(setup)


def test_a_native_deck_refuses_a_particle_that_reaches_the_surface():
    setup = variant("couette_drift")
    state = replace(setup.state, velocity=setup.state.velocity.copy())
    state.velocity[0] = (0.1, 0.0, -0.9)  # sinks by up to 0.9 tau = 160 nm of the 250 nm that it has
    state.position[0, 2] = 0.5e-6
    with pytest.raises(EngineError, match="particle 0 has reached it"):
        simulate(replace(setup, state=state))


def test_drag_beyond_the_law_of_a_deck_stops_it():
    setup = variant("drag_relaxation")
    state = replace(setup.state, velocity=np.array([[3.0, 0.0, 0.0]]))
    with pytest.raises(EngineError, match="Fix halt condition"):
        simulate(replace(setup, state=state))


def test_a_missing_deck_is_an_engine_error():
    with pytest.raises(EngineError, match="no LAMMPS deck for the case nonsense"):
        deck_path("nonsense")
    with pytest.raises(EngineError, match="nowhere: No such file"):
        simulate(variant("pair_slip"), decks={"pair_slip": Path("in.nowhere")})


def test_the_engine_names_its_version():
    info = LammpsEngine().info()
    assert info.available
    assert info.version >= "20250722"
