"""Removal at new contacts only: a particle that stays pressed on the surface removes when it arrives."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from test_simulation import FLAT, ball, drop, make, rain

from cmpcheck.engines import lammps
from cmpcheck.engines.lammps_library import EngineError
from reference.process import build_setup
from reference.simulation import simulate

SHEAR = {"density": 1000.0, "viscosity": 1e-3, "flow": "couette"}
GAMMAS = (0.02, 0.01)  # steps of 16 and 8 ns


def wedged(new_only: bool, gamma: float):
    """A sphere that the flow drives between the flank of an asperity and a held pad, where it stays."""
    rough = FLAT | {"kind": "asperities", "asperity_height": 0.5e-6, "raised": [[3, 2], [3, 3]]}
    return simulate(
        make(
            case={"name": "t", "title": "", "description": "", "duration": 20e-6, "outputs": 3},
            particle=[ball((1.0e-6, 3.1e-6, 0.6e-6), (0.5, 0, 0), 0.8e-6)],
            surface=rough,
            fluid=SHEAR,
            pad={"speed": 1.0, "initial_height": 1.1e-6, "minimum_height": 1.1e-6},
            removal={
                "deposit": "node_depth", "acceleration": 1e-30, "mass_pickup": False,
                "threshold_velocity": 0.05, "new_contacts_only": new_only,
            },
            numerics={"gamma": gamma},
        )
    )  # fmt: skip


def removals(run) -> int:
    return int(run.history.removals.iloc[-1])


def test_a_wedged_particle_goes_on_removing_unless_only_new_contacts_do():
    always, new = (wedged(only, GAMMAS[1]) for only in (False, True))
    assert removals(always) > 20 * removals(new) > 0


def test_new_contacts_depend_little_on_the_step_where_all_impacts_double():
    always, new = ([removals(wedged(only, gamma)) for gamma in GAMMAS] for only in (False, True))
    assert always[1] > 1.5 * always[0]
    assert abs(new[1] - new[0]) <= 2  # a bounce more or less above the threshold


def test_the_rule_changes_what_is_removed_and_not_the_motion():
    always, new = (wedged(only, GAMMAS[0]) for only in (False, True))
    assert np.array_equal(always.positions, new.positions)
    assert always.history.contacts.equals(new.history.contacts)
    kept = ["time", "approach_speed", "normal_impulse", "load"]
    pd.testing.assert_frame_equal(always.contacts[kept], new.contacts[kept])


@pytest.mark.parametrize("case", [lambda **k: drop(1.0, **k), lambda **k: rain(removal=k)])
def test_particles_that_come_from_free_flight_remove_as_ever(case):
    always, new = (simulate(case(new_contacts_only=only)) for only in (False, True))
    assert removals(new) > 0
    pd.testing.assert_frame_equal(always.contacts, new.contacts)
    assert np.array_equal(always.surface.z, new.surface.z)


def test_a_scheme_whose_steps_differ_is_refused():
    with pytest.raises(ValueError, match=r"looks back by one step.*fixed_point"):
        rain(removal={"new_contacts_only": True}, numerics={"time_step": 1e-9, "scheme": "fixed_point"})
    rain(removal={"new_contacts_only": False}, numerics={"time_step": 1e-9, "scheme": "fixed_point"})


def test_lammps_refuses_the_rule_that_its_fix_does_not_have():
    setup = build_setup(drop(1.0, new_contacts_only=True))
    with pytest.raises(EngineError, match="new_contacts_only"):
        lammps.refuse_rules_it_lacks(setup)
