"""The fast stepper against the answer key: step by step to round-off, and as statistics where chaos parts them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polish_example import small_polish

from reference.case import Case, load_case
from reference.toml_source import CaseError
from reference.collisions import pair_impulse
from reference.contact import impact_duration
from reference.fast.pairs import hertz_durations, impulse_on_first
from reference.fast.stepper import advance_fast
from reference.heightfield import surface_contact
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup
from reference.timestep import ROUNDINGS

EPS = float(np.finfo(float).eps)
HELD = {"pad": {"initial_height": 1.2e-6, "minimum_height": 1.2e-6}}  # pad at rest: V_z = 0
PINCHED = {"pad": {"initial_height": 1.05e-6, "minimum_height": 1.02e-6}}
CASES = {
    "descending_pad": {"pad": {"initial_height": 1.2e-6}},
    "pad_at_rest": HELD,
    "pinched": PINCHED,
    "volume": HELD | {"removal": {"deposit": "volume", "acceleration": 1e5}},
    "carried_away": HELD | {"removal": {"mass_pickup": False}},
    "heavy": HELD | {"removal": {"threshold_velocity": 0.0}, "material": {}},
    "reynolds_above_1": HELD | {"pad": HELD["pad"] | {"speed": 6.0}, "numerics": {"gamma": 0.06}},
    "constant_duration": HELD | {"contact": {"impact_duration": 2e-9}},
    "without_pairs": HELD | {"contact": {"pairs": False}},
    "new_contacts_only": HELD | {"removal": {"new_contacts_only": True}},
}


def polish(changes: dict) -> Case:
    raw = {name: dict(keys) for name, keys in changes.items() if keys}
    case = small_polish(**raw)
    # a drag that is iterated to round-off: the fast stepper's linear one needs no iteration
    return case.model_copy(update={"numerics": case.numerics.model_copy(update={"tolerance": 1e-15})})


def shortened(case: Case, steps: int) -> Setup:
    setup = build_setup(case)
    end = steps * setup.time_step
    return replace(setup, end_time=end, output_times=np.array([0.0, 0.4 * end, end]))


def nudged(setup: Setup) -> Setup:
    """The same setup with positions and velocities changed by one unit in the last place."""
    rng = np.random.default_rng(5)
    state = setup.state
    return replace(
        setup,
        state=replace(
            state,
            position=state.position * (1.0 + EPS * rng.choice([-1, 1], state.position.shape)),
            velocity=state.velocity * (1.0 + EPS * rng.choice([-1, 1], state.velocity.shape)),
        ),
    )


def with_stepper(setup: Setup, stepper: str) -> Setup:
    numerics = setup.case.numerics.model_copy(update={"stepper": stepper})
    return replace(setup, case=setup.case.model_copy(update={"numerics": numerics}))


def sorted_ledger(run: Run):
    return run.contacts.sort_values(["time", "kind", "i", "j"], ignore_index=True)


def apart(a: np.ndarray, b: np.ndarray, period: float = 0.0) -> float:
    away = np.abs(a - b)
    return float(np.minimum(away, np.abs(period - away)).max() if period else away.max())


@pytest.mark.parametrize("name", CASES)
def test_the_fast_stepper_follows_the_answer_key_to_round_off(name):
    """1500 steps with contacts in nearly all of them.

    A step rounds each component less than ROUNDINGS times, by eps of its size (`timestep.round_off`), as
    nudging the start by eps does once.  What is rounded in any step grows no more than what is rounded in the
    first, so that two programs that are both right differ by less than steps x 2 ROUNDINGS times what the
    nudged twin does, which grows from the start.  The twin's own growth is taken from its largest
    difference, and the smallest that it can show is eps of the box.
    """
    setup = shortened(polish(CASES[name]), 1500)
    plain = simulate_setup(setup)
    fast = simulate_setup(with_stepper(setup, "fast"))
    twin = simulate_setup(nudged(setup))
    grown = 2 * ROUNDINGS * 1500
    period = setup.model.length_x
    bound_x = grown * max(apart(plain.positions, twin.positions, period), EPS * period)
    bound_v = grown * max(apart(plain.velocities, twin.velocities), EPS * np.abs(plain.velocities).max())
    print(name, len(plain.contacts), bound_x, bound_v, apart(fast.positions, plain.positions, period))
    assert bound_x < 1e-3 * setup.state.diameter.min()  # else the comparison would say nothing
    assert apart(fast.positions, plain.positions, period) <= bound_x
    assert apart(fast.velocities, plain.velocities) <= bound_v
    assert len(np.unique(plain.contacts["time"])) > 1000  # steps with a contact
    ours, theirs = sorted_ledger(fast), sorted_ledger(plain)
    for column in ("kind", "i", "j"):
        assert (ours[column] == theirs[column]).all()
    assert fast.history["contacts"].iloc[-1] == plain.history["contacts"].iloc[-1]
    assert fast.history["removals"].iloc[-1] == plain.history["removals"].iloc[-1]
