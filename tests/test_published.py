"""Benchmarks of the field as they are compared: what agrees, what is known, and what the suite notices."""

from __future__ import annotations

import numpy as np
import pytest

from cmpcheck.engines import liggghts_library
from cmpcheck.engines.lammps_library import available
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.published import load_benchmark
from cmpcheck.published.judge import Series, cross_rows, find_limits, rows_of
from cmpcheck.published.measure import measure
from cmpcheck.published.run import BenchmarkTask, run_benchmark, run_series
from cmpcheck.published.run_lammps import run_lammps
from cmpcheck.published.scene import build_scene, contact_of
from cmpcheck.published.show import charts_of, tables_of
from cmpcheck.verdicts import standing

NAMES = ("chung_ooi_1", "chung_ooi_2", "chung_ooi_3", "chung_ooi_4", "chung_ooi_5", "chung_ooi_7", "kharaz")
needs_lammps = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
needs_liggghts = pytest.mark.skipif(not liggghts_library.available()[0], reason="LIGGGHTS is not installed")
needs = {"lammps": needs_lammps, "liggghts": needs_liggghts}
BOTH = [pytest.param(name, marks=mark) for name, mark in needs.items()]


@pytest.mark.parametrize("engine", BOTH)
@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_agrees_but_for_what_is_known(engine, name, tmp_path):
    from cmpcheck.departures import apply_departures

    result = run_benchmark(BenchmarkTask(name, (engine,), "quick", tmp_path))
    versions = {"lammps": "20250722", "liggghts": "3.8.0"}
    rows = apply_departures(result.comparisons, versions)
    strange = [row for row in rows if standing(row) not in ("agree", "known")]
    assert not strange
    assert any("e = 0" in note for note in result.notes) == (name == "chung_ooi_3")
    assert sum(standing(row) == "agree" for row in rows) > 10
    assert (tmp_path / name / "curves.csv").read_text().count("\n") > 10
    assert any("no spin" in note for note in result.notes)
    if name == "kharaz":
        (table,) = result.tables
        assert "model without spin" in table.caption
        assert any("no spin" in curve.label for chart in result.charts for curve in chart.curves)


@needs_lammps
@pytest.mark.parametrize(
    "name, model, old, new, quantity",
    [
        ("chung_ooi_3", "hertz", "v_E_eff) ${restitution}", "v_E_eff) $(0.98*v_restitution)", "restitution"),
        ("chung_ooi_4", "hertz", "0 ${friction} damping", "0 $(1.05*v_friction) damping", "spin"),
        (
            "chung_ooi_4", "spring-dashpot", "${shear_stiffness} 0", "$(0.9*v_shear_stiffness) 0",
            "tangential_restitution",
        ),
        (
            "chung_ooi_1", "hertz", "hertz/material ${youngs_modulus}",
            "hertz/material $(1.01*v_youngs_modulus)", "largest_force",
        ),
        ("chung_ooi_7", "hertz", "tangential mindlin NULL 0", "tangential linear_nohistory 5", ""),
    ],
)  # fmt: skip
def test_other_physics_is_noticed(name, model, old, new, quantity, tmp_path):
    text = deck_path(name).read_text("utf-8")
    assert old in text
    deck = tmp_path / "in.mine"
    deck.write_text(text.replace(old, new), "utf-8")
    benchmark = load_benchmark(name)
    task = BenchmarkTask(name, ("lammps",), "quick", tmp_path, {name: deck})
    e = 0.6 if name == "chung_ooi_3" else benchmark.restitution
    series = run_series(task, benchmark, "lammps", benchmark.material[0], model, e)
    wrong = {
        row.quantity
        for row in rows_of(benchmark, series)
        if row.status == "disagree" and "published" not in row.variant
    }
    # counter-spinning spheres have nothing to rub, so that other friction changes nothing
    assert (quantity in wrong) if quantity else not wrong


