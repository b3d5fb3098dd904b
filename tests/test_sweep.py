"""The fix's one loop over all particles against what each of them gets by itself."""

import numpy as np
import pytest

from cmpcheck.fixes.layout import (
    CLEARANCE,
    EVALUATED,
    FORCE,
    GIVEN_COLUMNS,
    MICRO,
    NO_ERROR,
    PAD,
    PHASE,
    PICOGRAM,
    START,
    STATE_COLUMNS,
    TOUCHING,
    WAITING,
)
from cmpcheck.fixes.local import NO_CONTACT, show_contacts, waiting_since, way_since
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.particles import advance_particles
from reference.case import load_case
from reference.process import build_setup

STEP, TIME_STEP = 7, 6e-11
FAST = 1.5  # m/s: some slips are above Re = 1, where they are about 1.1 m/s


def layer(calm=True):
    """`polish` as it starts: setup, and the arrays of LAMMPS for it, in its units, at a later step.

    Its particles move with the fluid, or else some faster than Stokes's law goes.
    """
    setup = build_setup(load_case("polish"))
    state, n = setup.state, len(setup.state.mass)
    velocity = state.velocity.copy()
    if not calm:
        velocity += FAST * np.random.default_rng(0).uniform(-1.0, 1.0, (n, 3))
    given = np.zeros((n, GIVEN_COLUMNS))
    given[:, EVALUATED] = STEP  # of the step before, plus one
    return setup, [
        np.arange(1, n + 1, dtype=np.int32), state.position / MICRO, velocity, np.zeros((n, 3)),
        state.diameter / 2 / MICRO, state.mass / PICOGRAM, np.zeros((n, STATE_COLUMNS)), given,
    ]  # fmt: skip


def advanced(
    setup, arrays, form, last_step, travel=0.0, known=None, kept=0.0, at_pad=0, adds=True, contacts=None
):
    """Forces after one step, and which particles have been looked at one by one; `known` tags before it.

    `kept` is the ledger's least speed, `at_pad` how many were at the pad at the last step.  What the fix
    `adds` to the forces that were there must be that, once, for each particle.  The contacts after the step
    go to the list `contacts`.
    """
    state = setup.state
    memory = Memory(
        setup.model, state.modulus, state.heights, form, 3e-9, 0, 1000, 0, False, state.pad_height, kept
    )
    c, copies = memory.context, [array.copy() for array in arrays]
    c.last_step, c.time_step, c.at_pad = last_step, TIME_STEP, at_pad
    memory.local.tag[:], memory.local.travel[:] = arrays[0] if known is None else known, travel
    memory.local.since[:] = [waiting_since(contact) for contact in copies[6]]
    copies[6][:, CLEARANCE] = np.nan  # is set where a particle is looked at
    tags, x, v, f, radius, mass, state, given = copies
    x, v, f, given = x.reshape(-1), v.reshape(-1), f.reshape(-1), given.reshape(-1)
    advance_particles(
        c, STEP, adds, tags, x, v, f, radius, mass, state, given, memory.modulus, memory.heights, memory.rows,
        memory.local, memory.near,
    )  # fmt: skip
    assert c.error == NO_ERROR
    if contacts is not None:
        contacts.append(copies[6][:, :CLEARANCE])
    force = given.reshape(-1, GIVEN_COLUMNS)[:, FORCE : FORCE + 3]
    np.testing.assert_array_equal(copies[3], arrays[3] + force if adds else arrays[3])
    return force, list(np.flatnonzero(np.isfinite(copies[6][:, CLEARANCE])))


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_all_at_once_and_one_by_one_give_the_same_forces_to_the_bit(form):
    setup, arrays = layer(calm=False)
    alone, looked_at = advanced(setup, arrays, form, -1)
    assert len(looked_at) == len(alone)
    together, looked_at = advanced(setup, arrays, form, STEP - 1, travel=MICRO)
    assert 0 < len(looked_at) < len(alone)  # those above Re = 1
    np.testing.assert_array_equal(together, alone)


@pytest.mark.nojit
@pytest.mark.parametrize("form", ["soft", "impulse"])
def test_nothing_is_added_while_pairs_are_still_to_be_observed(form):
    setup, arrays = layer(calm=False)
    arrays[3][:] = np.random.default_rng(1).standard_normal(arrays[3].shape)
    later, _ = advanced(setup, arrays, form, STEP - 1, travel=MICRO, adds=False)
    at_once, _ = advanced(setup, arrays, form, STEP - 1, travel=MICRO)
    np.testing.assert_array_equal(later, at_once)


@pytest.mark.nojit
def test_who_has_used_up_its_way_is_looked_at():
    setup, arrays = layer()
    assert advanced(setup, arrays, "soft", STEP - 1, travel=MICRO)[1] == []
    assert len(advanced(setup, arrays, "soft", STEP - 1, travel=0.0)[1]) == len(arrays[0])


@pytest.mark.nojit
def test_an_atom_in_another_place_is_looked_at():
    setup, arrays = layer()
    before = arrays[0].copy()
    for array in arrays:
        array[[3, 5]] = array[[5, 3]]
    assert advanced(setup, arrays, "soft", STEP - 1, travel=MICRO, known=before)[1] == [3, 5]


@pytest.mark.nojit
def test_a_particle_above_the_pad_is_struck_by_it():
    setup, arrays = layer()
    arrays[1][0, 2] = setup.state.pad_height / MICRO  # its upper half is in the pad
    arrays[2][0, 2] = 0.5
    force, looked_at = advanced(setup, arrays, "impulse", STEP - 1, travel=MICRO)
    assert looked_at == [0]
    assert force[0, 2] < 0.0


