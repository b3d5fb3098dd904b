"""Laws of the components: all agree, each part fails when what it checks is broken, a crash is a row."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from cmpcheck import components
from cmpcheck.components import check_components, component_result, equations, methods, runs, samples, setup
from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.suite import run_suite
from reference import exact
from reference.balances import Balance
from reference.exact import adaptive
from reference.exact.adaptive import iterate


def wrong(rows) -> set[str]:
    return {row.quantity for row in rows if row.status != "agree"}


def test_all_components_agree_and_none_is_without_a_tolerance():
    rows = check_components()
    assert wrong(rows) == set()
    assert all(row.tolerance > 0.0 or row.error == 0.0 for row in rows)
    assert len({(row.variant, row.quantity) for row in rows}) == len(rows)


def test_twin_a_wrong_exponent_is_seen_by_the_drag_coefficient(monkeypatch):
    right = equations.drag.drag_coefficient
    monkeypatch.setattr(equations.drag, "drag_coefficient", lambda reynolds: right(reynolds) * 1.001)
    assert wrong(equations.checks()) == {"drag_coefficient"}


def test_twin_shared_seeds_and_lost_pairs_are_seen(monkeypatch):
    monkeypatch.setattr(setup, "sample_case", lambda case, k: case)
    right = setup.neighbor_pairs
    monkeypatch.setattr(setup, "neighbor_pairs", lambda *arguments: right(*arguments)[1:])
    assert wrong(setup.checks()) == {"seeds", "shared_positions", "wrong_pairs"}


def test_twin_a_search_that_forgets_its_parents_is_seen(monkeypatch):
    class Forgetful(methods.GeneticAlgorithm):
        def _advance(self) -> None:
            self.strings, self.costs = self.strings[1:], self.costs[1:]
            super()._advance()

    monkeypatch.setattr(methods, "GeneticAlgorithm", Forgetful)
    assert "worse_generations" in wrong(methods.checks())


def test_twin_a_run_that_does_not_balance_is_seen(monkeypatch):
    right = runs.balances
    loose = Balance("volume", "", residual=1.0, bound=0.5, unit="m3")
    monkeypatch.setattr(runs, "balances", lambda run: [*right(run)[:-1], loose])
    assert wrong(runs.checks()) == {"balance_of_volume"}


def test_a_part_that_crashes_is_a_row_and_the_others_go_on(monkeypatch):
    def crash():
        raise ZeroDivisionError("by zero")

    crash.__module__ = "cmpcheck.components.runs"
    monkeypatch.setattr(components, "PARTS", (crash, setup.checks))
    rows = check_components()
    assert (rows[0].status, rows[0].variant) == ("error", "runs")
    assert "by zero" in rows[0].reason
    assert len(rows) > 5


def test_a_suite_that_is_asked_for_them_has_them_as_its_last_case(tmp_path):
    found = run_suite(["drag_relaxation"], [], "quick", tmp_path, 1, components=True)
    assert [case.name for case in found.cases] == ["drag_relaxation", components.CASE]
    assert component_result(["reference"]).comparisons == found.cases[-1].comparisons
    engines = {row.engine for row in found.cases[-1].comparisons}
    assert engines == {"reference"}  # no other was asked for


def test_twin_a_position_that_moves_with_the_old_velocity_is_seen(monkeypatch):
    """dt v instead of dt v': off by dt^2 a, which no limit dt -> 0 can tell."""
    right = runs.simulate_setup

    def behind(given):
        run = right(given)
        if len(run.times) == 2 and len(run.velocities[0]) == 1:
            run.positions[1] -= (run.times[1] - run.times[0]) * (run.velocities[1] - run.velocities[0])
        return run

    monkeypatch.setattr(runs, "simulate_setup", behind)
    assert wrong(runs.checks()) == {"way"}


