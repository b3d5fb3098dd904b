"""What the study of the schemes finds beyond the relaxation time: who fails, who holds, at what cost."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cmpcheck.studies import fine_abrasive
from cmpcheck.studies.fine_abrasive import HOLDS, SCHEMES, sentence, table
from reference import exact
from reference.case import CaseError, load_case
from reference.process import build_setup
from reference.simulation import SimulationError


@pytest.fixture(scope="module")
def found():
    return table(load_case("fine_abrasive"))


def test_the_step_of_the_case_is_far_beyond_the_relaxation_time():
    setup = build_setup(load_case("fine_abrasive"))
    tau = exact.stokes_time(setup.state.mass.mean(), 0.03e-6, 1e-3)
    assert 30 < setup.time_step / tau < 45


def test_the_printed_norm_accepts_what_nothing_in_the_case_can_give(found):
    """No fluid is faster than the pad; such speeds remove material, which neither of the others does."""
    printed, moved, implicit = found.itertuples()
    assert [(row.scheme, row.norm) for row in found.itertuples()] == list(SCHEMES)
    assert printed.largest_speed > 1.0 > moved.largest_speed
    assert printed.outcome != HOLDS == moved.outcome == implicit.outcome
    assert printed.removals > 0 == moved.removals == implicit.removals
    assert printed.fluid_work > 10 * max(moved.fluid_work, implicit.fluid_work)


def test_point_implicit_takes_the_longest_step_and_rejects_none(found):
    _, moved, implicit = found.itertuples()
    setup = build_setup(load_case("fine_abrasive"))
    interval = implicit.time / (fine_abrasive.OUTPUTS - 1)
    assert implicit.steps == (fine_abrasive.OUTPUTS - 1) * -(-interval // setup.time_step)
    assert implicit.rejected_steps == 0
    assert moved.steps > 50 * implicit.steps
    assert moved.rejected_steps > 1000
    assert moved.time == implicit.time
    assert abs(moved.largest_speed - implicit.largest_speed) < 0.05


def test_within_the_relaxation_time_the_printed_norm_holds_too(monkeypatch):
    """The twin: at 0.15 tau the iteration contracts by 0.15 a sweep, whatever the norm is."""
    monkeypatch.setattr(fine_abrasive, "PART", 0.001)
    case = load_case("fine_abrasive")
    short = case.numerics.model_copy(update={"gamma": 4e-5})
    rows = table(case.model_copy(update={"numerics": short}))
    assert rows["outcome"].tolist() == [HOLDS] * 3


def test_the_sentence_gives_the_numbers_of_the_table(found):
    text = sentence(found)
    for row in found.itertuples():
        assert f"{row.outcome} (largest {row.largest_speed:.3g} V_pad, {row.removals} removals)" in text
    assert f"{found.rejected_steps[1]} rejected" in text
    changed = found.assign(largest_speed=[9.87, 0.5, 0.4], outcome=["stops: x", HOLDS, HOLDS])
    assert "printed stops: x (largest 9.87 V_pad" in sentence(changed)


def test_a_run_that_stops_is_a_row(monkeypatch):
    """What was recorded until then, and the message for an outcome."""
    real = fine_abrasive.simulate_setup

    def stopping(setup):
        half = replace(setup, output_times=setup.output_times[:51])
        raise SimulationError("fine_abrasive: the step fell below 1e-9", real(half))

    monkeypatch.setattr(fine_abrasive, "simulate_setup", stopping)
    row = table(load_case("fine_abrasive")).iloc[2]
    assert row["outcome"] == "stops: fine_abrasive: the step fell below 1e-9"
    assert row["time"] == pytest.approx(1e-6)
    assert 100 <= row["steps"] <= 200


def test_a_case_without_a_pad_is_refused():
    with pytest.raises(CaseError, match="pad"):
        table(load_case("swarm"))
