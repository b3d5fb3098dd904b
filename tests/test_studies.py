"""Studies: exponents, shapes in words, the same for any number of processes, and failures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from polish_example import small_polish
from report_example import suite
from rounding import close

from cmpcheck import report
from cmpcheck.results import Chart, Column, Curve, Estimate, StudyResult, Table
from cmpcheck.studies import acceleration, particle_speed, preston, registry, time_step
from cmpcheck.studies.polish_full import the_run
from cmpcheck.studies.registry import run_studies
from cmpcheck.studies.sampling import changed, estimate, held, powers, standing
from cmpcheck.studies.shape import shape_of
from cmpcheck.studies.spacing import last_on_refined, refined
from cmpcheck.studies.sweep import Found, Setting, sweep
from cmpcheck.studies.tables import csv_frame, frame_table
from cmpcheck.verdicts import exit_code
from reference import simulate
from reference.case import CaseError
from reference.checkpoint import Checkpoint
from reference.heightfield import height_at
from reference.process import build_setup
from reference.recording import Run, version_of_code

LEVELS = np.array([0.5, 1.0, 2.0, 4.0])


# Exponents


def test_an_exact_power_law_is_recovered():
    other = np.array([3.0, 1.0, 5.0, 2.0])
    scatter = np.array([0.7, 1.0, 1.9])  # a factor of each sample, that is of its surface
    found = powers([LEVELS, other], np.outer(LEVELS**1.3 * other**-0.4, scatter))
    close([p.exponent.value for p in found], [1.3, -0.4], rtol=1e-12)
    assert all(p.exponent.standard_error < 1e-12 for p in found)


def test_nineteen_of_twenty_intervals_hold_the_planted_exponent():
    rng = np.random.default_rng(5)
    trials, held_it = 400, 0
    for _ in range(trials):
        y = LEVELS[:, None] ** 1.5 * np.exp(rng.normal(0.0, 0.3, (4, 6)) + rng.normal(0.0, 1.0, 6))
        held_it += powers([LEVELS], y)[0].holds(1.5)
    # a binomial count of 400 at 0.95 is within 4 standard deviations, 17, of 380
    assert abs(held_it - 0.95 * trials) <= 17


def test_a_rate_of_zero_is_refused():
    with pytest.raises(ValueError, match="zero or negative"):
        powers([LEVELS], np.zeros((4, 3)))


# Shapes


def fig_6(t: np.ndarray, scratch: float = 0.0) -> np.ndarray:
    """Unchanged to 0.3, a line down to 0.1 at 0.7, level after that; with a scratch at 0.9."""
    return np.interp(t, [0.0, 0.3, 0.7, 1.0], [1.0, 1.0, 0.1, 0.1]) + scratch * (t >= 0.9)


def test_the_shape_of_fig_6_in_words():
    t = np.linspace(0.0, 1.0, 201)
    shape = shape_of(t, fig_6(t, scratch=0.02))
    assert abs(shape.unchanged_until - 0.3) <= 0.01  # Pi may change by 0.01, at a slope of 2.25: 0.0044
    close(shape.slope, -2.25, rtol=1e-9)
    assert shape.r_squared > 0.999999
    assert shape.level_from is not None
    assert 0.6 <= shape.level_from <= 0.72  # windows of 0.1: flat where less than a fifth lies on the slope
    close(shape.rise, 0.02, rtol=1e-9)
    close(shape.rise_at, 0.9, rtol=1e-9)
    words = shape.words("s")
    for phrase in ("unchanged until", "nearly linear", "levels off from", "rises again by scratching"):
        assert phrase in words


def test_a_curve_that_goes_on_falling_and_bends_is_called_neither_linear_nor_level():
    t = np.linspace(0.0, 1.0, 201)
    words = shape_of(t, 1.0 - 0.9 * t**4).words("s")
    assert "not linear" in words
    assert "has not levelled off" in words
    assert "no scratch" in words


def test_a_curve_that_does_not_fall_has_no_shape():
    with pytest.raises(ValueError, match="flatness falls"):
        shape_of([0.0, 1.0, 2.0], [1.0, 0.999, 0.995])


# What is measured


def test_a_held_pad_stands_still_and_its_load_is_the_sum_of_its_impulses():
    case = held(small_polish(), 1.2e-6, numerics={"ledger_speed": 0.0})
    run = simulate(case)
    pad = run.contacts[run.contacts.kind == "pad"]
    assert len(pad) > 10
    close(-run.history.pad_impulse_z.iloc[-1], pad.normal_impulse.sum(), rtol=1e-12)
    assert (run.history.pad_height == 1.2e-6).all()
    assert run.history.pad_work.iloc[-1] == 0.0


def test_a_refined_surface_is_the_same_surface():
    rng = np.random.default_rng(2)
    z, h = rng.random((5, 6)), 0.5
    fine = refined(z)
    for x, y in rng.random((200, 2)) * (5 * h, 6 * h):
        close(height_at(fine, h / 2, x, y), height_at(z, h, x, y), rtol=1e-12)
    # the twin: the other diagonal is another surface
    flipped = refined(z[:, ::-1])[:, ::-1]
    assert abs(flipped - fine).max() > 0.01


def test_a_refined_surface_is_as_flat():
    case = small_polish()
    plain, fine = (last_on_refined(case, k) for k in (1, 2))
    close(plain.flatness, simulate(case).history.flatness.iloc[-1], rtol=0)
    assert 0.0 < fine.flatness <= 1.0


def test_differences_are_taken_seed_by_seed():
    case = small_polish()
    other = changed(case, removal={"threshold_velocity": 0.2})
    one, two = sweep([Setting(("a",), case), Setting(("b",), other)], 0, 3)
    assert one.difference["flatness"] == (0.0, 0.0)
    close(
        two.difference["flatness"].value, two.mean["flatness"].value - one.mean["flatness"].value, rtol=1e-9
    )
    assert two.difference["flatness"].standard_error < np.hypot(
        one.mean["flatness"].standard_error, two.mean["flatness"].standard_error
    )


def test_rates_that_follow_prestons_law_give_its_exponents():
    """Made-up rates K P V with a factor per sample: every exponent of the law is found to be its own."""
    factor = np.array([0.8, 1.0, 1.3])
    found = {}
    for v in preston.SPEEDS:
        for count in preston.COUNTS:
            for h in preston.HEIGHTS:
                varied = (v != preston.SPEED) + (count != preston.COUNT) + (h != preston.HEIGHT)
                if varied <= 1:
                    load = 40.0 * v**0.5 * count * (1e-6 / h) ** 3
                    rate = load * v * factor
                    found[v, count, h] = pd.DataFrame(
                        {"load": np.full(3, load), "volume_rate": rate, "depth_rate": rate}
                    )
    for (_, within, _), (fit, law) in preston.exponents(found).items():
        if np.isfinite(law):
            close(fit.exponent.value, law, rtol=1e-9)
        if within == "N":
            close(fit.exponent.value, 1.0, rtol=1e-9)


def test_an_interval_too_wide_to_decide_shows_no_law():
    narrow, wide, other = (
        preston.Power(Estimate(x, 0.1), w) for x, w in ((1.1, 0.2), (1.1, 3.0), (2.0, 0.2))
    )
    assert "holds within" in preston._standing((narrow, narrow))
    assert "neither" in preston._standing((narrow, wide))
    assert "does not hold" in preston._standing((wide, other))


# Convergence in the time step


def steps_of(
    offsets: Sequence[float], noise: float, rng: np.random.Generator, rule: str = time_step.NEW
) -> time_step.Block:
    """Made-up samples at halved steps: Pi and removals off by so much from the finest, at the first time."""
    frames, n, case = [], 16, small_polish()
    for offset in offsets:
        columns = {"removals": 1000.0 * (1.0 + rng.normal(0.0, noise, n))}
        columns["removed_volume"] = columns["removals"]
        columns |= {name: 0.8 + rng.normal(0.0, noise, n) for name in time_step.FLATNESS_AT}
        columns[time_step.FLATNESS_AT[0]] += offset
        frames.append(pd.DataFrame(columns))
    found = []
    for k, rows in enumerate(frames):
        difference = {q: estimate(rows[q] / frames[-1][q].mean() - frames[-1][q] / frames[-1][q].mean())
                      for q in ("removals", "removed_volume")}  # fmt: skip
        cells = ("made up", rule, 0.01 * 0.5**k, 1e-9 * 0.5**k, 0.1)
        found.append(Found(Setting(cells, case), rows, {}, difference))
    return time_step.Block("made up", rule, found)


def test_noise_is_not_decided_and_is_no_convergence():
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.1, (200, 5, 16))
    answers = [standing([estimate(time) for time in times], 16, time_step.SAME_FLATNESS) for times in noise]
    assert "converged" not in answers
    # either sign has 5 % at most to be called different: 20 of 200, a binomial count within 4 deviations, 17
    assert answers.count("different") <= 37
    block = steps_of((0.0, 0.0), 0.1, rng)
    assert block.converged(time_step.AMOUNTS)[0] is None
    assert "Π not shown to converge (at 0.01 not decided, n = 16)" in time_step._standing(block)


def test_a_difference_at_one_time_is_told_and_one_below_the_limit_is_none():
    rng = np.random.default_rng(2)
    block = steps_of((0.03, 0.03, 0.004, 0.0), 0.002, rng)
    answers = [block.standing(one, time_step.FLATNESS) for one in block.found]
    assert answers == ["different", "different", "converged", "converged"]
    fine, coarser = block.converged(time_step.FLATNESS)
    assert (fine, coarser) == (block.found[2], block.found[1])
    assert "Π converged from γ = 0.0025 on (at 0.005 different, n = 16)" in time_step._standing(block)


def test_a_rule_is_advised_only_where_the_other_is_known_to_differ():
    rng = np.random.default_rng(3)
    new = steps_of((0.0, 0.0, 0.0), 0.002, rng)
    for offset, noise, advised in ((0.03, 0.002, True), (0.0, 0.1, False), (0.0, 0.002, False)):
        every = steps_of((offset, 0.0, 0.0), noise, rng, time_step.EVERY)
        assert ("new_contacts_only" in time_step._advice([every, new])) == advised


def test_factors_are_advised_up_to_the_first_that_differs():
    def one(factor: float, change: float, error: float) -> Found:
        mean = {"flatness": Estimate(0.8, 0.01), "removals": Estimate(1000.0 / factor, 1.0)}
        setting = Setting((factor, 1.0), small_polish())
        return Found(setting, pd.DataFrame({"x": range(8)}), mean, {"flatness": Estimate(change, error)})

    found = [one(400, 0.001, 0.01), one(200, 0.10, 0.01), one(100, 0.01, 0.01), one(50, 0.0, 0.0)]
    said = acceleration._sentence(found)
    assert "up to A = 100 no change" in said
    assert "At A = 200 Π(T) differs" in said
    assert "400" not in said


def test_the_speed_of_particles_is_judged_at_times_fixed_beforehand():
    rng = np.random.default_rng(4)
    noise = rng.normal(0.0, 0.01, (8, 101))
    t = np.linspace(0.0, 1.0, 101)
    for course, said in (
        (0.0, "told from none"),
        (0.2, "as the paper says"),
        (-0.2, "contrary to the paper"),
    ):
        assert said in particle_speed._sentence(0.5 + course * t + noise, np.full((8, 101), 0.5))


# Running


def one_study(profile: str, runs: Path) -> StudyResult:
    found = sweep([Setting((1.0,), small_polish())], 0, 2)
    rows = ((1.0, found[0].mean["flatness"], "a|b"),)
    table = Table("one", (Column("x", "m"), Column("Π"), Column("text")), rows)
    curve = Curve("c", (1.0, 2.0), (1.0, 2.0), (0.9, 1.9), (1.1, 2.1))
    chart = Chart("chart", Column("x", "m"), Column("y"), (curve, replace(curve, style="points")), True)
    return StudyResult("one", "One <i>", "Varied.", "Samples.", (table,), "A sentence.", (chart,))


def broken_study(profile: str, runs: Path) -> StudyResult:
    raise ValueError("it broke")


@pytest.fixture
def two_studies(monkeypatch: pytest.MonkeyPatch) -> None:
    """The registry with one study that works and one that fails, run in this process."""
    monkeypatch.setattr(registry, "STUDIES", {"broken": broken_study, "one": one_study})


def in_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    from concurrent.futures import ThreadPoolExecutor

    from cmpcheck import pool

    monkeypatch.setattr(pool, "ProcessPoolExecutor", lambda jobs, context, **_: ThreadPoolExecutor(jobs))


def without_clock(results: list[StudyResult]) -> list[StudyResult]:
    return [replace(result, seconds=0.0) for result in results]


def test_a_study_that_fails_is_an_entry_and_the_others_go_on(two_studies, monkeypatch, tmp_path):
    in_threads(monkeypatch)
    broken, one = run_studies(["one", "broken"], "quick", tmp_path, 2)
    assert broken.error == "ValueError: it broke"
    assert not one.error
    result = suite()
    assert exit_code(result) == 0
    result.studies = [one]
    assert exit_code(result) == 0
    result.studies = [broken, one]
    assert exit_code(result) == 1
    report.write_report(result, tmp_path)
    document = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert document["studies"][0]["error"] == "ValueError: it broke"
    cell = document["studies"][1]["tables"][0]["rows"][0][1]
    assert set(cell) == {"value", "standard_error"}
    for name in ("index.html", "report.md"):
        text = (tmp_path / name).read_text("utf-8")
        assert "it broke" in text
        assert "A sentence." in text
    assert "<i>" not in (tmp_path / "index.html").read_text("utf-8")


def test_a_study_finds_the_same_with_one_process_and_with_two(tmp_path):
    names = ["fine_abrasive", "threshold"]
    once = without_clock(run_studies(names, "quick", tmp_path, 1))
    twice = without_clock(run_studies(names[::-1], "quick", tmp_path, 2))
    assert once == twice
    assert [result.name for result in once] == ["threshold", "fine_abrasive"]
    assert not any(result.error for result in once)


def test_a_csv_file_has_the_error_in_a_column_of_its_own():
    table = Table(
        "t", (Column("x", "m"), Column("Π")), ((1.0, Estimate(2.0, 0.5)), (2.0, Estimate(3.0, 0.1)))
    )
    frame = csv_frame(table)
    assert list(frame.columns) == ["x (m)", "Π", "Π, standard error"]
    assert frame.iloc[0].tolist() == [1.0, 2.0, 0.5]


def test_a_data_frame_becomes_a_table():
    frame = pd.DataFrame({"scheme": ["a"], "error": [0.5], "count": [3]})
    table = frame_table("t", frame, {"error": "m"})
    assert table.columns == (Column("scheme"), Column("error", "m"), Column("count"))
    assert table.rows == (("a", 0.5, 3.0),)


def test_two_columns_of_one_name_are_refused():
    with pytest.raises(ValueError, match="one name"):
        csv_frame(Table("t", (Column("x"), Column("x")), ()))


def test_a_run_that_is_there_is_read_and_one_that_is_not_needs_the_full_profile(tmp_path, monkeypatch):
    case = small_polish()
    with pytest.raises(ValueError, match="no complete run"):
        the_run(case, tmp_path / "run", may_run=False)
    made = the_run(case, tmp_path / "run", may_run=True)
    monkeypatch.setattr("cmpcheck.studies.polish_full.simulate", lambda *a, **k: pytest.fail("run again"))
    read = the_run(case, tmp_path / "run", may_run=True)
    pd.testing.assert_frame_equal(read.history, made.history)
    other = changed(case, case={"seed": 4})
    with pytest.raises(ValueError, match="no complete run"):
        the_run(other, tmp_path / "run", may_run=False)


@pytest.mark.parametrize("key, value", [("code", "of yesterday"), ("engine", "lammps"), ("complete", False)])
def test_a_run_by_another_version_or_engine_is_made_anew(tmp_path, key, value):
    case = small_polish()
    made = simulate(case, out=tmp_path)
    made.provenance[key] = value
    made.save(tmp_path)
    with pytest.raises(ValueError, match="no complete run"):
        the_run(case, tmp_path, may_run=False)
    again = the_run(case, tmp_path, may_run=True)
    assert (again.provenance["engine"], again.provenance["complete"]) == ("reference", True)
    assert Run.load(tmp_path).provenance["code"] == version_of_code()


def test_a_checkpoint_of_another_case_does_not_stop_the_run(tmp_path):
    Checkpoint(tmp_path, build_setup(small_polish(case={"duration": 20e-6, "outputs": 6, "seed": 9}))).start()
    case = small_polish()
    with pytest.raises(CaseError, match="another case"):
        simulate(case, out=tmp_path, resume=True)
    assert the_run(case, tmp_path, may_run=True).provenance["complete"]
