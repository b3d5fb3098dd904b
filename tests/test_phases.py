"""Copies and levels of one problem: which runs are made, that copies evolve as if alone, quantities of each.

What the quantities have to be is tested with the judges, in `test_judges.py`.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpcheck import quantities as q
from cmpcheck.engines.protocol import Resolution
from cmpcheck.phases import split, surfaces, tile, unwrapped
from cmpcheck.study import Study, align_outputs, engine_study, reference_study
from reference.case import load_case
from reference.heightfield import Heightfield
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup

COPIES = 5
EPS = float(np.finfo(float).eps)
# Coordinates up to 5 periods are rounded to 1e-21 m at each of 100 steps; the distances that decide a contact
# are 1e-10 m and more.
RTOL = 1e-8


def setup_of(name: str, variant: str = "") -> Setup:
    return build_setup(next(case for case in load_case(name).variants() if case.variant == variant))


def shifts(setup: Setup) -> np.ndarray:
    """The phases of the copies, s: evenly spaced over one time step, symmetric about zero."""
    return setup.time_step * np.array([-0.4, -0.2, 0.0, 0.2, 0.4])


def alone(setup: Setup, shift: float) -> Setup:
    """One copy of `tile` in its own box."""
    model, state = setup.model, setup.state
    position = state.position + shift * state.velocity
    for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
        if period > 0.0:
            position[:, axis] %= period
    return replace(setup, state=replace(state, position=position))


PAIRS = pytest.mark.parametrize("name, variant", [("pair_head_on", "e0.5"), ("pair_slip", "")])
DIVERSE = pytest.mark.parametrize(
    "name, variant",
    [("pair_head_on", "e0.5"), ("pair_slip", ""), ("wall_oblique", "60deg"), ("asperity_bounce", "valley")],
)


def test_the_phases_are_spread_evenly_over_one_time_step_around_the_given_start():
    setup = setup_of("asperity_bounce", "edge")
    tiled = tile(setup, COPIES, setup.time_step)
    places = split(tiled.state.position, COPIES)[:, 0]
    places[:, 0] -= setup.model.length_x * np.arange(COPIES)
    expected = setup.state.position[0] + shifts(setup)[:, np.newaxis] * setup.state.velocity[0]
    np.testing.assert_allclose(places, expected, rtol=0.0, atol=4 * EPS * COPIES * setup.model.length_x)


def test_copies_differ_in_their_phase_only_and_the_setup_is_left_alone():
    setup = setup_of("wall_oblique", "60deg")
    before = setup.state.position.copy()
    tiled = tile(setup, COPIES, setup.time_step)
    assert tiled.copies == COPIES
    assert tiled.model == setup.model._replace(length_x=COPIES * setup.model.length_x)
    for name in ("velocity", "mass", "diameter", "modulus"):
        for part in split(getattr(tiled.state, name), COPIES):
            np.testing.assert_array_equal(part, getattr(setup.state, name))
    for part in np.split(tiled.state.heights, COPIES):
        np.testing.assert_array_equal(part, setup.state.heights)
    np.testing.assert_array_equal(setup.state.position, before)


@DIVERSE
def test_every_copy_has_the_ledger_that_it_would_have_alone(name, variant):
    setup = setup_of(name, variant)
    tiled = tile(setup, COPIES, setup.time_step)
    kind = "pair" if name.startswith("pair") else "surface"
    together = q.contacts_by_copy(simulate_setup(tiled), tiled, kind)
    period, span = setup.model.length_x, tiled.model.length_x
    for k, shift in enumerate(shifts(setup)):
        single = simulate_setup(alone(setup, shift)).contacts
        assert len(single) > 0
        away = together[k]["x"].to_numpy() - single["x"].to_numpy() - k * period
        atol = RTOL * single["x"].abs().max()
        np.testing.assert_allclose(away, span * np.round(away / span), rtol=0.0, atol=atol)
        for column in single.columns.drop(["kind", "x"]):
            # removed volume is a small difference for nobody: every column is a product of what it is made of
            np.testing.assert_allclose(
                together[k][column], single[column], rtol=RTOL, atol=0.0, err_msg=column
            )


def test_the_phases_reach_the_ledger():
    """Without the shift all copies would meet at one point: the test above would say nothing."""
    setup = setup_of("pair_slip")
    tiled = tile(setup, COPIES, setup.time_step)
    normals = [rows["nx"].iloc[0] for rows in q.contacts_by_copy(simulate_setup(tiled), tiled, "pair")]
    assert len(set(np.round(normals, 6))) == COPIES


@PAIRS
def test_pairs_that_meet_across_a_periodic_boundary_stay_within_their_copy(name, variant):
    setup = setup_of(name, variant)
    tiled = tile(setup, COPIES, setup.time_step)
    contacts = simulate_setup(tiled).contacts
    assert len(contacts) == COPIES
    np.testing.assert_array_equal(contacts["i"] // 2, contacts["j"] // 2)


def test_a_copy_cut_at_the_boundary_would_meet_its_neighbour():
    """The twin of the test above: positions wrapped into each copy's own box pair up across copies."""
    setup = setup_of("pair_head_on", "e0.5")
    tiled = tile(setup, COPIES, setup.time_step)
    cut = split(tiled.state.position.copy(), COPIES)
    cut[:, 1, 0] = setup.state.position[1, 0] + setup.model.length_x * np.arange(COPIES)
    contacts = simulate_setup(
        replace(tiled, state=replace(tiled.state, position=cut.reshape(-1, 3)))
    ).contacts
    assert len(contacts) == COPIES
    assert (contacts["i"] // 2 != contacts["j"] // 2).any()


def test_the_volume_that_each_copy_loses_is_its_own_cap():
    """With the bound that the mass balance is judged by, and 1e-9 of the cap more is noticed."""
    setup = setup_of("wall_oblique", "30deg")
    tiled = tile(setup, COPIES, setup.time_step)
    run = simulate_setup(tiled)
    volume = np.array([rows["removed_volume"].sum() for rows in q.contacts_by_copy(run, tiled, "surface")])
    bound = q.volume_rounding(run)
    np.testing.assert_allclose(q.volume_lost(run, COPIES), volume, rtol=0.0, atol=bound)
    assert bound < 1e-6 * volume.min()
    assert [part.z.shape for part in surfaces(run.surface, COPIES)] == [setup.state.heights.shape] * COPIES


# Runs made by hand, so that what is expected is arithmetic.


def made(positions=None, velocities=None, masses=None, contacts=None, **surface) -> Run:
    none = np.zeros((1, 0, 3))
    return Run(
        case=None,
        times=np.arange(float(len(none if positions is None else positions))),
        positions=none if positions is None else np.asarray(positions, float),
        velocities=none if velocities is None else np.asarray(velocities, float),
        masses=none[..., 0] if masses is None else np.asarray(masses, float),
        contacts=pd.DataFrame(contacts),
        history=pd.DataFrame(),
        **surface,
    )


def test_unwrapped_paths_are_straight_through_any_number_of_boundaries():
    setup = setup_of("swarm")
    box = np.array([setup.model.length_x, setup.model.length_y, setup.model.length_z])
    velocity = np.array([[1.0, -2.0, 0.5], [-0.3, 0.1, -2.4]])
    path = box * [0.9, 0.1, 0.5] + np.linspace(0.0, 3e-5, 40)[:, np.newaxis, np.newaxis] * velocity
    found = unwrapped(made(positions=path % box), setup)
    np.testing.assert_allclose(found, path, rtol=0.0, atol=40 * EPS * np.abs(path).max())
    assert (np.ptp(np.floor(path / box), axis=0) >= 1.0).any()


def test_unwrapping_leaves_a_direction_without_period_alone():
    setup = setup_of("wall_bounce", "pickup")
    path = np.zeros((2, 1, 3))
    path[1, 0, 2] = 3.9e-6
    np.testing.assert_array_equal(unwrapped(made(positions=path), setup), path)


def test_contacts_are_sorted_by_copy_kind_and_time_and_renumbered():
    setup = replace(setup_of("pair_slip"), copies=2)
    ledger = {
        "time": [3.0, 1.0, 2.0, 2.0, 0.5],
        "kind": ["pair", "pair", "pair", "surface", "pair"],
        "i": [2, 0, 3, 3, 0],
        "j": [3, 1, 2, -1, 1],
    }
    run = made(positions=np.zeros((1, 4, 3)), contacts=ledger)
    first, second = q.contacts_by_copy(run, setup, "pair")
    assert first[["time", "i", "j"]].to_numpy().tolist() == [[0.5, 0, 1], [1.0, 0, 1]]
    assert second[["time", "i", "j"]].to_numpy().tolist() == [[2.0, 1, 0], [3.0, 0, 1]]
    empty, wall = q.contacts_by_copy(run, setup, "surface")
    assert len(empty) == 0
    assert wall[["time", "i", "j"]].to_numpy().tolist() == [[2.0, 1, -1]]
    columns = list(q.contact_columns([first, second], 2))
    assert [rows["time"].tolist() for rows in columns] == [[0.5, 2.0], [1.0, 3.0]]


def test_energy_momentum_and_mass_are_sums_over_each_copy():
    velocities = [[[1, 0, 0], [0, 2, 0], [0, 0, 3], [0, 0, 0]], [[1, 0, 0], [0, 2, 1], [0, 0, 3], [0, 1, 0]]]
    run = made(np.zeros((2, 4, 3)), velocities, [[2, 3, 4, 5], [2, 3, 5, 7]])
    assert q.kinetic_energy(run, 0, 2).tolist() == [7.0, 18.0]
    assert q.kinetic_energy(run, -1, 2).tolist() == [8.5, 26.0]
    np.testing.assert_allclose(q.momentum_change(run, 2), [3.0, np.hypot(7.0, 3.0)], rtol=4 * EPS, atol=0.0)
    assert q.momentum_scale(run, 2) == 12.0
    assert q.mass_gained(run, 2).tolist() == [0.0, 3.0]
    assert q.final_velocity(run, 2)[1, 0].tolist() == [0.0, 0.0, 3.0]


def test_volume_is_lost_node_by_node():
    z = np.zeros((4, 2))
    lower = z.copy()
    lower[1, 0], lower[2, 1], lower[3, 0] = -1.0, -2.0, -0.5
    run = made(surface_initial=Heightfield(z, 0.5), surface=Heightfield(lower, 0.5))
    assert q.volume_lost(run, 2).tolist() == [0.25, 0.625]


def test_the_models_impulse_has_the_external_force_act_for_the_whole_duration():
    """J = J_engine - E_n (delta t - t_c): 7 - (-2) (5 - 1) = 15; a longer contact counts the other way."""
    columns = ["normal_impulse", "external_force", "duration", "contact_time"]
    rows = pd.DataFrame([[7.0, -2.0, 5.0, 1.0], [7.0, -2.0, 5.0, 6.0], [7.0, 0.0, 5.0, 1.0]], columns=columns)
    assert q.model_impulse(rows).tolist() == [15.0, 5.0, 7.0]


# Which runs are made

RELAXATION = load_case("drag_relaxation")


class Listener:
    """An engine and judge in one that only remember what was asked of them."""

    name = "lammps"

    def __init__(self, soft: bool):
        self.refines_contact, self.has_surface_contact, self.copies = soft, False, 2
        self.asked: list[Resolution] = []
        self.shifts: list[float] = []

    def run(self, setup, resolution):
        self.asked.append(resolution)
        assert setup.copies == 2
        ahead = setup.state.position[1, 2] - setup.state.position[0, 2]
        self.shifts.append(ahead / setup.state.velocity[0, 2])
        return SimpleNamespace(provenance={})

    def measure(self, setup, run):
        return []


def asked_for(soft: bool, form: str, duration: float = 8e-8) -> tuple[Study, Listener]:
    listener = Listener(soft)
    table = {"lammps": {"contact_duration": duration, "steps_per_contact": 40}}
    setup = align_outputs(build_setup(RELAXATION))
    setup = replace(setup, case=RELAXATION.model_copy(update={"engine": table}))
    return engine_study(listener, listener, setup, "quick", form), listener


def test_the_reference_runs_at_halved_steps_each_with_its_own_phases():
    listener, setup = Listener(soft=True), align_outputs(build_setup(RELAXATION))
    study = reference_study(listener, listener, setup, "quick")
    steps = [resolution.time_step for resolution in listener.asked]
    assert steps == [setup.time_step / 2**k for k in range(5)]
    np.testing.assert_allclose(listener.shifts, np.array(steps) / 2, rtol=1e-5, atol=0.0)  # of positions 1e-6
    assert study.finest.resolution == listener.asked[-1]
    assert list(study.series) == ["time step"]


def test_a_soft_engine_is_refined_in_duration_at_fixed_steps_per_contact_and_in_time_step():
    study, listener = asked_for(soft=True, form="soft")
    durations, steps = study.series["contact duration"], study.series["time step"]
    assert [level.resolution.contact_duration for level in durations] == [8e-8, 4e-8, 2e-8]
    per_contact = [level.resolution.steps_per_contact for level in durations]
    assert per_contact == pytest.approx([per_contact[0]] * 3, rel=4 * EPS, abs=0.0)
    assert {level.resolution.contact_duration for level in steps} == {2e-8}
    assert steps[0].resolution.steps_per_contact >= 40
    ratios = [level.resolution.time_step / steps[-1].resolution.time_step for level in steps]
    assert ratios == [4.0, 2.0, 1.0]
    assert durations[-1] is steps[-1] is study.finest
    assert len(listener.asked) == len(study.levels) == 5


@pytest.mark.parametrize("soft, form, duration", [(True, "impulse", 2e-8), (False, "native", 8e-8)])
def test_an_engine_without_soft_contacts_is_refined_in_time_step_only(soft, form, duration):
    study, listener = asked_for(soft, form)
    assert list(study.series) == ["time step"]
    assert {resolution.contact_duration for resolution in listener.asked} == {duration}
    assert len(listener.asked) == 3


@given(duration=st.floats(1e-9, 1e-6))
def test_an_engines_steps_divide_the_time_between_outputs(duration):
    study, _ = asked_for(soft=True, form="soft", duration=duration)
    interval = align_outputs(build_setup(RELAXATION)).output_times[1]
    for level in study.series["time step"]:
        steps = interval / level.resolution.time_step
        assert steps == pytest.approx(round(steps), rel=1e-12, abs=0.0)  # a handful of roundings
        assert level.resolution.steps_per_contact >= 40 * (1.0 - 1e-12)
