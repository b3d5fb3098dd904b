"""What becomes of levels: rows, verdicts and gaps of made-up ones; output times and contact settings.

The extrapolation itself is tested in `test_convergence.py`, the judges in `test_judges.py`, which runs are
made in `test_suite.py`.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpcheck.compare import compare_study, convergences, limits
from cmpcheck.engines.protocol import Resolution
from cmpcheck.judges import Measured
from cmpcheck.results import Comparison
from cmpcheck.study import MOST_OUTPUTS, Level, Study, align_outputs, contact_settings
from reference.case import CASES, CaseError, load_case
from reference.process import build_setup
from reference.state import Setup

EPS = float(np.finfo(float).eps)
CASE = load_case("drag_relaxation")
STEPS = (4.0, 2.0, 1.0)


def measured(values, expected: float = 1.0, **more) -> Measured:
    fields = {"quantity": "speed", "place": "", "equations": "21", "unit": "m/s", "scale": 1.0} | more
    return Measured(values=np.atleast_1d(np.asarray(values, float)), expected=expected, **fields)


def study_of(*levels: list[Measured], engine: str = "lammps", form: str = "") -> Study:
    """A study of three time steps, coarsest first, of which only what was measured is given."""
    rows = [Level(None, Resolution(step), None, found) for step, found in zip(STEPS, levels, strict=True)]
    return Study(engine, form, {"time step": rows})


def linear(value: float, slope: float = 0.001, **more) -> Study:
    """A first-order quantity."""
    return study_of(*([measured(value + slope * step, **more)] for step in STEPS))


def only(rows: list[Comparison]) -> Comparison:
    assert len(rows) == 1
    return rows[0]


# Settings of a study


@functools.cache
def relaxation() -> Setup:
    return build_setup(CASE)


def with_step(end_time: float, time_step: float) -> Setup:
    return replace(relaxation(), end_time=end_time, time_step=time_step)


@given(ratio=st.floats(0.3, 1e4), end_time=st.sampled_from([1e-9, 0.7, 3e2]))
def test_outputs_are_whole_multiples_of_a_step_that_is_at_most_the_one_asked_for(ratio, end_time):
    asked = end_time / ratio
    aligned = align_outputs(with_step(end_time, asked))
    times = aligned.output_times
    strides = np.diff(times) / aligned.time_step
    np.testing.assert_allclose(strides, np.round(strides[0]), rtol=1e-9, atol=0.0)  # eps x number of outputs
    assert strides[0] > 0.5
    assert (times[0], times[-1]) == (0.0, end_time)
    assert 2 <= len(times) <= MOST_OUTPUTS + 1
    assert aligned.time_step <= asked * (1.0 + 2e-9)
    # at most one stride is added, and a stride is at most a whole part of MOST_OUTPUTS
    assert aligned.time_step >= min(asked, end_time) / (2.0 + MOST_OUTPUTS / ratio)


def test_a_step_that_divides_the_duration_is_kept():
    aligned = align_outputs(with_step(1.0, 0.02))
    assert aligned.time_step == pytest.approx(0.02, rel=4 * EPS, abs=0.0)
    assert len(aligned.output_times) == 51
    assert align_outputs(with_step(1.0, 0.03)).time_step == pytest.approx(1 / 34, rel=4 * EPS, abs=0.0)


@pytest.mark.parametrize(
    "old, new, complaint",
    [
        ("steps_per_contact = 50", "", "engine.lammps.steps_per_contact.*required to compare with lammps"),
        ("steps_per_contact = 50", "steps_per_contact = 0", "engine.lammps.steps_per_contact = 0.*> 0"),
        ("steps_per_contact = 50", 'steps_per_contact = "5 um"', "engine.lammps.steps_per_contact = '5 um'"),
        ('contact_duration = "40 ns"', "", "engine.lammps.contact_duration.*required"),
        ('contact_duration = "40 ns"', "contact_duration = -1e-9", "contact_duration = -1e-09.*allowed: > 0"),
        ('contact_duration = "40 ns"', 'contact_duration = "40 nm"', "contact_duration = '40 nm'.*dimension"),
    ],
)
def test_bad_contact_settings_name_file_key_value_and_what_is_allowed(old, new, complaint, tmp_path):
    text = (CASES / "drag_relaxation.toml").read_text("utf-8")
    assert old in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(CaseError, match=complaint) as caught:
        contact_settings(load_case(path), "lammps")
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_contact_settings_are_in_si():
    assert contact_settings(CASE, "lammps") == (pytest.approx(4e-8, rel=4 * EPS, abs=0.0), 50.0)


def test_an_engine_without_a_table_is_told_what_is_missing():
    with pytest.raises(CaseError, match=r"engine\.other\.contact_duration"):
        contact_settings(CASE, "other")


# What becomes of the levels


def test_the_limit_of_the_levels_is_compared_not_the_finest_of_them():
    row = only(compare_study(CASE, linear(1.0), None))
    assert (row.case, row.engine, row.quantity, row.unit) == ("drag_relaxation", "lammps", "speed", "m/s")
    assert row.measured == pytest.approx(1.0, rel=1e-12, abs=0.0)
    assert row.order == pytest.approx(1.0, rel=1e-9, abs=0.0)
    assert row.status == "agree"
    # safety factor 1.25 of the last difference, 0.001; and rounding
    assert row.tolerance == pytest.approx(0.00125, rel=1e-6, abs=0.0)


@pytest.mark.parametrize("error, status", [(0.0012, "agree"), (0.0013, "disagree"), (-0.0013, "disagree")])
def test_an_error_beyond_the_tolerance_disagrees(error, status):
    row = only(compare_study(CASE, linear(1.0 + error), None))
    assert row.status == status
    assert row.error == pytest.approx(abs(error), rel=1e-9, abs=0.0)


def test_a_tolerance_too_wide_for_a_verdict_gives_none():
    row = only(compare_study(CASE, linear(1.0, slope=0.01), None))
    assert row.status == "not_tested"
    assert row.reason.startswith("too uncertain")
    assert only(compare_study(CASE, linear(1.0, slope=0.01, limit=0.03), None)).status == "agree"


def test_engines_are_compared_with_the_limit_of_the_reference_and_both_uncertainties():
    ours = limits(linear(1.01))
    row = only(compare_study(CASE, linear(1.012), ours))
    assert row.reference == pytest.approx(1.01, rel=1e-9, abs=0.0)
    assert row.tolerance == pytest.approx(0.0025, rel=1e-6, abs=0.0)
    assert row.status == "agree"
    assert only(compare_study(CASE, linear(1.013), ours)).status == "disagree"


def test_a_quantity_whose_code_engines_share_is_compared_with_the_exact_value():
    """Agreement with the reference would prove nothing: an error that both have is noticed."""
    ours = limits(linear(1.01))
    row = only(compare_study(CASE, linear(1.01, against_exact=True), ours))
    assert (row.reference, row.status) == (1.0, "disagree")
    assert only(compare_study(CASE, linear(1.01), ours)).status == "agree"


def test_what_has_no_exact_value_is_judged_for_engines_only():
    study = linear(1.0, expected=math.nan)
    assert compare_study(CASE, study, None) == []
    assert only(compare_study(CASE, study, limits(linear(1.0)))).status == "agree"
    assert only(compare_study(CASE, study, limits(linear(1.003)))).status == "disagree"
    assert only(compare_study(CASE, study, {})).status == "error"


def test_a_quantity_that_a_level_lacks_is_an_error_and_no_agreement():
    second = measured(1.0, place="impact 2")
    study = study_of([measured(1.0)], [measured(1.0), second], [measured(1.0), second])
    first, row = compare_study(CASE, study, None)
    assert first.status == "agree"
    assert (row.variant, row.status) == ("impact 2", "error")
    assert row.reason == "not every level of refinement has this impact"
    assert math.isnan(row.error)


def test_rows_are_labelled_by_variant_form_and_place():
    case = load_case("wall_bounce").variants()[0]
    study = study_of(*([measured(1.0, place="impact 1")] for _ in STEPS), form="soft")
    assert only(compare_study(case, study, None)).variant == "pickup, soft, impact 1"


@pytest.mark.parametrize("level", range(3))
@pytest.mark.parametrize("wrong", [1.5, 0.5])
def test_a_rounding_quantity_is_judged_by_the_worst_copy_of_the_worst_level(level, wrong):
    values = [[1.0, 1.0, 1.0] for _ in STEPS]
    right = study_of(*([measured(v, quantity="impacts", rounding=0.2)] for v in values))
    assert only(compare_study(CASE, right, None)).status == "agree"
    values[level][1] = wrong
    row = only(compare_study(CASE, study_of(*([measured(v, rounding=0.2)] for v in values)), None))
    assert (row.status, row.kind, row.measured, row.tolerance) == ("disagree", "rounding", wrong, 0.2)


def test_errors_of_opposite_sign_in_two_copies_do_not_cancel_in_a_rounding_quantity():
    study = study_of(*([measured([0.5, 1.5], rounding=0.2)] for _ in STEPS))
    assert only(compare_study(CASE, study, None)).status == "disagree"


@pytest.mark.parametrize("level", range(3))
@pytest.mark.parametrize("wrong", [math.nan, math.inf])
@pytest.mark.parametrize("rounding", [0.0, 0.2])
def test_a_value_that_is_not_finite_is_no_agreement_and_leaves_the_others_alone(level, wrong, rounding):
    values = [[1.0, 1.0], [1.0, 1.0], [1.0, 1.0]]
    values[level][0] = wrong
    study = study_of(*([measured(v, rounding=rounding), measured(1.0, quantity="load")] for v in values))
    speed, load = compare_study(CASE, study, None)
    assert speed.status in ("disagree", "error")
    assert load.status == "agree"


def test_the_spread_over_the_phases_widens_the_tolerance():
    """Half range 0.003 over 16 phases: 2 x 0.003/15 = 0.0004 each, at most 3 times that extrapolated."""
    saw = 0.003 * np.linspace(-1.0, 1.0, 16)
    wide = only(compare_study(CASE, study_of(*([measured(1.0 + saw)] for _ in STEPS)), None))
    narrow = only(compare_study(CASE, study_of(*([measured(np.ones(16))] for _ in STEPS)), None))
    assert narrow.tolerance < 1e-11
    assert 0.0004 <= wide.tolerance <= 0.0012 * (1.0 + 1e-9)


def test_the_corrections_of_two_series_add():
    """1 + 0.002 t_c + 0.001 dt, refined in one at a time from one finest run, tends to 1."""

    def level(duration: float, step: float) -> Level:
        return Level(
            None, Resolution(step, duration), None, [measured(1.0 + 0.002 * duration + 0.001 * step)]
        )

    finest = level(1.0, 1.0)
    study = Study("lammps", "soft")
    # at fixed steps per contact the step shrinks with the duration: the slope of this series is 0.003
    study.series["contact duration"] = [level(4.0, 4.0), level(2.0, 2.0), finest]
    study.series["time step"] = [level(1.0, 4.0), level(1.0, 2.0), finest]
    found = limits(study)["speed", ""]
    assert abs(found.value - 1.0) <= found.uncertainty
    assert len(study.levels) == 5
    # 1.25 of the last differences, 0.003 and 0.001, and rounding
    assert found.uncertainty == pytest.approx(0.005, rel=1e-6, abs=0.0)


def test_plots_get_what_converges_coarsest_first_and_nothing_else():
    constant, counted = measured(1.0, quantity="load"), measured(0.0, quantity="impacts", rounding=0.5)
    study = study_of(*([measured(1.0 + 0.001 * step), constant, counted] for step in STEPS))
    (record,) = convergences(CASE, study, limits(study))
    assert (record.quantity, record.parameter, record.target) == ("speed", "time step", 1.0)
    assert record.levels == STEPS
    assert record.values == pytest.approx((1.004, 1.002, 1.001), rel=EPS, abs=0.0)
    assert record.extrapolated == pytest.approx(1.0, rel=1e-12, abs=0.0)
