"""The pad inside LAMMPS: its descent, its contact in both forms, and the flow that it drags along."""

import math

import numpy as np
import pytest
import test_fix
from scipy.integrate import solve_ivp
from test_fix import (
    EPS,
    MASS,
    RADIUS,
    T_C,
    attach,
    everything,
    granular,
    last_velocity,
    make_model,
    run_ranks,
    scatter,
    simulate,
)

from cmpcheck.engines.lammps_library import EngineError, available
from reference.ledger import ledger_frame
from reference.schemes import Numerics
from reference.state import DEPOSIT_NODE_DEPTH, FLOW_COUETTE, Particles
from reference.timestep import DONE, P, advance, new_progress

pytestmark = pytest.mark.skipif(not available()[0], reason=available()[1])

DESCENT = 0.7  # m/s
PAD = {"has_pad": True, "pad_restitution": 0.5, "pad_descent": DESCENT, "pad_minimum": 0.1e-6}
TOP = 8e-6  # m, height of the pad where it meets rising particles


def rise(dt, form, speed=1.0, **changes):
    """16 particles rise to the descending pad at 16 sub-step phases; the contact is over after 4 t_c."""
    model = make_model(**{"has_surface": False} | PAD | changes)
    gap = (speed + DESCENT) * dt * 1e6 * (2.0 + (np.arange(16) + 0.5) / 16.0)
    z = TOP * 1e6 - RADIUS * 1e6 - gap
    positions = np.column_stack([0.3 + 0.6 * np.arange(16), np.full(16, 5.0), z])
    steps = round(4 * T_C / dt)
    velocities = [(0.3, 0.0, speed)] * 16
    return simulate(positions, velocities, dt, steps, model, form=form, sample_every=steps, pad_height=TOP)


@pytest.mark.nojit
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_an_impulsive_bounce_on_the_descending_pad_is_exact(restitution):
    fix = rise(T_C / 10, "impulse", pad_restitution=restitution)
    contacts, approach = fix.contacts(), 1.0 + DESCENT
    after = 1.0 - (1.0 + restitution) * approach
    # As for the surface: 12 roundings of at most eps/2 of the largest speed, approach here.
    np.testing.assert_allclose(last_velocity(fix)[:, 2], after, rtol=0.0, atol=12 * EPS)
    np.testing.assert_array_equal(last_velocity(fix)[:, 0], 0.3)  # no friction
    np.testing.assert_allclose(contacts.approach_speed, approach, rtol=EPS, atol=0.0)
    j = (1.0 + restitution) * approach * MASS
    np.testing.assert_allclose(contacts.normal_impulse, j, rtol=8 * EPS, atol=0.0)
    np.testing.assert_allclose(
        contacts.energy_lost, 0.5 * MASS * (1.0 - after**2), rtol=0, atol=20 * EPS * MASS
    )
    assert (contacts.kind == "pad").all()
    assert contacts.i.tolist() == list(range(16))
    assert contacts[["j", "nx", "ny", "nz"]].drop_duplicates().to_numpy().tolist() == [[-1, 0, 0, -1]]
    height = TOP - DESCENT * contacts.time
    np.testing.assert_allclose(contacts.z, height, rtol=40 * EPS, atol=0.0)  # 40 steps


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8])
def test_a_soft_bounce_on_the_descending_pad_converges_at_second_order_in_the_mean(restitution):
    exact, errors = 1.0 - (1.0 + restitution) * (1.0 + DESCENT), []
    for steps_per_contact in (25, 50, 100):
        fix = rise(T_C / steps_per_contact, "soft", pad_restitution=restitution)
        after = last_velocity(fix)[:, 2]
        errors.append(abs(after.mean() - exact))
        contacts = fix.contacts()
        assert contacts.kind.tolist() == ["pad"] * 16
        # One impulse is one change of momentum, its work one change of energy: 200 additions each.
        np.testing.assert_allclose(contacts.normal_impulse, MASS * (1.0 - after), rtol=200 * EPS, atol=0.0)
        lost = 0.5 * MASS * (1.0 - after**2)
        np.testing.assert_allclose(contacts.energy_lost, lost, rtol=0.0, atol=400 * EPS * MASS)
        assert abs(contacts.contact_time.mean() - T_C) < 0.5 * T_C / steps_per_contact
    # As on the surface: the dashpot switches on between two steps, second order in the mean over phases.
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(2.0, abs=0.1)


PEAK = (5, 5)  # the node that stops the pad until it is worn


