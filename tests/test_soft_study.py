"""Soft polishing as ensembles: what converges is extrapolated and found equal, what does not is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.lammps_library import available
from cmpcheck.engines.protocol import Resolution
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.soft_study import (
    OBSERVABLES,
    Durations,
    SoftEnsemble,
    durations,
    judge_soft,
    observed_order,
    run_soft,
)
from reference.case import load_case
from reference.process import build_setup

needs_lammps = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
SINGLE, FULL = load_case("polish_pair_surface_only"), load_case("polish_pair")
N, SPREAD = 24, 0.1


def ensemble(case, error, floor=0.0, noise=0.002) -> SoftEnsemble:
    """An engine whose observables are off by error t_c/(12 ns) + floor, and a little noise."""
    rng = np.random.default_rng(1)
    levels = durations(case, "lammps", "full")
    reference = 1.0 + SPREAD * rng.standard_normal((N, len(OBSERVABLES)))
    off = np.array([error * level.surface / 12e-9 + floor for level in levels])[:, None, None]
    measured = reference * (1.0 + off) + noise * rng.standard_normal((len(levels), N, len(OBSERVABLES)))
    return SoftEnsemble(case, "lammps", levels, reference, measured)


def test_single_impacts_are_extrapolated_to_no_duration():
    rows, records, _ = judge_soft(ensemble(SINGLE, -0.06))
    assert {(row.status, row.variant) for row in rows} == {("agree", "soft, t_c -> 0")}
    assert {row.quantity for row in rows} == {observable.quantity for observable in OBSERVABLES}
    for row, record in zip(rows, records, strict=True):
        assert row.order == record.order == pytest.approx(1.0, abs=0.15)
        # noise of both levels, 2 a - b, over sqrt(24): 0.001; three of them
        assert record.extrapolated == pytest.approx(record.target, abs=0.003)


def test_what_does_not_converge_is_different_at_every_duration_and_ratio():
    rows, _, notes = judge_soft(ensemble(FULL, -0.02, floor=-0.1))
    assert {row.status for row in rows} == {"disagree"}
    assert len({row.variant for row in rows}) == len(durations(FULL, "lammps", "full")) == 5
    assert "soft, t_c = 12 ns, of pairs 3 ns" in {row.variant for row in rows}
    assert "24 samples" in notes[0]


def test_single_impacts_that_tend_to_something_else_disagree():
    rows, *_ = judge_soft(ensemble(SINGLE, -0.06, floor=-0.1))
    assert {row.status for row in rows} == {"disagree"}


@pytest.mark.parametrize("order", [1.0, 2.0])
def test_the_order_of_paired_differences_is_found_within_its_error(order):
    steps = np.array([(level.surface / 12e-9) ** order for level in durations(SINGLE, "lammps", "full")])
    base = ensemble(SINGLE, 0.0)
    shifted = replace(base, measured=base.measured - 0.06 * steps[:, None, None])
    found, error = observed_order(shifted, 0)
    assert error < 0.2
    assert found == pytest.approx(order, abs=4 * error)


class Softened(ReferenceEngine):
    """The reference in the place of LAMMPS, with a restitution that is too low by an amount of order t_c."""

    name = "lammps"

    def run(self, setup, resolution):
        e = setup.model.restitution * (1.0 - 2e7 * resolution.contact_duration)
        softened = replace(setup, model=setup.model._replace(restitution=e))
        return super().run(softened, replace(resolution, time_step=setup.time_step))


def test_levels_share_their_samples_with_the_reference():
    levels = (Durations(1e-12, 1e-12), Durations(12e-9, 12e-9))
    found = run_soft(SINGLE, (ReferenceEngine(), Softened()), levels, 2)
    assert found.measured.shape == (2, 2, len(OBSERVABLES))
    np.testing.assert_allclose(found.measured[0, :, 0], found.reference[:, 0], rtol=0.02)
    assert not np.allclose(found.measured[1], found.reference, rtol=0.02)
    assert list(found.table()["n"]) == [2, 2]


def test_particles_without_pairs_do_not_meet():
    setup = build_setup(SINGLE)
    run = ReferenceEngine().run(setup, Resolution(setup.time_step))
    assert set(run.contacts["kind"]) == {"surface"}
    apart = run.positions[:, :, None] - run.positions[:, None]
    apart[..., :2] -= setup.model.length_x * np.round(apart[..., :2] / setup.model.length_x)
    distance = np.linalg.norm(apart, axis=-1) + np.eye(len(setup.state.mass))
    assert distance.min() < 0.8e-6  # they have been within each other
    met = replace(setup, model=setup.model._replace(has_pairs=True))
    assert "pair" in set(ReferenceEngine().run(met, Resolution(setup.time_step)).contacts["kind"])


@needs_lammps
def test_lammps_knows_no_pairs_in_it_either():
    setup = build_setup(SINGLE)
    run = LammpsEngine().run(setup, Resolution(12e-9 / 50, 12e-9, "soft"))
    assert set(run.contacts["kind"]) == {"surface"}


@needs_lammps
@pytest.mark.slow
def test_single_soft_impacts_tend_to_the_reference():
    engines = ReferenceEngine(), LammpsEngine()
    found = run_soft(SINGLE, engines, durations(SINGLE, "lammps", "full"), 8)
    means = [found.differences(j, 2).mean() for j in found.equal]  # of the sum of depths
    assert means[0] < -0.03  # of the reference, at 12 ns
    assert abs(means[2]) < 0.5 * abs(means[0])
    rows, *_ = judge_soft(found)
    assert not any(row.status == "disagree" for row in rows)
