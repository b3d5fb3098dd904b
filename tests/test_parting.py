"""Where two runs part: a missing impact or a changed speed is found where it was planted, nothing else is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from cmpcheck import parting
from cmpcheck.engines.protocol import Resolution
from cmpcheck.engines.reference import ReferenceEngine
from reference.case import load_case
from reference.heightfield import Heightfield
from reference.ledger import COLUMNS
from reference.process import build_setup
from reference.simulation import simulate_setup

REFERENCE, OTHER = Resolution(9e-9), Resolution(6e-11, 3e-9, "impulse")
CASE = load_case("polish_pair")


@pytest.fixture(scope="module")
def setup():
    return build_setup(CASE)


@pytest.fixture(scope="module")
def run(setup):
    return simulate_setup(setup)


def compared(run, contacts, setup):
    other = replace(run, contacts=contacts)
    match = parting.compare_impacts(run, other, setup, ReferenceEngine(), (REFERENCE, OTHER))
    return match, {kind.kind: kind for kind in match.kinds}


def strong(run, setup, kind):
    """Rows of impacts of a kind that are far above what is too slow to tell, and not near the end."""
    late = parting.lateness(REFERENCE, OTHER)
    speed = CASE.numerics.ledger_speed + 2.0 * parting.explained_speed(setup, late)
    c = run.contacts
    return c[(c["kind"] == kind) & (c["approach_speed"] > speed) & (c["time"] < 0.9 * setup.end_time)].index


def test_identical_ledgers_never_part(run, setup):
    _, kinds = compared(run, run.contacts, setup)
    for kind, match in kinds.items():
        count = int((run.contacts["kind"] == kind).sum())
        assert count > 5
        assert (match.impacts, match.matched, match.before) == ((count, count), count, count)
        assert (match.parting, match.undecided) == (None, 0)


def test_small_shifts_of_time_and_speed_are_explained(run, setup):
    late = parting.lateness(REFERENCE, OTHER)
    shifted = run.contacts.assign(
        time=run.contacts["time"] + 0.4 * REFERENCE.time_step,  # a pressed particle has one in every step
        approach_speed=run.contacts["approach_speed"] + 0.99 * parting.explained_speed(setup, late),
    )
    _, kinds = compared(run, shifted.sample(frac=1.0, random_state=1), setup)  # in no order
    assert all(match.parting is None for match in kinds.values())


@pytest.mark.parametrize("kind", ["surface", "pair", "pad"])
def test_a_missing_impact_is_the_first_to_part(kind, run, setup):
    row = strong(run, setup, kind)[-1]
    impact = run.contacts.loc[row]
    _, kinds = compared(run, run.contacts.drop(index=row), setup)
    found = kinds.pop(kind)
    assert all(match.parting is None for match in kinds.values())
    assert found.parting is not None
    assert (found.parting.time, found.parting.particle) == (impact["time"], impact["i"])
    assert found.parting.partner == impact["j"]
    assert found.parting.reference_speed == impact["approach_speed"]
    assert math.isnan(found.parting.measured_speed)
    same = run.contacts[run.contacts["kind"] == kind]
    assert found.before == int((same["time"] < impact["time"]).sum())
    assert found.parting.duration == impact["duration"]
    assert found.parting.contact_times[0] == impact["contact_time"]


def test_an_impact_that_only_the_other_engine_has_is_found_too(run, setup):
    row = strong(run, setup, "surface")[-1]
    shorter = replace(run, contacts=run.contacts.drop(index=row))
    match = parting.compare_impacts(shorter, run, setup, ReferenceEngine(), (REFERENCE, OTHER))
    surface = match.kinds[0]
    assert surface.parting is not None
    assert math.isnan(surface.parting.reference_speed)
    assert surface.parting.measured_speed == run.contacts.loc[row, "approach_speed"]


def test_a_changed_speed_is_found_and_the_earliest_of_two_counts(run, setup):
    first, second = strong(run, setup, "surface")[[2, -1]]
    changed = run.contacts.copy()
    late = parting.lateness(REFERENCE, OTHER)
    changed.loc[second, "approach_speed"] += 1.01 * parting.explained_speed(setup, late)
    _, kinds = compared(run, changed, setup)
    assert kinds["surface"].parting.time == run.contacts.loc[second, "time"]
    changed.loc[first, "approach_speed"] += 1.01 * parting.explained_speed(setup, late)
    _, kinds = compared(run, changed, setup)
    part = kinds["surface"].parting
    assert part.time == run.contacts.loc[first, "time"]
    assert part.measured_speed - part.reference_speed > parting.explained_speed(setup, late)


def test_an_impact_that_lowers_another_node_parts_the_runs_however_near_it_is(run, setup):
    row = strong(run, setup, "surface")[3]
    h, x = setup.model.spacing, run.contacts.loc[row, "x"]
    midway = (math.floor(x / h + 0.5) + 0.5) * h
    ours, theirs = run.contacts.copy(), run.contacts.copy()
    ours.loc[row, "x"], theirs.loc[row, "x"] = midway - 1e-12, midway - 2e-12
    same = parting.compare_impacts(
        replace(run, contacts=ours),
        replace(run, contacts=theirs),
        setup,
        ReferenceEngine(),
        (REFERENCE, OTHER),
    )
    assert same.kinds[0].parting is None
    theirs.loc[row, "x"] = midway + 1e-12
    other = parting.compare_impacts(
        replace(run, contacts=ours),
        replace(run, contacts=theirs),
        setup,
        ReferenceEngine(),
        (REFERENCE, OTHER),
    )
    found = other.kinds[0].parting
    assert found is not None
    assert found.time == run.contacts.loc[row, "time"]
    assert abs(found.nodes[1] - found.nodes[0]) in (20, 380)  # the next row of 20, or across the edge
    assert math.isclose(found.apart, 2e-12, rel_tol=1e-3)


def test_the_node_of_an_impact_is_the_one_that_the_surface_lowers(run, setup):
    numbers = parting.lowered_nodes(run.contacts, setup)
    hits = run.contacts["removed_volume"] > 0.0
    assert ((numbers >= 0) == hits).all()
    surface = Heightfield(setup.state.heights, setup.model.spacing)
    for x, y, depth in run.contacts.loc[hits, ["x", "y", "depth"]].itertuples(index=False):
        surface.lower_node(x, y, CASE.removal.acceleration * depth)
    depths = run.contacts.loc[hits, "depth"] * CASE.removal.acceleration
    fallen = np.bincount(numbers[hits], depths, surface.z.size).reshape(surface.z.shape)
    np.testing.assert_allclose(setup.state.heights - fallen, surface.z, rtol=0.0, atol=1e-18)


def test_an_impact_too_slow_to_tell_is_counted_and_parts_nothing(run, setup):
    """The other engine may have had it below the speed from which impacts are recorded."""
    c = run.contacts
    slow = c[(c["kind"] == "surface") & (c["approach_speed"] < CASE.numerics.ledger_speed + 0.01)].index
    assert len(slow) > 0
    _, kinds = compared(run, c.drop(index=slow[0]), setup)
    assert kinds["surface"].parting is None
    assert kinds["surface"].undecided == 1


def ledger(*rows: tuple[float, str, int, int]) -> pd.DataFrame:
    frame = pd.DataFrame(0.0, index=range(len(rows)), columns=list(COLUMNS))
    for k, name in enumerate(("time", "kind", "i", "j")):
        frame[name] = [row[k] for row in rows]
    return frame


def test_impacts_are_the_same_only_within_the_window_of_the_same_particles_and_kind():
    one = ledger((10.0, "pair", 1, 2), (20.0, "surface", 1, -1), (30.0, "pad", 3, -1), (50.0, "pair", 1, 2))
    other = ledger((52.0, "pair", 2, 1), (21.0, "pad", 1, -1), (33.0, "pad", 3, -1), (10.5, "pair", 2, 1))
    found = parting.match_impacts(one, other, 2.5)
    assert sorted(map(tuple, found)) == [(0, 3), (3, 0)]
    assert sorted(map(tuple, parting.match_impacts(one, other, 3.5))) == [(0, 3), (2, 2), (3, 0)]


def test_an_impact_has_one_partner_at_most():
    one = ledger((10.0, "pad", 1, -1), (11.0, "pad", 1, -1))
    other = ledger((11.2, "pad", 1, -1))
    assert parting.match_impacts(one, other, 5.0).tolist() == [[1, 0]]
    assert parting.match_impacts(other, one, 5.0).tolist() == [[0, 1]]
    assert parting.match_impacts(one, ledger(), 5.0).shape == (0, 2)


def test_neighbours_are_found_across_the_edge_of_the_box(setup):
    d = setup.state.diameter
    position = np.tile([5e-6, 5e-6, 1e-6], (len(d), 1))
    position[:, 1] += 1e-3 * np.arange(len(d))  # far apart
    position[:3, 1] = 5e-6
    touch = 0.5 * (d[0] + d[1]), 0.5 * (d[0] + d[2])
    position[:3, 0] = 1e-7, 1e-7 - 1.05 * touch[0] + setup.model.length_x, 1e-7 + 1.11 * touch[1]
    ((k, gap),) = [n for n in parting.neighbours(setup, position, [0]) if n[0] < 3]
    assert k == 1
    assert math.isclose(gap, 0.05 * touch[0], rel_tol=1e-6)


def test_simultaneous_impacts_are_recognised(run, setup):
    """An impact of the same particle with something else within the lateness, planted and not."""
    row = next(
        row
        for row in strong(run, setup, "surface")
        if not parting._struck_otherwise(run.contacts, run.contacts.loc[row], 30e-9)
    )
    impact = run.contacts.loc[row]
    planted = impact.copy()
    planted["kind"], planted["time"] = "pad", impact["time"] + 10e-9
    contacts = pd.concat([run.contacts, planted.to_frame().T.astype(run.contacts.dtypes)], ignore_index=True)
    assert parting._struck_otherwise(contacts, impact, 11e-9)
    assert not parting._struck_otherwise(contacts, impact, 9e-9)