def peak():
    """A model and a start in which a particle wears the highest node of the surface under the pad."""
    model = make_model(
        **PAD | {"pad_descent": 3.0, "pad_minimum": 0.9e-6}, deposit=DEPOSIT_NODE_DEPTH, acceleration=100.0
    )
    heights = np.zeros((10, 10))
    heights[PEAK], heights[2, 2] = 0.5e-6, 0.45e-6
    positions = [(4.4, 5.0, 0.8), (1.0, 8.0, 0.6), (8.0, 2.0, 0.9)]
    velocities = [(0.0, 0.0, -1.5), (0.5, 0.1, 0.3), (-0.2, 0.3, -0.8)]
    return model, heights, positions, velocities


def test_pad_and_surface_descend_as_in_the_reference():
    """Without a fluid the impulse form takes the reference's own steps: all differs by rounding only."""
    model, heights, positions, velocities = peak()
    dt, steps, height = T_C / 5, 1000, 1.5e-6
    fix = simulate(
        positions, velocities, dt, 0, model, heights=heights, form="impulse", pad_height=height,
        sample_every=1, max_samples=steps + 1,
    )  # fmt: skip
    ours, tops = [fix.pad_height], [heights.max()]
    for _ in range(steps):
        fix.lmp.command("run 1 post no")
        ours.append(fix.pad_height)
        tops.append(fix.heights.max())
    fix.check()
    n = len(positions)
    p = Particles(
        1e-6 * np.array(positions), np.array(velocities), np.full(n, MASS), np.full(n, 2.0 * RADIUS),
        np.full(n, 3.9e11),
    )  # fmt: skip
    numerics = Numerics(dt, False, 1e-6, 8, False, False, 0.0)
    progress, rows, theirs = new_progress(), np.zeros((4096, len(fix.memory.rows[0]))), [height]
    progress[P.pad_height] = height
    for step in range(steps):
        assert advance(model, numerics, progress, (step + 1) * dt, 1, p, heights, rows) == DONE
        theirs.append(progress[P.pad_height])
    # Positions gain eps at each step, impulses repeat it: 1000 steps, and a rebound no more than doubles it.
    np.testing.assert_allclose(ours, theirs, rtol=4 * steps * EPS, atol=0.0)
    np.testing.assert_allclose(fix.trajectory()[1][-1], p.position, rtol=0.0, atol=4 * steps * EPS * 10e-6)
    ledger = ledger_frame(rows[: int(progress[P.rows])])
    ledger = ledger.sort_values(["time", "i", "j", "kind"], ignore_index=True)
    contacts = fix.contacts()
    contacts = contacts[contacts.time < (steps - 0.5) * dt]  # LAMMPS also evaluates the last instant
    assert contacts.kind.tolist() == ledger.kind.tolist()
    assert {"pad", "surface"} <= set(contacts.kind)
    # The peak has held the pad, and has been worn while it did.
    held = np.isclose(ours[1:], np.array(tops[:-1]) + RADIUS, rtol=4 * EPS, atol=0.0)
    assert held.any()
    assert not held.all()
    assert min(ours) < 0.5e-6 + RADIUS - 1e-9


def test_the_pad_stops_at_its_lowest_height():
    model = make_model(**PAD | {"has_surface": False, "pad_minimum": 6e-6})
    fix = simulate([(5.0, 5.0, 1.0)], [(0.0, 0.0, 0.0)], 1e-9, 100, model, pad_height=6.5e-6)
    assert fix.pad_height == pytest.approx(6.5e-6 - 100e-9 * DESCENT, rel=100 * EPS, abs=0.0)
    fix.lmp.command("run 1000")
    assert fix.pad_height == 6e-6


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("form", ["impulse", "soft"])
def test_a_pad_that_has_stopped_is_a_wall_at_rest(form, compiled):
    """V_z counts in an impact only while the pad descends."""
    approach = []
    for lowest in (TOP, TOP - 1e-6):
        model = make_model(**{"has_surface": False} | PAD | {"pad_minimum": lowest})
        z = TOP * 1e6 - RADIUS * 1e6 - 0.01
        fix = simulate([(5.0, 5.0, z)], [(0.0, 0.0, 1.0)], 1e-9, 60, model, form=form, pad_height=TOP,
                       compiled=compiled)  # fmt: skip
        approach.append(float(fix.contacts().approach_speed.iloc[0]))
    np.testing.assert_allclose(approach, [1.0, 1.0 + DESCENT], rtol=8 * EPS, atol=0.0)


