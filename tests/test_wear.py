"""Finnie's wear: its integral over a contact in closed form and by quadrature, LIGGGHTS against both, and the
study that puts it beside the paper's removal."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rounding import close

from cmpcheck.convergence import credible_orders
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.engines.liggghts_library import available
from cmpcheck.engines.liggghts_wear import PRINTED, FinnieDeck
from cmpcheck.fixes.calibration import damping_ratio
from cmpcheck.studies import wear
from cmpcheck.studies.sampling import changed
from cmpcheck.studies.wear_laws import PAPER, Laws, judged
from reference.case import load_case
from reference.exact import (
    Wall,
    finnie_angle,
    finnie_contact,
    finnie_contact_excess,
    finnie_contact_quadrature,
    finnie_impact,
    removing_impact,
)
from reference.exact.wear import BEND

found, reason = available()
needs_liggghts = pytest.mark.skipif(not found, reason=reason)
DECK = deck_path("finnie_wear", "liggghts")
STEPS = (100, 200, 400)


@pytest.fixture(scope="module")
def laws() -> Laws:
    (case,) = changed(load_case(wear.CASE).variants()[0], material=wear.COPPER).variants()
    return Laws(case)


@pytest.fixture(scope="module")
def deck() -> Iterator[FinnieDeck]:
    one = FinnieDeck()
    yield one
    one.close()


# Closed forms


@pytest.mark.parametrize("angle", [0.1, 5.0, 18.0, 19.0, 45.0, 80.0, 89.9])
@pytest.mark.parametrize("damping", [0.0, 0.24, 0.9])
def test_the_integral_is_the_same_by_quadrature_whatever_the_damping(angle: float, damping: float):
    a = np.deg2rad(angle)
    form = finnie_contact(2.0, 3.0, a, 0.5)
    # quadrature is asked for 1e-12, and for 1e-13 of k m v^2
    close(finnie_contact_quadrature(2.0, 3.0, a, 0.5, damping), form, rtol=1e-11, scale=9.0)


def test_finnies_function_is_continuous_and_has_its_maximum_where_its_derivative_vanishes():
    # 2 cos 2a = 3 sin 2a there; the value is that of sin 2a + 3/2 cos 2a - 3/2
    best = 0.5 * np.arctan(2 / 3)
    close(finnie_angle(best), np.sqrt(3.25) - 1.5)
    assert all(finnie_angle(best + d) < finnie_angle(best) for d in (-0.01, 0.01))
    close(finnie_angle(BEND * (1 + 1e-15)), finnie_angle(BEND), rtol=1e-14)
    assert finnie_angle(0.0) == 0.0
    assert finnie_angle(np.pi / 2) < 1e-32


def test_the_integral_departs_from_the_law_of_the_impact():
    grazing = 1e-4
    # f = 2 a at grazing incidence, its integral over the contact 2 a^2
    close(finnie_impact(1.0, 1.0, grazing, 1.0) / grazing, 2.0, rtol=2e-4)
    close(finnie_contact(1.0, 1.0, grazing, 1.0) / grazing**2, 2.0, rtol=2e-4)
    assert finnie_contact(1.0, 1.0, np.pi / 3, 1.0) > 2.0 * finnie_impact(1.0, 1.0, np.pi / 3, 1.0)
    close(finnie_contact(1.0, 3.0, 0.5, 1.0), 9.0 * finnie_contact(1.0, 1.0, 0.5, 1.0))


@pytest.mark.parametrize("speed, angle", [(1.0, 90.0), (1.0, 30.0), (0.1, 60.0)])
def test_the_papers_removal_is_that_of_the_closed_form(laws: Laws, speed: float, angle: float):
    alumina, model = laws.modulus, laws.model
    modulus = alumina * model.surface_modulus / (alumina + model.surface_modulus)
    wall = Wall(0.5, modulus, 0.34, 0.3e9, 8960.0)
    a = np.deg2rad(angle)
    velocity = [speed * np.cos(a), 0.0, -speed * np.sin(a)]
    hit = removing_impact(laws.mass, 0.45e-6, velocity, [0.0, 0.0, 1.0], wall)
    close(laws.paper(speed, angle), hit.removal.volume, rtol=1e-9)


def test_where_the_papers_removal_is_zero(laws: Laws):
    assert laws.paper(1.0, 90.0) > 0.0
    assert laws.paper(1.0, 90.0, poisson_ratio=0.5) == 0.0
    assert laws.paper(0.0499, 90.0) == 0.0 < laws.paper(0.0501, 90.0)


# LIGGGHTS


@needs_liggghts
@pytest.mark.parametrize("angle", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_liggghts_converges_at_first_order_to_the_integral(
    laws: Laws, deck: FinnieDeck, angle: float, restitution: float
):
    impacts = [laws.impact(1.0, angle, n)._replace(restitution=restitution) for n in STEPS]
    volumes = np.array([float(deck.removed(impact).sum()) for impact in impacts])
    one = judged(laws, (1.0, angle), STEPS, volumes)
    assert one.verdict.status == "agree", one.verdict
    assert one.limit.credible
    # what is left of the error without its first order, which quadrature gives, is of second order
    a, damping = np.deg2rad(angle), damping_ratio(restitution)
    first = [finnie_contact_excess(laws.mass, 1.0, a, laws.coefficient, n, damping) for n in STEPS]
    error = volumes - laws.quadrature(1.0, angle)
    left = np.abs(error - first)
    low, high = credible_orders(2.0)
    orders = np.log2(left[:-1] / left[1:])
    assert low <= min(orders) <= max(orders) <= high, orders
    assert (left[1:] < 0.1 * error[1:]).all()


@needs_liggghts
@pytest.mark.parametrize("wrong", ["k", "angle", "speed"])
def test_another_law_is_told_from_liggghts(laws: Laws, deck: FinnieDeck, wrong: str):
    changes = {
        "k": {"coefficient": 1.02 * laws.coefficient},
        "angle": {"angle": 60.0},  # sine and cosine exchanged
        "speed": {"speed": 1.01},
    }[wrong]
    volumes = [float(deck.removed(laws.impact(1.0, 30.0, n)._replace(**changes)).sum()) for n in STEPS]
    assert judged(laws, (1.0, 30.0), STEPS, volumes).verdict.status == "disagree"


@needs_liggghts
def test_wear_is_by_triangle_and_its_volume_does_not_depend_on_the_mesh(laws: Laws, deck: FinnieDeck):
    impact = laws.impact(1.0, 30.0, 100)
    whole = deck.removed(impact)
    fine = FinnieDeck(mesh=DECK.parent / "flat.stl")
    try:
        parts = fine.removed(impact)
    finally:
        fine.close()
    assert whole.shape == (1,)
    assert len(parts) == 128
    assert np.count_nonzero(parts) == 1
    close(parts.sum(), whole.sum(), rtol=2 * PRINTED)


@needs_liggghts
def test_head_on_liggghts_wears_nothing(laws: Laws, deck: FinnieDeck):
    assert deck.removed(laws.impact(1.0, 90.0, 100)).sum() < 1e-25 * laws.integral(1.0, 45.0)


@needs_liggghts
def test_what_liggghts_refuses_is_an_error_in_its_words(laws: Laws, tmp_path: Path):
    broken = tmp_path / "in.broken"
    broken.write_text(DECK.read_text("utf-8").replace("k_finnie", "k_archard"), "utf-8")
    bad = FinnieDeck(broken)
    try:
        with pytest.raises(EngineError, match=r"in\.broken: LIGGGHTS: .*k_finnie"):
            bad.removed(laws.impact(1.0, 30.0, 100))
    finally:
        bad.close()


# The deck as its user runs it


def run_deck(folder: Path, text: str, *flags: str) -> subprocess.CompletedProcess[str]:
    shutil.copy(DECK.parent / "triangle.stl", folder)
    (folder / "in.deck").write_text(text, "utf-8")
    return subprocess.run(
        ["liggghts", "-in", "in.deck", "-log", "none", *flags], cwd=folder, capture_output=True, text=True,
        errors="replace",  # it may print memory that it has not set
        stdin=subprocess.DEVNULL, timeout=60,
    )  # fmt: skip


@needs_liggghts
@pytest.mark.parametrize(
    "flags",
    [
        (),
        ("-var", "angle", "5", "-var", "speed", "0.1"),
        ("-var", "angle", "85"),
        ("-var", "restitution", "1"),
    ],
)
def test_the_deck_agrees_with_its_closed_form(tmp_path: Path, flags: tuple[str, ...]):
    ended = run_deck(tmp_path, DECK.read_text("utf-8"), *flags)
    assert ended.returncode == 0, ended.stdout[-500:]
    assert "in.finnie_wear: agrees" in ended.stdout


@needs_liggghts
@pytest.mark.parametrize(
    "right, wrong",
    [
        ("k_finnie peratomtypepair 2 " + 3 * "${coefficient} ", "k_finnie peratomtypepair 2 " + 3 * "9e-10 "),
        ("vx ${slip} vy 0 vz $(-v_approach)", "vx ${approach} vy 0 vz $(-v_slip)"),
        ("wear finnie", "wear off"),
    ],
)
def test_the_deck_sees_wrong_physics(tmp_path: Path, right: str, wrong: str):
    text = DECK.read_text("utf-8")
    assert right in text
    ended = run_deck(tmp_path, text.replace(right, wrong))
    assert ended.returncode == 1
    assert "in.finnie_wear: agrees" not in ended.stdout


# The study


@needs_liggghts
def test_the_study_says_what_it_measured(tmp_path: Path):
    result = wear.study("quick", tmp_path)
    by_angle, _, by_speed, powers, zeros = result.tables
    assert {row[-1] for row in by_angle.rows + by_speed.rows} == {"agree"}
    power = {(row[0], row[1]): row[2].value for row in powers.rows}
    close(power["LIGGGHTS, finest steps", "v"], 2.0, rtol=1e-9)
    close(power[PAPER, "v"], 2.4, rtol=1e-3)  # 12/5 but for (x_p/R)^2
    head_on, incompressible, below, above = (row[3:] for row in zeros.rows)
    assert head_on[0] == 1.0
    assert max(head_on[1:]) < 1e-25
    assert incompressible[0] == below[0] == 0.0 < above[0]
    assert min(below[1:]) > 0.01
    for said in ("at first order", "v^2.40", "α^2.00 at grazing incidence instead of α^1.00", "head-on"):
        assert said in result.sentence
    assert all(chart.curves[-1].style == "points" for chart in result.charts)


def test_without_liggghts_the_laws_are_compared_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(wear, "available", lambda: (False, "no program liggghts"))
    result = wear.study("quick", tmp_path)
    assert not result.error
    assert "LIGGGHTS was not tested: no program liggghts." in result.sentence
    assert "at first order" not in result.sentence
    assert {row[-1] for row in result.tables[0].rows} == {"not_tested"}
    assert all(row[1] >= 0.0 and np.isnan(row[4]) for row in result.tables[0].rows)
    assert all(curve.style == "line" for chart in result.charts for curve in chart.curves)
