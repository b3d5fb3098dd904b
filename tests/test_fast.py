"""The fast stepper against the answer key, step by step to round-off."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polish_example import small_polish

import reference
from cmpcheck.components.row import EPS
from cmpcheck.components.steppers import allowed, apart, crowded, nudged, shortened, with_stepper
from reference.case import Case, load_case
from reference.collisions import pair_impulse
from reference.compiled import kernel
from reference.contact import impact_duration
from reference.fast.ceiling import ceiling_over, highest_node
from reference.fast.near import FEW
from reference.fast.pairs import LANES, B, batch, durations, guess_durations, impulse_on_first
from reference.fast.swarm import MANY
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import SimulationError, simulate_setup
from reference.state import FLOW_NONE
from reference.toml_source import CaseError

HELD = {"pad": {"initial_height": 1.2e-6, "minimum_height": 1.2e-6}}  # pad at rest: V_z = 0
PINCHED = {"pad": {"initial_height": 1.05e-6, "minimum_height": 1.02e-6}}
CASES = {
    "descending_pad": {"pad": {"initial_height": 1.2e-6}},
    "pad_at_rest": HELD,
    "pinched": PINCHED,
    "volume": HELD | {"removal": {"deposit": "volume", "acceleration": 1e5}},
    "carried_away": HELD | {"removal": {"mass_pickup": False}},
    "without_threshold": HELD | {"removal": {"threshold_velocity": 0.0}},
    "reynolds_above_1": HELD | {"pad": HELD["pad"] | {"speed": 6.0}, "numerics": {"gamma": 0.06}},
    "constant_duration": HELD | {"contact": {"impact_duration": 2e-9}},
    "without_pairs": HELD | {"contact": {"pairs": False}},
    "new_contacts_only": HELD | {"removal": {"new_contacts_only": True}},
    # several particles touch a triangle that falls
    "coarse_surface": PINCHED | {"surface": {"size": 18e-6, "nodes": 9}},
    # so many that neighbors are sought in cells
    "many": HELD | {"particles": {"count": FEW + 60}, "surface": {"size": 37e-6, "nodes": 74}},
}


def polish(changes: dict[str, dict]) -> Case:
    case = small_polish(**changes)
    # a drag that is iterated to round-off: the fast stepper's linear one needs no iteration
    return case.model_copy(update={"numerics": case.numerics.model_copy(update={"tolerance": 1e-15})})


def sorted_ledger(run: Run):
    return run.contacts.sort_values(["time", "kind", "i", "j"], ignore_index=True)


@pytest.fixture(params=["few", "many"])
def loop(request, monkeypatch):
    """Both loops of the fast stepper, whatever the number of particles."""
    if request.param == "many":
        monkeypatch.setattr("reference.fast.stepper.MANY", 1)


@pytest.mark.parametrize("name", CASES)
def test_the_fast_stepper_follows_the_answer_key_to_round_off(name, loop):
    """More than 1000 steps with contacts; 500 where they are fast, and chaos sooner.

    The bound is that of `steppers.allowed`; the smallest that a twin can show is eps of the box.
    """
    steps, in_contact = (1500, 500) if name == "reynolds_above_1" else (1500, 1000)
    setup = shortened(polish(CASES[name]), steps)
    plain = simulate_setup(setup)
    fast = simulate_setup(with_stepper(setup, "fast"))
    twin = simulate_setup(nudged(setup))
    period = setup.model.length_x
    bound_x = allowed(steps, plain.positions, twin.positions, period, period)
    bound_v = allowed(steps, plain.velocities, twin.velocities, np.abs(plain.velocities).max())
    assert bound_x < 1e-3 * setup.state.diameter.min()  # else the comparison would say nothing
    assert apart(fast.positions, plain.positions, period) <= bound_x
    assert apart(fast.velocities, plain.velocities) <= bound_v
    assert len(np.unique(plain.contacts["time"])) > in_contact
    ours, theirs = sorted_ledger(fast), sorted_ledger(plain)
    for column in ("kind", "i", "j"):
        assert (ours[column] == theirs[column]).all()
    assert fast.history["contacts"].iloc[-1] == plain.history["contacts"].iloc[-1]
    assert fast.history["removals"].iloc[-1] == plain.history["removals"].iloc[-1]


@pytest.mark.parametrize("axis", [0, 2])
def test_a_position_that_is_not_finite_ends_the_run_as_in_the_answer_key(axis, loop):
    setup = shortened(polish({}), 100)
    setup.state.position[1, axis] = np.nan
    said = []
    for one in (setup, with_stepper(setup, "fast")):
        with pytest.raises(SimulationError) as error:
            simulate_setup(one)
        said.append(str(error.value))
    assert said[0] == said[1]


@pytest.mark.parametrize("room", [1, 60])
def test_a_ledger_buffer_that_is_soon_full_changes_nothing(room, loop, monkeypatch):
    """The loop for many makes a block of steps again, fewer of them, where its rows have no room."""
    setup = shortened(polish(CASES["coarse_surface"]), 600)
    plain, twin = simulate_setup(setup), simulate_setup(nudged(setup))
    monkeypatch.setattr("reference.simulation.ledger_room", lambda count: room)
    fast = simulate_setup(with_stepper(setup, "fast"))
    period = setup.model.length_x
    bound = allowed(600, plain.positions, twin.positions, period, period)
    assert apart(fast.positions, plain.positions, period) <= bound < 1e-3 * setup.state.diameter.min()
    assert len(plain.contacts) > 10 * room
    ours, theirs = sorted_ledger(fast), sorted_ledger(plain)
    for column in ("kind", "i", "j"):
        assert (ours[column] == theirs[column]).all()
    assert fast.history["removals"].iloc[-1] == plain.history["removals"].iloc[-1] > 0
    assert fast.history["contacts"].iloc[-1] == plain.history["contacts"].iloc[-1]


def test_a_pad_that_is_lower_by_a_billionth_would_be_seen():
    """The bound above is no blank cheque: a pad that is 1e-9 lower is beyond it."""
    setup = shortened(polish(HELD), 1500)
    lower = replace(setup, state=replace(setup.state, pad_height=setup.state.pad_height * (1.0 - 1e-9)))
    plain, twin = simulate_setup(setup), simulate_setup(nudged(setup))
    moved = simulate_setup(with_stepper(lower, "fast"))
    period = setup.model.length_x
    bound = allowed(1500, plain.positions, twin.positions, period, period)
    assert apart(moved.positions, plain.positions, period) > bound


def box_of_particles(scheme: str = "point_implicit", stepper: str = "plain") -> Case:
    """Particles in a periodic box without surface, pad or fluid."""
    case = load_case("swarm").variants()[0]
    return case.replaced({"numerics": {"scheme": scheme, "stepper": stepper}})


def test_a_periodic_box_without_surface_and_fluid_is_followed_too(loop):
    plain = build_setup(box_of_particles())
    steps = 600
    end = steps * plain.time_step
    plain = replace(plain, end_time=end, output_times=np.array([0.0, end]))
    ours, theirs = simulate_setup(with_stepper(plain, "fast")), simulate_setup(plain)
    twin = simulate_setup(nudged(plain))
    bound = allowed(steps, theirs.velocities, twin.velocities, 1.0)
    assert len(theirs.contacts) > 10
    assert len(ours.contacts) == len(theirs.contacts)
    assert bound < 1e-3 * np.abs(theirs.velocities).max()
    assert apart(ours.velocities, theirs.velocities) <= bound


def test_who_sinks_into_the_surface_in_one_step_is_not_missed():
    """In a step these fall by 0.4 to 2.5 diameters: below a surface whose triangles they were beside.

    Of triangles the closest one may then be above the centre, and would push it down.
    """
    count = 200
    setup = shortened(crowded(count, {"contact": {"pairs": False}, "numerics": {"ledger_speed": 0.0}}), 40)
    rng = np.random.default_rng(0)
    velocity = rng.uniform(-1.0, 1.0, (count, 3))
    velocity[:, 2] = -rng.uniform(40.0, 250.0, count)
    position = setup.state.position.copy()
    position[:, 2] += rng.uniform(0.0, 1e-5, count)
    model = setup.model._replace(flow=FLOW_NONE, wall_speed=0.0, has_pad=False, length_z=0.0)
    setup = replace(setup, model=model, state=replace(setup.state, position=position, velocity=velocity))
    plain, fast = (sorted_ledger(simulate_setup(one)) for one in (setup, with_stepper(setup, "fast")))
    assert len(plain) > count
    assert fast[["time", "kind", "i"]].equals(plain[["time", "kind", "i"]])


def test_the_fixed_point_scheme_has_no_fast_stepper():
    with pytest.raises(CaseError, match=r"numerics.stepper.*fast.*allowed: 'plain'"):
        box_of_particles("fixed_point", "fast")


def test_a_ledger_that_is_full_again_and_again_changes_nothing_but_round_off(loop, monkeypatch):
    """The stepper begins anew, with other lists and bounds, whenever its 300 rows are full."""
    setup = with_stepper(shortened(polish(PINCHED), 1500), "fast")
    once, twin = simulate_setup(setup), simulate_setup(nudged(setup))
    monkeypatch.setattr("reference.simulation.LEDGER_ROWS", 300)
    again = simulate_setup(setup)
    period = setup.model.length_x
    bound = allowed(1500, once.positions, twin.positions, period, period)
    assert len(once.contacts) > 3000
    assert len(again.contacts) == len(once.contacts)
    assert apart(again.positions, once.positions, period) <= bound < 1e-3 * setup.state.diameter.min()


def test_balances_of_mass_and_volume_close_and_the_others_are_left_out(loop):
    run = simulate_setup(with_stepper(shortened(polish(HELD), 1500), "fast"))
    assert run.history["removals"].iloc[-1] > 0
    assert set(run.provenance["balances"]) == {"mass", "removed_mass", "volume"}
    assert run.history["contact_loss"].isna().all()


@kernel
def compiled_impulse(*numbers):
    """`pairs.impulse_on_first` as it is compiled; called from Python it would be Python."""
    return impulse_on_first(*numbers)


@kernel
def compiled_durations(contacts, bits):
    """Durations of a batch as they are compiled; `bits` is the memory of the batch as integers."""
    guess_durations(bits, LANES)
    durations(contacts, LANES)


@given(
    m_i=st.floats(1e-16, 1e-14), m_j=st.floats(1e-16, 1e-14), restitution=st.floats(0.0, 1.0),
    static=st.floats(0.0, 1.0), share=st.floats(0.0, 1.0), duration=st.floats(1e-10, 1e-7), data=st.data(),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_the_short_form_of_an_impulse_is_that_of_the_equations(
    m_i, m_j, restitution, static, share, duration, data
):
    """Against `collisions.pair_impulse`; each form rounds its terms some ten times."""
    component = st.floats(-1.0, 1.0)
    vector = st.tuples(component, component, component)
    n = np.array(data.draw(vector.filter(lambda v: np.linalg.norm(v) > 0.1)))
    n /= np.linalg.norm(n)
    v = np.array(data.draw(vector))
    if v @ n >= 0.0:
        v = v - 2.0 * (v @ n) * n - 1e-3 * n
    forces = [1e-9 * np.array(data.draw(vector)) for _ in range(2)]
    model = build_setup(polish(HELD)).model._replace(
        restitution=restitution, static_friction=static, dynamic_friction=share * static,
        impact_duration=duration,
    )  # fmt: skip
    dt = 9e-9
    full = pair_impulse(
        model, dt, m_i, m_j, 9e-7, 9e-7, 1e11, tuple(n), tuple(v), float(v @ n), *map(tuple, forces)
    )
    m_eff = m_i * m_j / (m_i + m_j)
    short = compiled_impulse(
        restitution, static, share * static, m_eff, min(duration, dt), float(v @ n), *n, *v,
        *(forces[0] / m_i - forces[1] / m_j),
    )  # fmt: skip
    sizes = m_eff * (
        np.abs(v).sum() + dt * sum(np.abs(f).sum() / m for f, m in zip(forces, (m_i, m_j), strict=True))
    )
    slip_over_limit = full[4] > 0.0 and np.isclose(full[4], static * full[3], rtol=1e-9)
    if not slip_over_limit:  # at the very border one may stick and the other slip
        np.testing.assert_allclose(short, full[:3], rtol=0.0, atol=64 * EPS * sizes)


def test_durations_by_newton_are_those_of_the_power():
    """Over thirty decades of q; the last of Newton's steps leaves its own round-off, some 8 eps."""
    radius, modulus, mass = 2e-7, 1.9e11, 7e-16
    contacts = batch()
    for speeds in np.logspace(-12, 3, 20 * LANES).reshape(-1, LANES):
        contacts[B.hertz : B.hertz + LANES] = radius * modulus**2 * speeds / mass**2
        compiled_durations(contacts, contacts.view(np.int64))
        np.testing.assert_allclose(
            contacts[B.duration : B.duration + LANES], impact_duration(mass, radius, modulus, speeds),
            rtol=16 * EPS, atol=0.0,
        )  # fmt: skip


