"""Laws of the LIGGGHTS engine: what goes in comes out, runs repeat to the bit, the ledger tells what the
trajectory shows, the surface is read again, and errors are one line."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from cmpcheck.engines import liggghts_library, protocol
from cmpcheck.engines.lammps import output_stride
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.engines.liggghts import LiggghtsEngine
from cmpcheck.engines.liggghts_library import available
from cmpcheck.engines.protocol import Resolution
from cmpcheck.phases import tile
from cmpcheck.study import contact_settings
from reference.case import load_case
from reference.heightfield import Heightfield
from reference.process import build_setup

pytestmark = pytest.mark.skipif(not available()[0], reason=available()[1] or "LIGGGHTS is there")
UNITS = 1e-14  # relative: LIGGGHTS keeps um and 1e-18 kg, SI numbers are multiplied and divided a few times


def variant(name, which=""):
    """The setup of a variant, the only or first one by default."""
    return build_setup(next(case for case in load_case(name).variants() if which in ("", case.variant)))


def simulate(setup, copies=1, decks=None):
    """One run at the case's own contact duration and steps."""
    duration, steps = contact_settings(setup.case, "liggghts")
    step = float(setup.output_times[1]) / output_stride(setup.output_times, duration / steps)
    tiled = tile(setup, copies, step) if copies > 1 else setup
    return tiled, LiggghtsEngine(decks).run(tiled, Resolution(step, duration, "soft"))


def changed_deck(tmp_path, name, old, new):
    """The deck of a case with one text replaced."""
    text = deck_path(name, "liggghts").read_text("utf-8")
    assert text.count(old) == 1
    path = tmp_path / f"in.{name}"
    path.write_text(text.replace(old, new), "utf-8")
    return {name: path}


@pytest.mark.parametrize("name", ["pair_slip", "wall_bounce"])
def test_a_run_starts_from_the_setup_and_has_its_output_times(name):
    setup = variant(name)
    setup = replace(setup, end_time=setup.output_times[2], output_times=setup.output_times[:3])
    setup, run = simulate(setup)
    np.testing.assert_array_equal(run.times, setup.output_times)
    np.testing.assert_allclose(run.positions[0], setup.state.position, rtol=UNITS, atol=0)
    np.testing.assert_allclose(run.velocities[0], setup.state.velocity, rtol=UNITS, atol=1e-15)
    np.testing.assert_allclose(run.masses[0], setup.state.mass, rtol=UNITS, atol=0)
    assert run.provenance["liggghts"] == liggghts_library.version()
    assert run.provenance["complete"]


@pytest.mark.parametrize("name", ["pair_stick", "wall_bounce"])
def test_a_run_repeats_to_the_bit(name):
    (_, one), (_, two) = simulate(variant(name), copies=4), simulate(variant(name), copies=4)
    np.testing.assert_array_equal(one.positions, two.positions)
    np.testing.assert_array_equal(one.velocities, two.velocities)
    assert one.contacts.equals(two.contacts)


def test_the_ledger_of_pairs_tells_the_change_of_momentum():
    _setup, run = simulate(variant("pair_slip"), copies=4)
    mass, change = run.masses[0], run.velocities[-1] - run.velocities[0]
    for row in run.contacts.itertuples():
        impulse = mass[row.j] * change[row.j]
        normal = float(impulse @ [row.nx, row.ny, row.nz])
        # summed over some 50 steps in other units
        assert row.normal_impulse == pytest.approx(normal, rel=1e-11, abs=0)
        friction = np.sqrt(float(impulse @ impulse) - normal**2)
        assert row.friction_impulse == pytest.approx(friction, rel=1e-9, abs=0)


def test_the_ledger_of_the_wall_tells_the_change_of_momentum():
    setup, run = simulate(variant("wall_bounce", "no_pickup"), copies=4)
    change = setup.state.mass * (run.velocities[-1] - run.velocities[0])[:, 2]
    contacts = run.contacts.sort_values("i")
    np.testing.assert_allclose(contacts["normal_impulse"], change, rtol=1e-11, atol=0)
    lost = 0.5 * setup.state.mass * ((run.velocities[0] ** 2) - (run.velocities[-1] ** 2)).sum(axis=1)
    np.testing.assert_allclose(contacts["energy_lost"], lost, rtol=1e-10, atol=0)


