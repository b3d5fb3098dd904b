"""Ensembles: an honest engine is equivalent, one that removes too much is not, whatever it does to Pi."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from report_example import suite
from scipy import stats

from cmpcheck import ensemble_text, markdown, page, planning
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.ensembles import check_settings, compare_ensembles, resolutions
from cmpcheck.observables import OBSERVABLES, margins, over_time, pair_up
from cmpcheck.plots_ensembles import _draw_difference, ensemble_figure
from cmpcheck.report import report_json
from cmpcheck.results import EnsembleCurve, MeanCurve
from cmpcheck.statistics import sample_size
from reference.case import CaseError, load_case
from reference.ensemble import sample_case
from reference.recording import Run
from reference.simulation import simulate

STEP = 9e-9  # the ordinary step of the case: coarse, so that these tests are quick
SHIPPED = load_case("polish_pair")


def with_engine(**tables):
    return SHIPPED.model_copy(update={"engine": {**SHIPPED.engine, **tables}})


CASE = with_engine(reference={"time_step": STEP})
QUANTITIES = {"flatness", "removals", "depth_sum", "removed_volume"}


class Fake(ReferenceEngine):
    """The reference under LAMMPS's name, at its own time step, with constants changed."""

    name = "lammps"

    def __init__(self, **changes):
        self.changes = changes
        self.forms = set()

    def run(self, setup, resolution):
        self.forms.add(resolution.form)
        changed = {name: factor * getattr(setup.model, name) for name, factor in self.changes.items()}
        model = setup.model._replace(**changed)
        return super().run(replace(setup, model=model), replace(resolution, time_step=STEP))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def honest(folder):
    return compare_ensembles(CASE, (ReferenceEngine(), Fake()), "quick", folder=folder)


@pytest.fixture(scope="module")
def eager():
    """A third more is taken off by each impact (V ~ 1/sigma_y^2)."""
    return compare_ensembles(CASE, (ReferenceEngine(), Fake(yield_stress=0.86)), "quick")


@pytest.fixture(scope="module")
def runs():
    return [simulate(sample_case(CASE, k)) for k in range(4)]


def test_an_engine_that_does_the_same_is_equivalent_in_everything(honest):
    rows = [row for row in honest[0] if row.engine == "lammps"]
    assert {row.quantity for row in rows} == QUANTITIES
    assert len(rows) == planning.QUANTITIES
    assert {(row.status, row.error, row.kind) for row in rows} == {("agree", 0.0, "statistical")}


def test_more_removal_per_impact_is_a_difference(eager):
    """The surface wears sooner and is hit less."""
    rows = [row for row in eager[0] if row.engine == "lammps"]
    assert {row.quantity for row in rows if row.status == "disagree"} >= {"removals", "removed_volume"}


def test_the_form_of_contacts_reaches_engine_and_rows(monkeypatch):
    monkeypatch.setitem(planning.FEWEST, "quick", 2)
    other = Fake()
    rows, ensemble = compare_ensembles(CASE, (ReferenceEngine(), other), "quick", "soft", check_step=False)
    assert {row.engine for row in rows} == {"lammps"}
    assert other.forms == {"soft"}
    assert ensemble.form == "soft"
    assert all(row.variant.startswith("soft") for row in rows if row.engine == "lammps")


def test_runs_are_kept_as_soon_as_they_are_made(honest, folder):
    for name in ("reference", "lammps-impulse"):
        assert len(list((folder / name).iterdir())) == honest[1].pairs
    assert Run.load(folder / "reference" / "0").provenance["complete"]


# The reference's own step


def test_the_reference_is_compared_with_itself_at_twice_its_step(honest):
    rows = [row for row in honest[0] if row.engine == "reference"]
    assert len(rows) == planning.QUANTITIES
    whole = {(r.quantity, r.variant.rpartition(", ")[2]): r for r in honest[0] if r.engine == "lammps"}
    for row in rows:
        place = row.variant.rpartition(", ")[2] if row.quantity == "flatness" else "impulse"
        assert row.variant.startswith("time step 18 ns against 9 ns")
        other = whole[row.quantity, place]
        scale = 1.0 if row.quantity == "flatness" else row.reference / other.reference  # of more samples
        assert math.isclose(row.tolerance, 0.5 * scale * other.tolerance, rel_tol=1e-12)
    assert any(row.error > 0 for row in rows)


def test_the_step_of_the_reference_is_that_of_the_case_file():
    fine, coarse, _ = resolutions(SHIPPED, "lammps", "impulse")
    assert (fine.time_step, coarse.time_step) == (0.5e-9, 1e-9)
    assert resolutions(with_engine(reference={}), "lammps", "impulse")[0].time_step == pytest.approx(9e-9)