@pytest.mark.parametrize(("shape", "reach"), [((7, 5), 0.9), ((7, 5), 2.0), ((4, 3), 6.3), ((1, 6), 1.5)])
def test_the_ceiling_is_the_highest_node_that_a_sphere_within_reach_can_touch(shape, reach):
    """Squares of side 1 that a sphere over the square overlaps, `reach` away at most, with their nodes."""
    heights = np.random.default_rng(3).normal(size=shape)
    found = ceiling_over(heights, 1.0, reach)
    span = int(np.ceil(reach))
    assert found.reach == span
    for a, b in np.ndindex(shape):
        rows = np.arange(a - span, a + span + 2) % shape[0]
        columns = np.arange(b - span, b + span + 2) % shape[1]
        assert found.height[a, b] == heights[np.ix_(rows, columns)].max()
    assert heights[highest_node(heights)] == heights.max()


BARE = """
import json, sys
import numpy as np
sys.path.insert(0, "tests")
from test_fast import HELD, polish
import reference.fast.stepper
from cmpcheck.components.steppers import shortened, with_stepper
from reference.simulation import simulate_setup
reference.fast.few.REMAP = reference.fast.many.REMAP = 20  # steps, after which the surface is mapped anew
reference.fast.stepper.MANY = int(sys.argv[1])  # particles, from which on the loop for many moves them
reference.fast.many.GROUP = int(sys.argv[2])  # particles of a group, at most
reference.fast.groups.PIECE, reference.fast.pieces.CHUNK = 8, 1  # several pieces and chunks
run = simulate_setup(with_stepper(shortened(polish(HELD), 60), "fast"))
print(json.dumps([run.positions.tolist(), len(run.contacts)]))
"""


