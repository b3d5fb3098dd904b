"""Ensembles: an honest engine is equivalent, one that removes too much is not, whatever it does to Pi."""

from dataclasses import replace

import pytest

from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.ensembles import PAIRS, compare_ensembles
from cmpcheck.statistics import fewest_pairs
from reference.case import load_case

CASE = load_case("polish_pair")
QUANTITIES = {"flatness", "removals", "depth_sum", "removed_volume"}


class Fake(ReferenceEngine):
    """The reference under LAMMPS's name, at its own time step, with constants changed."""

    name = "lammps"

    def __init__(self, **changes):
        self.changes = changes

    def run(self, setup, resolution):
        changed = {name: factor * getattr(setup.model, name) for name, factor in self.changes.items()}
        model = setup.model._replace(**changed)
        return super().run(replace(setup, model=model), replace(resolution, time_step=setup.time_step))


@pytest.fixture(scope="module")
def honest():
    return compare_ensembles(CASE, (ReferenceEngine(), Fake()), "quick")


def test_an_engine_that_does_the_same_is_equivalent_in_everything(honest):
    rows, _ = honest
    assert {row.quantity for row in rows} == QUANTITIES
    assert {(row.status, row.error, row.kind) for row in rows} == {("agree", 0.0, "statistical")}


def test_both_engines_are_drawn_with_their_bands(honest):
    traces = honest[1]
    assert {trace.engine for trace in traces} == {"reference", "lammps"}
    low, mean, high = (
        next(t.values for t in traces if t.engine == "lammps" and t.label == f"flatness, {label}")
        for label in ("95 % band below", "mean", "95 % band above")
    )
    assert mean[0] == 1.0  # Eq 44 at the start
    assert all(a <= b <= c for a, b, c in zip(low, mean, high, strict=True))


def test_more_removal_per_impact_is_a_difference():
    """V ~ 1/sigma_y^2: a third more of each impact, so that the surface wears sooner and is hit less."""
    rows, _ = compare_ensembles(CASE, (ReferenceEngine(), Fake(yield_stress=0.86)), "quick")
    assert {row.quantity for row in rows if row.status == "disagree"} >= {"removals", "removed_volume"}


def test_the_quick_profile_has_pairs_enough_to_call_one_quantity_different():
    assert PAIRS["quick"] >= fewest_pairs(8)
    assert PAIRS["full"] >= 24