def test_a_particle_strikes_the_surface_as_lowered_by_the_one_before():
    """Two particles fall on one place, the second when the first has taken 20 nm off it and has left."""
    case = load_case("wall_bounce").variants()[0]
    (first,) = case.particle
    x, y = 1.0e-6, 2.5e-6  # a node
    particles = [
        first.model_copy(update={"position": (x, y, 0.455e-6), "velocity": (3.0, 0.0, -1.0)}),
        first.model_copy(update={"position": (x + 0.09e-6, y, 1.55e-6), "velocity": (0.0, 0.0, -1.0)}),
    ]
    depth = 20e-9
    setup = build_setup(case.model_copy(update={"particle": tuple(particles)}))
    removal = depth / simulate_first_depth(setup)
    model = setup.model._replace(deposit=2, acceleration=removal, has_pairs=False, mass_pickup=False)
    times = np.linspace(0.0, 1.13e-6, 13)  # until the second has struck once
    setup = replace(setup, model=model, end_time=1.13e-6, output_times=times)
    _, run = simulate(setup)
    (later,) = (row for _, row in run.contacts.iterrows() if row["i"] == 1)
    surface = Heightfield(run.surface_initial.z, run.surface_initial.spacing)
    surface.lower_node(x, y, depth)
    point, _distance, _ = surface.closest_point([x + 0.09e-6, y, later["z"] + 0.45e-6], 0.5e-6)
    assert run.provenance["surface_read_again"] == 1
    assert later["z"] == pytest.approx(point[2], abs=0.1e-9)
    assert later["z"] < -10e-9  # on the flat surface it would be 0


def simulate_first_depth(setup):
    """Depth of the cap of the first impact, without acceleration."""
    times = np.linspace(0.0, 40e-9, 3)
    model = setup.model._replace(has_pairs=False, mass_pickup=False)
    _, run = simulate(replace(setup, model=model, end_time=40e-9, output_times=times))
    return float(run.contacts["depth"].iloc[0])


@pytest.mark.parametrize(
    "old, new, said",
    [
        ("fix integrate all nve", "fix integrate all nonsense", "Invalid fix style"),
        ("\nunits si", "\nquit", "Unknown command: this_deck_quits"),
        ("fix surface all mesh/surface", "# fix surface all mesh/surface", "could not find fix mesh id"),
        ("store_force yes ", "", "store_force yes"),
    ],
)
def test_a_broken_deck_is_one_line_and_the_next_run_is_made(tmp_path, old, new, said):
    decks = changed_deck(tmp_path, "wall_bounce", old, new)
    with pytest.raises(EngineError, match=said) as problem:
        simulate(variant("wall_bounce"), decks=decks)
    assert "\n" not in str(problem.value)
    assert str(problem.value).startswith("wall_bounce pickup: LIGGGHTS: ")
    assert len(simulate(variant("wall_bounce"))[1].contacts) == 1


def test_a_run_that_hangs_is_ended(monkeypatch, tmp_path):
    monkeypatch.setattr(protocol, "TIMEOUT", 0.01)
    with pytest.raises(EngineError, match=r"no answer within 0\.01 s"):
        simulate(variant("wall_bounce"))


def test_particles_that_are_lost_are_an_error(tmp_path):
    decks = changed_deck(tmp_path, "wall_bounce", "boundary p p ${boundary_z}", "boundary p p f")
    setup = variant("wall_bounce")
    away = replace(setup.state, velocity=np.array([[0.0, 0.0, 50.0]]))
    with pytest.raises(EngineError, match=r"[Ll]ost"):
        simulate(replace(setup, state=away), decks=decks)


def test_what_is_not_installed_says_how_to_get_it(monkeypatch):
    monkeypatch.setenv("PATH", os.devnull)
    liggghts_library._probe.cache_clear()
    try:
        info = LiggghtsEngine().info()
    finally:
        liggghts_library._probe.cache_clear()
    assert not info.available
    assert "apt-get install liggghts" in info.reason
