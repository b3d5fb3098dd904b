"""The fast stepper with as many particles as are shared out among threads: several chunks of pieces."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from numba.core.caching import NullCache
from test_components import wrong
from test_fast import sorted_ledger

from cmpcheck import components
from cmpcheck.components import steppers
from cmpcheck.components.steppers import COARSER, allowed, apart, crowded, nudged, shortened, with_stepper
from cmpcheck.suite import run_work
from cmpcheck.suite_parts import ComponentTask
from reference.fast.groups import PIECE
from reference.fast.known import COLUMNS, K, note_way
from reference.fast.pieces import CHUNK, share_out
from reference.fast.swarm import MANY
from reference.fast.threads import most_threads, use_threads
from reference.heightfield import surface_contact
from reference.pad import lowest_pad_height
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup

COUNT, STEPS = 5000, 200


def crowd(coarser: int, pairs: bool = True) -> Setup:
    """The layer of `polish_pair` with more particles, under a pad so low that many touch it."""
    changes = {
        "pad": {"initial_height": 1.25e-6}, "numerics": {"tolerance": 1e-15}, "contact": {"pairs": pairs}
    }  # fmt: skip
    return shortened(crowded(COUNT, changes, coarser), STEPS)


def waits(run: Run) -> bool:
    """Whether the pad descends, but not in the first 20 steps."""
    height = run.history["pad_height"]
    return bool(height.iloc[2] == height.iloc[0] > height.iloc[-1])


def touches_nobody(setup: Setup) -> bool:
    """Whether no particle touches the surface at the start."""
    state, spacing = setup.state, setup.model.spacing
    return not any(
        surface_contact(state.heights, spacing, *position, 0.5 * diameter)[0]
        for position, diameter in zip(state.position, state.diameter, strict=True)
    )


def held_up() -> Setup:
    """Without pairs, and with a pad that waits for one node to fall, which is on the way of a particle.

    Then it descends by 9e-12 m a step: who sees the node too early or too late sees another flow.
    """
    setup = crowd(COARSER, pairs=False)
    setup = replace(setup, output_times=np.linspace(0.0, setup.end_time, STEPS // 10 + 1))
    state, model = setup.state, setup.model._replace(pad_descent=1e-3)
    hits = simulate_setup(setup).contacts.query("removed_volume > 0.0")
    for x, y in hits[["x", "y"]].to_numpy():
        heights = state.heights.copy()
        node = np.rint(np.array([x, y]) / model.spacing).astype(int) % heights.shape
        heights[tuple(node)] = state.pad_height - 0.5 * state.diameter.max()
        assert lowest_pad_height(model, heights.max(), state.diameter.max()) == state.pad_height
        made = replace(setup, state=replace(state, heights=heights), model=model)
        if touches_nobody(made) and waits(simulate_setup(made)):
            return made
    raise AssertionError("no node holds the pad for some steps")


def withdrawn() -> Setup:
    """So soft a surface, and nodes so far apart, that who falls onto it often changes where others touch it.

    Then a piece has removed something, and others of it have looked there, before it is moved again with
    somebody of another piece and does not remove it any more: at 2191d00, which did not look for these, two
    removals were missing and positions off by 6e-8 m.
    """
    setup = crowd(3 * COARSER)
    velocity = setup.state.velocity + np.random.default_rng(2).standard_normal(setup.state.velocity.shape)
    model = setup.model._replace(yield_stress=3e7)
    return replace(setup, model=model, state=replace(setup.state, velocity=velocity))


@pytest.mark.parametrize(
    "make, removals",
    [(lambda: crowd(1), 512), (lambda: crowd(COARSER), 512), (held_up, 512), (withdrawn, 256)],
    ids=["fine", "coarse", "held_up", "withdrawn"],
)
def test_many_particles_follow_the_answer_key_to_round_off(make, removals):
    """The bound is that of `steppers.allowed`; here there is more than one chunk of pieces for threads.

    Where triangles of the surface are larger than particles, several touch one that falls.
    """
    follows_the_answer_key(make(), removals)


def test_who_goes_farther_than_it_may_misses_nobody(monkeypatch):
    """Ways are too short by 0.6 diameters a pair, so that most contacts are of two that have strayed."""
    monkeypatch.setattr("reference.fast.known.LEEWAY", -0.3)
    follows_the_answer_key(crowd(COARSER), 512)


def test_one_that_goes_its_diameter_in_a_step_is_moved_by_the_loop_for_many(monkeypatch):
    """Blocks of one step then, of which the answer key makes none."""
    setup = crowd(COARSER)
    setup.state.velocity[0] = 100.0, 0.0, 0.0
    assert 100.0 * setup.time_step >= 0.8 * setup.state.diameter[0]
    monkeypatch.setattr("reference.fast.stepper.advance", None)
    follows_the_answer_key(setup, 512)


def test_the_way_of_a_particle_counts_the_step_that_threw_it_out_of_its_box():
    """At 2 m/s at most for 10 steps, and at 5 in the last of them, which a new box tells afterwards."""
    known = np.zeros(2 * COLUMNS)
    known[COLUMNS + K.gone], known[COLUMNS + K.since] = 1.0, 7
    note_way(known, 1, 17, 0.5, 5.0, 2.0)
    assert known[COLUMNS + K.gone] == 1.0 + 0.5 * (9 * 2.0 + 5.0)
    assert known[COLUMNS + K.since] == 17
    assert (known[:COLUMNS] == 0.0).all()


def follows_the_answer_key(setup: Setup, removals: int) -> None:
    """Whether the fast stepper does what the plain one does, and removes more often than asked."""
    assert COUNT >= MANY
    assert COUNT > 2 * CHUNK * PIECE
    plain, fast, twin = map(simulate_setup, (setup, with_stepper(setup, "fast"), nudged(setup)))
    period = setup.model.length_x
    bound_x = allowed(STEPS, plain.positions, twin.positions, period, period)
    bound_v = allowed(STEPS, plain.velocities, twin.velocities, np.abs(plain.velocities).max())
    assert bound_x < 1e-3 * setup.state.diameter.min()
    assert apart(fast.positions, plain.positions, period) <= bound_x
    assert apart(fast.velocities, plain.velocities) <= bound_v
    assert fast.history["pad_height"].equals(plain.history["pad_height"])
    assert fast.history["contacts"].iloc[-1] == plain.history["contacts"].iloc[-1] > 2048
    assert fast.history["removals"].iloc[-1] == plain.history["removals"].iloc[-1] > removals
    ours, theirs = sorted_ledger(fast), sorted_ledger(plain)
    for column in ("kind", "i", "j"):
        assert (ours[column] == theirs[column]).all()


DIGESTS = """
import hashlib, itertools, sys
sys.path.insert(0, "tests")
from test_threads import crowd
from pandas.util import hash_pandas_object
from cmpcheck.components.steppers import with_stepper
from reference.fast.threads import use_threads
from reference.simulation import simulate_setup
for coarser, threads in itertools.product((1, 4), (1, 2, 3, 7)):
    use_threads(threads)
    run = simulate_setup(with_stepper(crowd(coarser), "fast"))
    ledger = hash_pandas_object(run.contacts).to_numpy()
    found = b"".join(a.tobytes() for a in (run.positions, run.velocities, run.masses, run.surface.z, ledger))
    print(coarser, len(ledger), hashlib.sha256(found).hexdigest())
