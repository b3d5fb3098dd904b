"""The benchmark of the engines shows what it has measured, and no speed of a run of something else."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import engines, engines_page, record
from benchmarks.measurement import Way, digits
from benchmarks.outcome import outcome
from benchmarks.shear import SURFACES, shear_setup, soft_resolution
from benchmarks.shear_lammps import run_lammps
from benchmarks.shear_liggghts import DECK, run_liggghts, run_observed
from cmpcheck.engines import lammps_library, liggghts_library
from reference.heightfield import surface_contact
from reference.neighbors import neighbor_pairs
from reference.state import FLOW_NONE

N, STEPS = 24, 400
CONDITIONS = {"command": "", "date": "", "commit": "", "machine": "", "versions": {}}


def test_the_table_is_made_of_measured_times(monkeypatch, tmp_path):
    monkeypatch.setattr(record, "busy_cores", lambda: 0.5)
    measured = []

    def run(setup):
        timed = engines.usual_end(setup)
        measured.append(len(setup.state.mass) * timed.steps / timed.seconds)
        return timed

    def lose_one(setup):
        timed = engines.usual_end(setup)
        return timed._replace(
            **{name: getattr(timed, name)[1:] for name in ("index", "position", "velocity")}
        )

    def fail(setup):
        raise RuntimeError("no licence")

    ways = [Way("a", "sound", run), Way("b", "leaky", lose_one), Way("c", "failing", fail, 2),
            Way("d", "absent", run, missing="not installed")]  # fmt: skip
    cells = engines.measure([N], 2, ways, ["flat"], STEPS, say=lambda line: None)
    engines_page.write(cells, CONDITIONS, tmp_path / "page", tmp_path / "results")
    low, high = sorted(measured)
    results = json.loads((tmp_path / "results").read_text())
    assert results["particle_steps_per_s"] == {"a": {str(N): pytest.approx(0.5 * (low + high))}}
    rows = {row["engine"]: row for row in results["engines"]["runs"]}
    assert rows["a"]["particle_steps_per_s"] == pytest.approx(measured)
    table = (tmp_path / "page").read_text()
    middle, low, high = (digits(speed / 1e6, 3) for speed in (0.5 * (low + high), low, high))
    assert re.search(
        rf"\| sound \| 1 \| {re.escape(middle)} \| {re.escape(low)} – {re.escape(high)} \|", table
    )
    assert f"| leaky | 1 | kept {N - 1} of {N} particles |" in table
    assert "| failing | 2 | RuntimeError: no licence |" in table
    assert "| absent | 1 | not installed |" in table
    assert [bool(cell.problem) for cell in cells] == [False, True, True, False]


def test_another_model_has_no_speed():
    setup = shear_setup(2000, "asperities", 1500)
    usual = engines.usual_end(setup)
    assert not outcome(setup, engines.usual_end(setup), usual).problem
    without = {"has_pairs": False}, {"has_surface": False}, {"flow": FLOW_NONE}, {"wall_speed": 1.1}
    for change in without:
        other = replace(setup, model=setup.model._replace(**change))
        assert outcome(setup, engines.usual_end(other), usual).problem, change


def test_results_keep_what_other_benchmarks_have_stored(tmp_path):
    record.store({"a": 1, "b": {"x": 1}}, tmp_path / "results")
    record.store({"b": {"y": 2}}, tmp_path / "results")
    assert json.loads((tmp_path / "results").read_text()) == {"a": 1, "b": {"y": 2}}


@pytest.mark.parametrize("surface", SURFACES)
def test_nothing_overlaps_when_the_engines_start(surface):
    """A spring would begin with a push that the reference does not give."""
    setup = shear_setup(1000, surface, STEPS)
    state, radius = setup.state, setup.state.diameter / 2
    periods = np.array([setup.model.length_x, setup.model.length_y, 0.0])
    i, j = neighbor_pairs(state.position, 2.2 * radius.max(), periods).T
    apart = state.position[j] - state.position[i]
    apart[:, :2] -= periods[:2] * np.round(apart[:, :2] / periods[:2])
    assert len(i) > 0
    assert (np.linalg.norm(apart, axis=1) > radius[i] + radius[j]).all()
    assert not any(
        surface_contact(state.heights, setup.model.spacing, *place, r)[0]
        for place, r in zip(state.position, radius, strict=True)
    )
    assert (state.position[:, 2] + radius < state.pad_height).all()


def test_the_lid_of_the_liggghts_deck_is_that_of_the_case():
    """`LiggghtsEngine` does not hand it over."""
    (lid,) = re.findall(r"(?m)^variable lid\s+index (\S+)$", DECK.read_text())
    assert float(lid) * 1e-6 == pytest.approx(shear_setup(N, "flat", STEPS).state.pad_height, rel=1e-12)


@pytest.mark.skipif(not lammps_library.available()[0], reason="LAMMPS is not installed")
@pytest.mark.parametrize("walls", ["fix", "native"])
def test_lammps_simulates_the_shear(walls):
    agrees(shear_setup(N, "flat", STEPS), lambda setup: run_lammps(setup, 1, walls))


@pytest.mark.skipif(not liggghts_library.available()[0], reason="LIGGGHTS is not installed")
@pytest.mark.parametrize(
    "run", [lambda setup: run_liggghts(setup, 1), run_observed], ids=["itself", "driven"]
)
def test_liggghts_simulates_the_shear(run):
    agrees(shear_setup(N, "asperities", STEPS), run)


def agrees(setup, run):
    """The end is that of the reference, and the time is that of so many steps."""
    timed = run(setup)
    assert not outcome(setup, timed, engines.usual_end(setup)).problem
    assert timed.steps == STEPS
    assert timed.seconds > 0.0
    assert timed.time_step == pytest.approx(soft_resolution(setup.case).time_step)