LEGACY = """\
variable driver index standalone
variable hertz index 0
variable radius index 0.0025
variable friction index 0.092
variable normal_stiffness index 1e7
variable shear_stiffness index 1e7
variable time_step index 1e-8
variable length_x index 1
variable length_y index 1
variable height index 1
units si
atom_style sphere 1
atom_modify map array sort 0 0
boundary p p m
region box block 0 ${length_x} 0 ${length_y} $(-v_radius) ${height}
create_box 1 box
neighbor $(v_radius/5) bin
comm_modify vel yes
fix wall all wall/gran hooke/history ${normal_stiffness} ${shear_stiffness} 1 0 ${friction} 1 zplane 0 NULL
fix integrate all nve/sphere
timestep ${time_step}
if "${driver} != standalone" then "quit 1"
"""


@needs_lammps
def test_the_legacy_walls_of_this_release_are_noticed(tmp_path):
    """`wall/gran hooke/history` loses almost all friction, whatever its input; without damping, NaN."""
    deck = tmp_path / "in.legacy"
    deck.write_text(LEGACY, "utf-8")
    benchmark = load_benchmark("kharaz")
    task = BenchmarkTask("kharaz", ("lammps",), "quick", tmp_path, {"kharaz": deck})
    rows = rows_of(
        benchmark, run_series(task, benchmark, "lammps", benchmark.material[0], "spring-dashpot", 1.0)
    )
    sliding_rows = [row for row in rows if row.variant.endswith("sliding")]
    assert sliding_rows
    assert all(row.status == "disagree" for row in sliding_rows)
    (sixty,) = (row for row in sliding_rows if "59.84" in row.variant and row.quantity != "spin")
    assert sixty.measured > 0.99 > 0.9 > sixty.reference


@needs_lammps
def test_a_deck_that_lets_spheres_stick_is_an_error_and_the_others_go_on(tmp_path):
    deck = tmp_path / "in.stuck"
    deck.write_text(
        deck_path("chung_ooi_2").read_text("utf-8").replace("zplane 0 NULL", "zplane -1 NULL"), "utf-8"
    )
    result = run_benchmark(
        BenchmarkTask("chung_ooi_2", ("lammps",), "quick", tmp_path, {"chung_ooi_2": deck})
    )
    assert {row.status for row in result.comparisons} == {"error"}
    assert "still touch" in result.comparisons[0].reason


@needs_lammps
def test_engines_are_compared_with_one_another():
    benchmark = load_benchmark("chung_ooi_4")
    material = benchmark.material[0]
    contact = contact_of(benchmark, material, "hertz", 0.98)
    deck = Deck.read(deck_path("chung_ooi_4"))
    scenes = [build_scene(benchmark, material, contact, level) for level in range(3)]
    found = [measure(benchmark, scene, run_lammps(deck, scene)) for scene in scenes]
    steps = tuple(scene.time_step for scene in scenes)
    one = Series("lammps", material, contact, find_limits(scenes, found), steps, tuple(found))
    moved = [{key: v + 0.01 * (key[0] == "tangential_restitution") for key, v in m.items()} for m in found]
    two = Series("lammps", material, contact, find_limits(scenes, moved), steps, tuple(moved))
    assert {row.status for row in cross_rows(benchmark, one, one)} == {"agree"}
    rows = cross_rows(benchmark, one, two)
    assert len(rows) == 6
    assert {row.status for row in rows} == {"disagree"}
    assert all(chart.curves for chart in charts_of(benchmark, [one]))
    assert tables_of(benchmark, [one]) == []


def test_a_scene_touches_at_equally_spaced_phases_and_its_spheres_stay_apart():
    for name in NAMES:
        benchmark = load_benchmark(name)
        contact = contact_of(benchmark, benchmark.material[-1], "hertz", benchmark.restitution)
        scene = build_scene(benchmark, benchmark.material[-1], contact, 0)
        end = scene.position + scene.velocity * scene.steps * scene.time_step
        along = np.abs(end - scene.position)[:, :2].max()
        assert along < benchmark.radius  # of 2 r between neighbours
        assert scene.variables["length_x"] > scene.position[:, 0].max()