@pytest.mark.parametrize(
    "tables, problem",
    [
        ({"reference": {"time_step": 0}}, "engine.reference.time_step"),
        ({"reference": {"time_step": "1 kg"}}, "engine.reference.time_step"),
        ({"reference": {"pilot": {"pairs": 12}}}, "engine.reference.pilot.flatness"),
        ({"reference": {"pilot": SHIPPED.engine["lammps"]["pilot"] | {"pairs": 2}}}, "pilot.pairs"),
        ({"lammps": SHIPPED.engine["lammps"] | {"margin_flatness": 0}}, "engine.lammps.margin_flatness"),
    ],
)
def test_entries_that_make_no_sense_are_refused_before_anything_is_run(tables, problem):
    with pytest.raises(CaseError, match=problem):
        check_settings(with_engine(**tables), "lammps")
    check_settings(SHIPPED, "lammps")


# Curves


def test_removals_over_time_are_those_that_the_reference_counts_as_it_goes(runs):
    for run in runs:
        for o in OBSERVABLES:
            np.testing.assert_allclose(over_time(run, o), run.history[o.quantity], rtol=1e-12, atol=0.0)
        assert over_time(run, OBSERVABLES[1])[-1] > 100


def test_means_and_bands_are_students(runs):
    ours, theirs = runs[:2] + runs[2:], runs[2:] + runs[:2]
    for p in pair_up(margins(CASE, "lammps"), ours, theirs):
        curve = p.curve()
        a, b = (np.array([over_time(r, p.observable) for r in part]) for part in (ours, theirs))
        for found, values, confidence in (
            (curve.reference, a, 0.95), (curve.measured, b, 0.95), (curve.difference, b - a, 0.9),
        ):  # fmt: skip
            error = stats.sem(values, axis=0)
            with np.errstate(invalid="ignore"):
                low, high = stats.t.interval(
                    confidence, 3, values.mean(axis=0), np.where(error > 0, error, 1)
                )
            np.testing.assert_allclose(found.mean, values.mean(axis=0), rtol=1e-12, atol=1e-40)
            moves = error > 0
            assert moves[5:].all()
            np.testing.assert_allclose(np.array(found.lower)[moves], low[moves], rtol=1e-9, atol=1e-40)
            np.testing.assert_allclose(np.array(found.upper)[moves], high[moves], rtol=1e-9, atol=1e-40)
        expected = 0.05 * a[:, -1].mean() if p.observable.relative else 0.02
        assert math.isclose(curve.margin, expected, rel_tol=1e-12)


def flat_curve(margin: float, difference: float) -> EnsembleCurve:
    def level(value: float) -> MeanCurve:
        return MeanCurve((value,) * 3, (value - 1e-9,) * 3, (value + 1e-9,) * 3)

    return EnsembleCurve(
        "depth_sum", "m", (0.0, 1e-5, 2e-5), level(2e-8), level(2e-8 + difference), level(difference),
        margin, "5 % of the reference's mean at the end",
    )  # fmt: skip


@pytest.mark.parametrize("margin, difference", [(1e-9, 2e-10), (1e-9, -8e-9)])
def test_the_margin_is_drawn_where_it_is_and_the_scale_holds_it(margin, difference):
    axes = Figure().add_subplot()
    _draw_difference(axes, flat_curve(margin, difference), np.array([0.0, 10.0, 20.0]))
    mean, zero, low, high = axes.lines
    np.testing.assert_allclose(mean.get_ydata(), difference * 1e9, rtol=1e-12)
    assert list(zero.get_ydata()) == [0.0, 0.0]
    np.testing.assert_allclose([low.get_ydata()[0], high.get_ydata()[0]], [-margin * 1e9, margin * 1e9])
    assert low.get_linestyle() == high.get_linestyle() == "--"
    bottom, top = axes.get_ylim()
    assert bottom < min(-margin, difference - 1e-9) * 1e9
    assert top > max(margin, difference + 1e-9) * 1e9
    (label,) = axes.texts
    assert (label.get_text().strip(), label.get_position()[1]) == ("margin", pytest.approx(margin * 1e9))


def test_a_figure_names_both_engines_and_their_bands_and_is_the_same_every_time():
    svg = ensemble_figure(flat_curve(1e-9, 2e-10), "lammps", "k")
    assert svg == ensemble_figure(flat_curve(1e-9, 2e-10), "lammps", "k")
    for text in ("reference", "lammps", "95 % band", "difference (nm)", "depth sum (nm)", "time (µs)"):
        assert f">{text}</text>" in svg


# Power


def test_with_fewer_pairs_than_quick_runs_no_single_quantity_could_be_called_different():
    n = planning.FEWEST["quick"]
    p_smallest = [planning.QUANTITIES * 2.0 ** (1 - pairs) for pairs in (n - 1, n)]
    assert p_smallest[1] <= 0.05 < p_smallest[0]
    assert f"is {p_smallest[0]:.3g}, above" in planning.fewest_sentence()