@pytest.mark.nojit
def test_a_particle_in_the_pad_that_goes_away_from_it_needs_no_look():
    setup, arrays = layer()
    arrays[1][:2, 2] = setup.state.pad_height / MICRO
    arrays[2][:2, 2] = -0.5, 0.5
    assert advanced(setup, arrays, "impulse", STEP - 1, travel=MICRO)[1] == [1]
    assert advanced(setup, arrays, "soft", STEP - 1, travel=MICRO)[1] == [0, 1]


@pytest.mark.nojit
def test_many_at_the_pad_get_all_at_once_what_they_get_one_by_one():
    """Some of them fast, some with a pair force, and of these some with a contact that waits, not always."""
    setup, arrays = layer()
    _, x, v, f, _, _, state, _ = arrays
    n = len(x)
    x[:, 2] = setup.state.pad_height / MICRO
    v[:, 2] = np.linspace(-0.02, 0.1, n)
    f[::3, 0], f[1::3, 2] = 1e-3, -1e-3
    state[::2, PAD + PHASE], state[::2, PAD + START] = WAITING, STEP - 3
    state[::6, PAD + START] = STEP - 1000  # longer than any contact waits
    alone, looked_at = advanced(setup, arrays, "impulse", -1, kept=0.05)
    assert len(looked_at) == n
    few, each = advanced(setup, arrays, "impulse", STEP - 1, travel=MICRO, kept=0.05)
    together, rest = advanced(setup, arrays, "impulse", STEP - 1, travel=MICRO, kept=0.05, at_pad=n)
    assert 0 < len(rest) < len(each)
    assert set(range(2, n, 6)) <= set(rest)  # contacts that have waited, and end
    np.testing.assert_array_equal(few, alone)
    np.testing.assert_array_equal(together, alone)
    assert (alone[2::3, 2] < 0.0).any()


@pytest.mark.nojit
@pytest.mark.parametrize("first", [0, PAD])
@pytest.mark.parametrize("speed", [-0.5, 0.5])
def test_a_contact_waits_also_while_the_particle_turns_back(first, speed):
    setup, arrays = layer()
    _, x, v, f, _, _, state, _ = arrays
    x[:, 2], v[:, 2], f[:3, 0] = setup.state.pad_height / MICRO, speed, 1e-3
    state[:4, first + PHASE], state[:4, first + START] = WAITING, STEP - 3
    state[0, first + START] = STEP - 1000  # longer than any contact waits
    for last_step, at_pad in ((-1, 0), (STEP - 1, 0), (STEP - 1, len(x))):
        contacts, travel = [], 0.0 if first == 0 else -MICRO
        advanced(setup, arrays, "impulse", last_step, travel=travel, contacts=contacts, at_pad=at_pad)
        waiting = contacts[0][:, first + PHASE] == WAITING
        assert list(waiting[:4]) == [False, True, True, False]  # the last one has no pair force any more


@pytest.mark.nojit
def test_soft_contacts_with_the_pad_go_on_together_as_one_by_one():
    """Some end, some particles are faster than Stokes's law goes, and some have a pair force."""
    setup, arrays = layer()
    _, x, v, f, radius, _, state, _ = arrays
    n = len(x)
    x[:, 2] = setup.state.pad_height / MICRO - radius + 1e-4
    v[:, 2], v[-5:, 0] = np.linspace(-0.5, 0.1, n), 3.0
    f[::3] = 1e-3, -1e-3, 1e-3
    state[:, PAD + PHASE], state[:, PAD : PAD + PHASE] = TOUCHING, 1e-15
    contacts = []
    alone, looked_at = advanced(setup, arrays, "soft", -1, contacts=contacts)
    assert len(looked_at) == n
    travel = np.full(n, MICRO)
    travel[-8:-5] = 0.0  # the surface may be near
    few, _ = advanced(setup, arrays, "soft", STEP - 1, travel=travel, contacts=contacts)
    together, rest = advanced(setup, arrays, "soft", STEP - 1, travel=travel, contacts=contacts, at_pad=n)
    ended = np.flatnonzero(contacts[0][:, PAD + PHASE] != TOUCHING)
    assert 0 < len(ended) < len(rest) < n - 5
    assert {*ended, *range(n - 8, n)} <= set(rest)
    np.testing.assert_array_equal(few, alone)
    np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(contacts[1:], [contacts[0]] * 2)


@pytest.mark.nojit
def test_a_contact_that_waits_is_looked_at_when_fewer_are_at_the_pad():
    travel, since = np.array([MICRO, 0.0, MICRO]), np.array([3.0, 3.0, NO_CONTACT])
    show_contacts(travel, since)
    assert list(travel < 0.0) == [True, True, False]


@pytest.mark.nojit
def test_who_was_in_contact_with_the_pad_is_looked_at_again():
    setup, arrays = layer()
    assert advanced(setup, arrays, "soft", STEP - 1, travel=-MICRO)[1] == list(range(len(arrays[0])))


@pytest.mark.nojit
def test_the_way_left_is_what_the_surface_was_found_away_less_the_distance_gone():
    model = layer()[0].model
    x, radius = np.array([1.0, 2.0, 3.0]), 0.5
    seen = np.array([1e-6 + model.length_x, 2e-6, 3e-6 + 0.2e-6, 0.9e-6])  # an image of it, 0.2 um above
    # Differences of lengths of up to one period, each rounded.
    eps = 8 * np.finfo(float).eps * model.length_x
    assert way_since(model, seen, x, radius) == pytest.approx(0.2e-6, rel=0.0, abs=eps)
    assert way_since(model, seen, x, 0.8) == 0.0  # larger now
    assert way_since(model, np.zeros(4), x, radius) == 0.0  # never seen