def test_twin_a_step_that_grows_by_more_than_its_cap_is_seen(monkeypatch):
    """Where the closed form caps the growth at 2.02, only the start that reaches the cap disagrees."""
    source = inspect.getsource(adaptive).replace("min(factor, 2.0)", "min(factor, 2.02)")
    space: dict = {"__name__": "looser"}
    exec(compile(source, "looser", "exec"), space)
    monkeypatch.setattr(exact, "adaptive_stokes", space["adaptive_stokes"])
    rows = [row for row in runs.checks() if row.status != "agree"]
    assert {row.variant for row in rows} == {"adaptive steps that grow as fast as they may"}


@pytest.mark.skipif(not LammpsEngine().info().available, reason="LAMMPS is not installed")
def test_twin_a_trajectory_with_velocities_of_half_a_step_before_is_seen(monkeypatch):
    right = LammpsEngine.run

    def behind(self, setup, resolution):
        run = right(self, setup, resolution)
        run.velocities[1:] = np.diff(run.positions, axis=0) / run.times[1]
        return run

    assert wrong(samples.checks()) == set()
    monkeypatch.setattr(LammpsEngine, "run", behind)
    assert wrong(samples.checks()) == {"sampled_velocity"}


def test_a_collision_in_a_flow_without_viscosity_is_one_without_a_flow():
    masses, radii = (2.0, 0.7), (0.5, 0.3)
    normal = np.array([0.6, 0.0, 0.8])
    positions = np.array([np.zeros(3), 0.8 * normal])
    velocities = np.array([[1.0, 0.2, 0.9], [-0.3, 0.1, 0.2]])
    free = exact.pair_collision(*masses, *velocities, normal, 0.6, 0.3)
    hit = exact.impact_in_flow(masses, radii, positions, velocities, np.ones(3), 1e-30, 1.0, 0.6, 0.3)
    assert hit.normal_impulse == pytest.approx(free.normal_impulse, rel=1e-12)
    np.testing.assert_allclose(hit.friction_impulse, free.friction_impulse, rtol=1e-12)
    np.testing.assert_allclose(hit.velocities, [free.velocity_i, free.velocity_j], rtol=1e-12)


def test_between_elastic_wall_and_resting_pad_energy_is_kept_and_a_moving_pad_adds_twice_its_speed():
    resting = exact.between_wall_and_pad(0.5, 1.0, 2.0, 0.1, 1.0, exact.Pad(1.0, 1.0, 0.0, 1.0), 9.9)
    assert len(resting) == 12  # at 0.4, 1.2, ..., 9.2
    assert {abs(hit.velocity) for hit in resting} == {1.0}
    (first, *_) = exact.between_wall_and_pad(0.5, 1.0, 2.0, 0.1, 1.0, exact.Pad(1.0, 0.3, 0.25, 1.0), 1.0)
    assert (first.kind, first.velocity) == ("pad", -1.5)
    assert first.normal_impulse == 5.0  # 2 m (v + V)


def test_a_volume_is_taken_off_whole_and_balanced_about_its_place():
    rng = np.random.default_rng(2)
    for x, y in rng.uniform(0.0, 4.0, (20, 2)):
        fall = -exact.lowered(np.zeros((5, 5)), 1.0, x, y, volume=0.3)
        assert fall.sum() == pytest.approx(0.3, rel=1e-12)
        i, j = np.indices(fall.shape)
        assert [(fall * i).sum(), (fall * j).sum()] == pytest.approx([0.3 * x, 0.3 * y], rel=1e-9)
    assert exact.lowered(np.zeros((5, 5)), 1.0, 3.6, 0.4, depth=2.0)[4, 0] == -2.0


def test_iterates_converge_to_implicit_euler():
    start, flow, q = np.array([1.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0]), 0.4
    np.testing.assert_allclose(iterate(start, flow, q, 60), start + (flow - start) * q / (1 + q), rtol=1e-14)
    assert exact.adaptive_stokes([1.0], start, flow, tau=1.0, largest_step=1.0).rejected > 0
