"""Laws of balances.py: energy, momentum, mass and volume close to round-off, and what is wrong is noticed."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rounding import ROUND, close, masses, vectors

from reference import simulation
from reference.balances import balances, close_books, lowered_over_removed, simultaneous_share, violation
from reference.case import Case, load_case
from reference.collisions import impact_energy_lost, simultaneous_loss
from reference.heightfield import Heightfield
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import SimulationError, simulate, simulate_setup
from reference.timestep import P, add

SURFACE = {"energy", "momentum_x", "momentum_y", "momentum_z", "mass", "removed_mass", "volume"}
OPEN = SURFACE - {"removed_mass", "volume"}


def polishing(outputs=6, **sections):
    """The first 5 us of polish_pair, 1100 steps: 20 spheres under a pad, on asperities, in a shear layer."""
    case = load_case("polish_pair")
    parts = {key: getattr(case, key).model_copy(update=values) for key, values in sections.items()}
    setup = build_setup(case.model_copy(update=parts))
    return replace(setup, output_times=np.linspace(0.0, setup.end_time / 20, outputs))


@pytest.fixture(scope="module")
def polished():
    return simulate_setup(polishing())


def residuals(run):
    return {balance.name: balance for balance in balances(run)}


def changed(run, **columns):
    """A copy of a run with columns of its history multiplied."""
    history = run.history.copy()
    for name, factor in columns.items():
        history[name] *= factor
    return replace(run, history=history)


# What closes


@pytest.mark.parametrize(
    "sections",
    [
        pytest.param({}, id="as it ships"),
        pytest.param({"removal": {"deposit": "volume"}}, id="volume"),
        pytest.param({"removal": {"mass_pickup": False}}, id="no pickup"),
        pytest.param({"numerics": {"scheme": "fixed_point"}}, id="fixed_point"),
        pytest.param({"numerics": {"scheme": "fixed_point", "norm": "printed"}}, id="printed norm"),
        pytest.param({"numerics": {"scheme": "fixed_point", "tolerance": 1e-2}}, id="loosely converged"),
        pytest.param({"numerics": {"tolerance": 1e-2}}, id="drag loosely converged"),
    ],
)
def test_all_balances_of_polishing_close(sections):
    run = simulate_setup(polishing(**sections))
    last = run.history.iloc[-1]
    assert {name for name, balance in residuals(run).items() if balance.holds} == SURFACE
    assert last["removals"] > 5
    assert last["pad_impulse_z"] < 0 < last["surface_impulse_z"]
    assert last["simultaneous_loss"] != 0
    assert (last["removed_mass"] == (run.masses[-1] - run.masses[0]).sum()) or last["removals"] > 0


@pytest.mark.parametrize(
    "name, expected",
    [
        ("swarm", OPEN), ("pair_slip", OPEN), ("drag_relaxation", OPEN), ("drag_regimes", OPEN),
        ("couette_drift", OPEN), ("bounce_train", SURFACE), ("wall_oblique", SURFACE),
        ("fine_abrasive", SURFACE),
    ],
)  # fmt: skip
def test_balances_of_every_kind_of_case_close(name, expected):
    """Without fluid, surface or pad, in a uniform flow, and where the step is 38 relaxation times."""
    case = load_case(name).variants()[0]
    setup = build_setup(case)
    run = simulate_setup(replace(setup, output_times=setup.output_times[:3]))
    assert {name for name, balance in residuals(run).items() if balance.holds} == expected


def test_balances_close_with_contacts_at_the_iterate():
    """The contacts that are booked are those of the last iterate, from which the accepted velocities are."""
    run = simulate_setup(polishing(numerics={"scheme": "fixed_point", "contacts": "iterated"}))
    assert run.history["contacts"].iloc[-1] > 100
    assert run.provenance["rejected_steps"] > 100
    assert all(balance.holds for balance in balances(run))


def test_particles_at_rest_in_a_fluid_at_rest_exchange_nothing():
    raw = load_case("drag_relaxation").variants()[0].model_dump(by_alias=True, exclude_none=True)
    still = {"velocity": [0.0, 0.0, 0.0]}
    run = simulate(
        Case.model_validate(raw | {"particle": [raw["particle"][0] | still], "fluid": raw["fluid"] | still})
    )
    assert all(balance.holds and balance.residual == balance.bound == 0.0 for balance in balances(run))


def test_the_bounds_are_far_below_what_is_exchanged(polished):
    """Otherwise they would hold whatever happens: a millionth of each flow is seen."""
    last, found = polished.history.iloc[-1], residuals(polished)
    assert found["energy"].bound < 1e-6 * abs(last["fluid_work"])
    for axis in "xyz":
        assert found[f"momentum_{axis}"].bound < 1e-6 * abs(last[f"fluid_impulse_{axis}"])
    assert found["volume"].bound < 1e-9 * 400 * last["depth_sum"] * polished.surface.spacing**2
    assert found["mass"].bound < 1e-3 * last["removed_mass"]


def test_runs_that_did_not_book_contacts_have_no_balances(polished):
    assert balances(replace(polished, history=polished.history[["time", "kinetic_energy"]])) == []


# What is wrong is noticed


@pytest.mark.parametrize(
    "column, factor, name",
    [
        ("fluid_work", 1 + 1e-6, "energy"),
        ("contact_loss", 1 + 1e-6, "energy"),
        ("simultaneous_loss", 0.0, "energy"),
        ("kinetic_energy", 1 + 1e-6, "energy"),
        ("fluid_impulse_x", 1 + 1e-6, "momentum_x"),
        ("fluid_impulse_y", 1 + 1e-6, "momentum_y"),
        ("fluid_impulse_z", 1 + 1e-6, "momentum_z"),
        ("surface_impulse_x", 1 + 1e-6, "momentum_x"),
        ("surface_impulse_y", 1 + 1e-6, "momentum_y"),
        ("surface_impulse_z", 1 + 1e-6, "momentum_z"),
        ("pad_impulse_z", 1 + 1e-6, "momentum_z"),
        ("removed_volume", 1 + 1e-6, "removed_mass"),
        ("depth_sum", 1 + 1e-6, "volume"),
    ],
)
def test_a_sum_that_is_off_by_a_millionth_is_noticed(polished, column, factor, name):
    violated = [
        key for key, balance in residuals(changed(polished, **{column: factor})).items() if not balance.holds
    ]
    assert violated == [name]


@pytest.mark.parametrize("deposit", ["node_depth", "volume"])
def test_a_removal_that_is_left_out_is_noticed(deposit):
    """The least of all impacts: once it did not lower the surface, once it did not join the particle."""
    run = simulate_setup(polishing(removal={"deposit": deposit}))
    removals = run.contacts[run.contacts["removed_volume"] > 0]
    least = removals.loc[removals["removed_volume"].idxmin()]
    kept = Heightfield(run.surface.z, run.surface.spacing)
    amount = least["depth"] * kept.spacing**2 if deposit == "node_depth" else least["removed_volume"]
    kept.z[3, 3] += run.case.removal.acceleration * amount / kept.spacing**2
    assert "volume" in violation(replace(run, surface=kept))
    lighter = run.masses.copy()
    lighter[-1, int(least["i"])] -= least["removed_mass"]
    assert "mass" in violation(replace(run, masses=lighter))


def velocity(p, heights):
    p.velocity[0] *= 1 + 1e-6


def mass(p, heights):
    p.mass[0] *= 1 + 1e-6


def node(p, heights):
    heights[0, 0] -= 1e-12


@pytest.mark.parametrize("change, name", [(velocity, "energy"), (mass, "energy"), (node, "volume")])
def test_a_state_that_changes_behind_the_books_ends_in_an_error_and_is_kept(
    tmp_path, monkeypatch, change, name
):
    advance, calls = simulation.advance, []

    def meddling(model, numerics, scalars, t_end, steps, p, heights, rows):
        status = advance(model, numerics, scalars, t_end, steps, p, heights, rows)
        if not calls:
            change(p, heights)
        calls.append(status)
        return status

    monkeypatch.setattr(simulation, "advance", meddling)
    with pytest.raises(
        SimulationError, match=rf"polish_pair: the balance of {name} is off by .* more than"
    ) as stopped:
        simulate_setup(polishing(), tmp_path / "run")
    kept = Run.load(tmp_path / "run")
    assert "\n" not in str(stopped.value)
    assert kept.provenance["complete"] is False
    assert kept.provenance["notes"][-1] in str(stopped.value)
    assert len(kept.times) == len(stopped.value.run.times) == 6
    assert violation(kept) in str(stopped.value)


def test_a_complete_run_records_its_balances(polished, tmp_path):
    polished.save(tmp_path)
    recorded = json.loads((tmp_path / "provenance.json").read_text())["balances"]
    assert set(recorded) == SURFACE
    for name, balance in residuals(polished).items():
        assert recorded[name] == {"residual": balance.residual, "bound": balance.bound, "unit": balance.unit}
    assert polished.provenance["complete"] is True


def test_a_run_that_was_cut_short_is_left_as_it_is(polished):
    broken = changed(polished, fluid_work=2.0)
    broken.provenance = {"complete": False, "notes": []}
    assert close_books(broken) == ""
    assert broken.provenance == {"complete": False, "notes": []}


# What is remarked


def test_how_much_more_than_the_caps_node_depth_lowers_is_said(polished):
    last, h = polished.history.iloc[-1], polished.surface.spacing
    close(lowered_over_removed(polished), h**2 * last["depth_sum"] / last["removed_volume"], rtol=1e-6)
    assert any(f"{lowered_over_removed(polished):.3g} times" in note for note in polished.provenance["notes"])
    run = simulate_setup(polishing(removal={"deposit": "volume"}))
    np.testing.assert_allclose(lowered_over_removed(run), 1.0, rtol=1e-6, atol=0)
    assert not any("deposit" in note for note in run.provenance["notes"])


def test_a_large_part_of_simultaneous_contacts_is_remarked(polished):
    last = polished.history.iloc[-1]
    dissipated = last["contact_loss"] + last["pad_work"] + last["simultaneous_loss"]
    close(simultaneous_share(polished), abs(last["simultaneous_loss"]) / dissipated)
    assert 0 < simultaneous_share(polished) < 0.01
    assert not any("at once" in note for note in polished.provenance["notes"])
    factor = 0.05 / simultaneous_share(polished)  # as much as the contacts by themselves lose less
    less = (factor - 1) * last["simultaneous_loss"] / last["contact_loss"]
    larger = changed(polished, simultaneous_loss=factor, contact_loss=1 - less)
    larger.provenance = {"complete": True, "notes": []}
    assert close_books(larger) == ""
    assert "5.0% of the energy" in larger.provenance["notes"][0]


# Their parts


def loss(m, v, impulse, gained):
    """Energy that a particle loses that receives an impulse and mass at rest."""
    return 0.5 * m * (v @ v) - ((m * v + impulse) ** 2).sum() / (2 * (m + gained))


@given(masses, vectors, vectors, vectors, st.floats(0.0, 0.5))
def test_what_simultaneous_contacts_lose_together_is_their_loss_and_the_simultaneous_one(m, v, a, j, share):
    """A pair, then the surface with pick-up, and a pair with pick-up, then the pad."""
    a, j, g = m * a, m * j, share * m
    size = m * 9 + loss(m, v, a + j, g)
    expected = loss(m, v, a + j, g) - loss(m, v, a, 0.0) - loss(m, v, j, g)
    brings = a @ v + a @ a / (2 * m)  # A has no mass, J brings it
    close(simultaneous_loss(m, g, a @ j, brings), expected, scale=size)
    other = loss(m, v, a + j, g) - loss(m, v, a, g) - loss(m, v, j, 0.0)
    close(simultaneous_loss(m, g, a @ j, -loss(m, v, j, 0.0)), other, scale=size)
    close(simultaneous_loss(m, 0.0, a @ j, 0.0), -(a @ j) / m)
    n = np.array([0.0, 0.0, 1.0])
    close(impact_energy_lost(m, g, v, v[2], j[2]), loss(m, v, j[2] * n, g), scale=size)


def test_sums_over_many_steps_are_compensated():
    """A million additions of 0.1 to a large number: twice the last place of the sum, not a million times."""
    progress, booked, lost = (np.zeros(len(P)) for _ in range(3))
    plain = progress[P.fluid_work] = 1e6
    for _ in range(100_000):
        booked[P.fluid_work] = 0.1
        add(progress, booked, lost)
        plain += 0.1
    exact = math.fsum([1e6, *[0.1] * 100_000])
    assert abs(progress[P.fluid_work] - exact) <= 2 * np.spacing(exact)
    assert abs(plain - exact) > 100 * np.spacing(exact)


def test_the_work_of_the_fluid_converges_to_its_integral_with_order_one():
    """In a uniform flow v = u + w exp(-t/tau), so that the integral of (m/tau) (u - v).v is closed."""
    case = load_case("drag_relaxation").variants()[0]
    (sphere,) = case.particle
    u, w = np.array(case.fluid.velocity), np.array(sphere.velocity) - np.array(case.fluid.velocity)
    works, end = [], case.case.duration
    for divisor in (1, 2, 4):
        step = {"time_step": case.numerics.time_step / divisor}
        run = simulate(case.model_copy(update={"numerics": case.numerics.model_copy(update=step)}))
        works.append(run.history["fluid_work"].iloc[-1])
    tau = run.masses[0, 0] / (3 * math.pi * case.fluid.viscosity * sphere.diameter)
    decay = math.exp(-end / tau)
    exact = -run.masses[0, 0] * ((w @ u) * (1 - decay) + 0.5 * (w @ w) * (1 - decay**2))
    errors = np.array(works) - exact
    h = case.numerics.time_step / tau
    # an error c h (1 + O(h)): each halving of the step halves it to within h
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2.0, rtol=h, atol=0)
    assert abs(errors[-1]) > 1e3 * ROUND * abs(exact)