"""


def test_the_result_is_the_same_to_the_bit_for_any_number_of_threads():
    done = subprocess.run(
        [sys.executable, "-c", DIGESTS], env=os.environ | {"NUMBA_NUM_THREADS": "7"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    found = done.stdout.splitlines()
    assert len(found) == 8
    assert len(set(found[:4])) == len(set(found[4:])) == 1


def test_no_threaded_loop_is_kept_on_disk_by_itself():
    """Else the kernel around it, compiled by a second process, crashes in a third one: `threads.threaded`."""
    assert share_out.targetoptions["parallel"]
    assert isinstance(share_out._cache, NullCache)


def test_rows_of_many_particles_agree_and_stand_in_the_full_profile_alone(monkeypatch):
    monkeypatch.setattr(components, "PARTS", ())
    quick, full = (run_work(ComponentTask(("reference",), name)).comparisons for name in ("quick", "full"))
    assert quick == []
    assert {row.variant for row in full} == {steppers.VARIANT_OF_MANY}
    assert wrong(full) == set()


@pytest.mark.parametrize("part, by", [(steppers.checks, 1e-9), (steppers.checks_of_many, 1e-7)])
def test_twin_a_pad_that_is_lower_in_the_fast_stepper_is_seen(part, by, monkeypatch):
    """By 1e-9 of its height, or 1e-7: it changes the flow of 3 m/s by 3e-7 m/s, and the bound is 5e-8 m/s."""
    right = steppers.with_stepper

    def lower(given, stepper):
        state = replace(given.state, pad_height=given.state.pad_height * (1.0 - by))
        return right(replace(given, state=state), stepper)

    monkeypatch.setattr(steppers, "with_stepper", lower)
    assert {"fast_position", "fast_velocity"} <= wrong(part())


def test_threads_that_the_machine_does_not_have_are_refused():
    with pytest.raises(ValueError, match=f"allowed: 1 to {most_threads()}"):
        use_threads(most_threads() + 1)
    with pytest.raises(ValueError, match="allowed: 1 to"):
        use_threads(0)