@pytest.mark.parametrize(("many", "group"), [(MANY, MANY), (1, MANY), (1, 3), (1, 1)])
def test_the_same_without_the_jit(many, group, monkeypatch):
    """60 steps in plain Python, to the round-off that the order of sums in vectors leaves.

    There the map of the surface's maxima is made anew every 20 steps, what compiled code does every 16 384;
    and groups that must not be larger than 3 are found with less skin, or for one step, and where there are
    none, because two may not touch, the plain stepper goes on.
    """
    monkeypatch.setattr("reference.fast.stepper.MANY", many)
    found = subprocess.run(
        [sys.executable, "-c", BARE, str(many), str(group)], env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    positions, contacts = json.loads(found.stdout)
    setup = with_stepper(shortened(polish(HELD), 60), "fast")
    run, twin = simulate_setup(setup), simulate_setup(nudged(setup))
    bound = allowed(60, run.positions, twin.positions, setup.model.length_x)
    assert contacts == len(run.contacts)
    assert apart(run.positions, np.array(positions)) <= bound < 1e-9 * setup.model.length_x


def test_nothing_is_compiled_that_may_be_rounded_otherwise_by_another_compiler():
    """No operations fused or in another order: what is taken as given is NaN and the sign of a zero alone."""
    found = []
    for path in sorted(Path(reference.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.keyword) and node.arg == "fastmath":
                found.append((path.name, ast.literal_eval(node.value)))
    assert found == [("sweep.py", {"nsz", "nnan"})]