def test_the_flow_is_that_of_the_height_at_each_step():
    """A particle between wall and pad follows u = V z/H as H shrinks, at second order in the step."""
    model = make_model(**PAD | {"pad_descent": 5.0}, flow=FLOW_COUETTE, wall_speed=1.0, fluid_density=1.0)
    tau = 3950.0 * (2.0 * RADIUS) ** 2 / (18.0 * model.viscosity)
    z, top, end = 4e-6, 8e-6, 2.0 * tau

    def slope(t, v):
        return (z / (top - 5.0 * t) - v) / tau

    exact = solve_ivp(slope, (0.0, end), [0.5], rtol=1e-11, atol=1e-13).y[0, -1]
    errors = []
    for steps in (40, 80):
        fix = simulate(
            [(5.0, 5.0, z * 1e6)], [(0.5, 0.0, 0.0)], end / steps, steps, model, sample_every=steps,
            pad_height=top,
        )  # fmt: skip
        errors.append(abs(last_velocity(fix)[0, 0] - exact))
    assert errors[0] < 1e-3 * (exact - 0.5)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def squeezed(form, compiled=True, pairs=False, **options):
    """16 particles between a bumpy surface that wears and the pad that descends on them."""
    positions, velocities, heights = scatter(5)
    velocities[:, 2] *= np.where(np.arange(16) % 2, 1.0, -1.0)
    if pairs:
        velocities[:, 0] *= 6.0
    model = make_model(
        **PAD | {"pad_descent": 2.0, "pad_minimum": 1.05e-6}, deposit=DEPOSIT_NODE_DEPTH, acceleration=5.0,
        flow=FLOW_COUETTE, wall_speed=1.0, fluid_density=1.0,
    )  # fmt: skip
    deck = granular(friction=0.3) if pairs else None
    return simulate(
        positions, velocities, T_C / 5, 1500, model, heights=heights, form=form, sample_every=50,
        compiled=compiled, pad_height=1.25e-6, deck_options=deck, observe_pairs=pairs, **options,
    )  # fmt: skip


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
@pytest.mark.parametrize("pairs", [False, True])
def test_compiled_and_plain_form_agree_with_a_pad(form, pairs):
    compiled, plain = (squeezed(form, compiled, pairs) for compiled in (True, False))
    counts = compiled.contacts().kind.value_counts()
    assert counts["pad"] >= 8
    assert counts["surface"] >= 8
    assert not pairs or counts["pair"] >= 1
    assert compiled.pad_height == plain.pad_height < 1.25e-6
    for a, b in zip(everything(compiled), everything(plain), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("compiled", [True, False])
def test_an_impulse_of_the_pad_waits_for_a_pair_force(compiled):
    # A particle at the pad is struck from below and pressed on for about one contact duration.
    z = TOP * 1e6 - RADIUS * 1e6 + 1e-4
    model, dt = make_model(**PAD | {"has_surface": False, "pad_descent": 1e-6}), T_C / 100
    fix = simulate(
        [(5.0, 5.0, z), (5.0, 5.0, z - 1.0)], [(0.0, 0.0, -2e-6), (0.0, 0.0, 1.0)], dt, 400, model,
        form="impulse", observe_pairs=True, deck_options=granular(1.0), compiled=compiled, pad_height=TOP,
    )  # fmt: skip
    contacts = fix.contacts()
    pad, pair = (contacts[contacts.kind == kind].iloc[0] for kind in ("pad", "pair"))
    # Equal masses, e = 1: all of the momentum has arrived when the pair force ends, not the part at first.
    assert pad.approach_speed == pytest.approx(1.0, rel=1e-3, abs=0.0)
    assert pad.time == pytest.approx(pair.time + dt, abs=2 * dt)


def test_slow_contacts_that_remove_nothing_leave_no_row():
    contacts = squeezed("impulse").contacts()
    speed = float(contacts.approach_speed.median())
    kept = (contacts.approach_speed >= speed) | (contacts.removed_volume > 0.0)
    assert 0 < kept.sum() < len(kept)
    fast = squeezed("impulse", ledger_speed=speed).contacts()
    assert fast.equals(contacts[kept].reset_index(drop=True))


def test_a_pad_without_a_height_is_refused():
    with pytest.raises(EngineError, match="pad_height = nan"):
        attach(None, 1, make_model(**PAD))


RANKS_SCRIPT = """
import hashlib, json, sys
sys.path[:0] = {paths!r}
from mpi4py import MPI
from test_pad import *
said = []
for form in ("soft", "impulse"):
    fix = squeezed(form)
    kinds = fix.contacts().kind.value_counts()
    said.append(hashlib.sha256(b"".join(a.tobytes() for a in everything(fix))).hexdigest())
    said.append([fix.pad_height, int(kinds["pad"]), int(kinds["surface"])])
everyone = MPI.COMM_WORLD.gather(said)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(everyone))
"""


def test_two_ranks_give_the_same_bits_as_one_under_a_pad(tmp_path, monkeypatch):
    monkeypatch.setattr(test_fix, "RANKS_SCRIPT", RANKS_SCRIPT)
    (one,) = run_ranks(1, tmp_path)
    first, second = run_ranks(2, tmp_path)
    assert one == first == second
    assert min(one[1][1:]) >= 8
    assert math.isfinite(one[1][0])