def test_full_runs_as_many_pairs_as_the_pilot_asks_for_and_24_at_least():
    limits, spreads = margins(SHIPPED, "lammps"), SHIPPED.engine["lammps"]["pilot"]
    n = planning.pairs_to_run(SHIPPED, "lammps", "full", limits)
    assert n >= max(
        24, sample_size(spreads["flatness"], limits["flatness"])
    )  # and an allowance for the pilot
    calm = with_engine(
        lammps=SHIPPED.engine["lammps"] | {"pilot": dict.fromkeys(spreads, 1e-4) | {"pairs": 12}}
    )
    wild = with_engine(lammps=SHIPPED.engine["lammps"] | {"pilot": spreads | {"removals": 0.2}})
    assert planning.pairs_to_run(calm, "lammps", "full", limits) == 24
    assert planning.pairs_to_run(wild, "lammps", "full", limits) > n
    assert planning.pairs_to_run(wild, "lammps", "quick", limits) == planning.FEWEST["quick"]


def test_the_assumed_spread_is_rarely_below_the_true_one():
    rng, pairs = np.random.default_rng(5), 12
    pilots = rng.normal(0.0, 1.0, (4000, pairs)).std(axis=1, ddof=1)
    share = np.mean([planning.upper_limit(s, pairs) >= 1.0 for s in pilots])
    assert abs(share - planning.ASSURANCE) < 4 * math.sqrt(0.8 * 0.2 / 4000)


def test_every_quantity_says_what_its_pairs_can_tell(honest):
    plans = honest[1].planning
    assert [p.quantity for p in plans] == 2 * [o.quantity for o in OBSERVABLES]
    for p in plans[:4]:
        assert p.found == p.largest == 0.0  # the engine does the same
        assert p.assumed > p.pilot
        assert 0.0 < p.power < 0.9  # 9 pairs are fewer than needed
        assert p.needed > p.pairs
    assert all(math.isnan(p.pilot) and p.assumed == p.found for p in plans[4:])  # this case has no such pilot


# The report


@pytest.mark.parametrize("pairs", [2, 9])
def test_report_json_has_no_value_that_is_no_number(pairs, honest, monkeypatch):
    rows, ensemble = honest
    if pairs < 9:
        monkeypatch.setitem(planning.FEWEST, "quick", pairs)
        rows, ensemble = compare_ensembles(CASE, (ReferenceEngine(), Fake(yield_stress=0.86)), "quick")
    result = suite(rows)
    result.cases[0].ensembles = [ensemble]

    def refuse(constant):
        raise AssertionError(constant)

    text = report_json(result)
    (entry,) = json.loads(text, parse_constant=refuse)["ensembles"]
    assert entry["pairs"] == pairs
    assert [curve["quantity"] for curve in entry["curves"]] == [o.quantity for o in OBSERVABLES]
    assert all(math.isfinite(v) for curve in entry["curves"] for v in curve["difference"]["upper"])
    assert len(text) < 150_000  # 4 curves at 51 times: thin
    for rendered in (page.render(result), markdown.render(result)):
        assert "Sample size" in rendered
        assert ensemble_text.heading(ensemble) in rendered


def test_the_page_says_where_the_engines_part(eager):
    sentences = " ".join(ensemble_text.ledger_sentences(eager[1]))
    assert sentences.startswith("Started from the same arrays, the engines part at the ")
    assert "No verdict hangs on this" in sentences
    result = suite(eager[0])
    result.cases[0].ensembles = [eager[1]]
    assert sentences.split(",")[0] in page.render(result)


def test_no_pictures_where_nothing_has_been_run(tmp_path: Path):
    from cmpcheck.figures.report import report_illustrations

    assert report_illustrations([load_case("swarm")], "full", tmp_path, 1) == []
    assert report_illustrations([CASE], "quick", tmp_path, 1) == []


def test_the_papers_figures_are_drawn_from_the_reports_own_runs(runs, tmp_path: Path):
    from cmpcheck.figures.report import report_illustrations

    for k, run in enumerate(runs[:2]):
        run.save(tmp_path / CASE.name / "reference" / str(k))
    pictures = report_illustrations([CASE], "quick", tmp_path, 1)
    assert [picture.title[:6] for picture in pictures] == [f"Fig. {k}" for k in range(2, 7)]
    assert "2 samples" in pictures[-1].caption
    result = suite()
    result.illustrations = pictures
    text = page.render(result)
    assert text.count('<img alt="Fig. ') == 5
    assert "img-src data:" in text
    assert len(text) < 1_200_000
