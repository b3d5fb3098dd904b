"""The data files of the benchmarks: what is refused, and what the published points say themselves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.published import benchmark_names, load_benchmark
from cmpcheck.published.scene import contact_of
from cmpcheck.published.targets import spinless_restitution
from reference.case import CaseError
from reference.exact.oblique import INERTIA, Law, oblique_impact, sliding, sliding_angle

NAMES = ("chung_ooi_1", "chung_ooi_2", "chung_ooi_3", "chung_ooi_4", "chung_ooi_5", "chung_ooi_7", "kharaz")


def test_the_benchmarks_of_the_issue_ship_with_both_decks():
    assert benchmark_names() == list(NAMES)
    for name in NAMES:
        assert deck_path(name).is_file()
        assert deck_path(name, "liggghts").is_file()


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("floor = 0.003", "", "points[0].floor: required, but missing"),
        ('quantity = "spin"', 'quantity = "spinn"', "points[1].quantity = 'spinn'"),
        ("friction = 0.092", "friction = -0.092", "friction = -0.092"),
        ("values = [5, 10, 15,", "values = [10, 5, 15,", "sweep.values"),
        ("at = [5, 10", "at = [6, 10", "points[0].at"),
        ('material = "aluminium alloy"', 'material = "aluminum"', "points[3].material = 'aluminum'"),
        ("at = [5, 10, 15,", "at = [10, 15,", "allowed: as many as `at` has, 12"),
    ],
)
def test_a_wrong_data_file_is_one_line_naming_the_key(old, new, message, tmp_path):
    text = (Path(load_benchmark.__wrapped__.__globals__["DATA"]) / "chung_ooi_4.toml").read_text("utf-8")
    assert old in text
    (tmp_path / "wrong.toml").write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(CaseError) as caught:
        load_benchmark("wrong", tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_published_points_obey_the_conservation_of_angular_momentum():
    """e_t and spin are digitised from two figures: (2/5) r omega = (1 - e_t) v_t, within both floors."""
    for name in ("chung_ooi_4", "kharaz"):
        benchmark = load_benchmark(name)
        by_quantity = {p.quantity: p for p in benchmark.points if p.material == "aluminium oxide"}
        e_t, spin = by_quantity["tangential_restitution"], by_quantity["spin"]
        for k, angle in enumerate(e_t.at):
            if angle not in spin.at:
                continue
            v_t = 3.9 * math.sin(math.radians(angle))
            j = spin.at.index(angle)
            measured = 1.0 - 0.4 * benchmark.radius * spin.values[j] / v_t
            allowed = e_t.uncertainty(k) + 0.4 * benchmark.radius * spin.uncertainty(j) / v_t
            assert e_t.values[k] == pytest.approx(measured, abs=allowed), angle


def test_published_points_of_sliding_meet_the_closed_form_within_the_floor():
    benchmark = load_benchmark("chung_ooi_4")
    for points in benchmark.points:
        for angle, value, known in zip(
            points.at, points.values, (points.uncertainty(k) for k in range(13)), strict=True
        ):
            if angle < sliding_angle(0.092, 0.98):
                continue
            v_n, v_t = 3.9 * math.cos(math.radians(angle)), 3.9 * math.sin(math.radians(angle))
            exact = sliding(v_n, v_t, 0.092, 0.98)
            of_quantity = {
                "tangential_restitution": exact.tangential,
                "spin": exact.surface_speed / benchmark.radius,
                "rebound_angle": exact.angle(v_n),
            }
            # the angles of the rebound's figure are read to 0.26 degrees, over which it turns by 1.9 of them
            known += 0.26 * 1.9 if points.quantity == "rebound_angle" else 0.0
            assert value == pytest.approx(of_quantity[points.quantity], abs=known)


def test_published_points_of_test_4_lie_nearer_to_a_lower_shear_stiffness():
    """What `known_departures.toml` says of them: in floors, below 32.52 degrees."""
    benchmark = load_benchmark("chung_ooi_4")
    contact = contact_of(benchmark, benchmark.material[0], "hertz", 0.98)
    misses = {}
    for share in (1.0, 0.985):
        law = Law(
            contact.normal / contact.mass, share * contact.shear / contact.mass, True, 0.092, 0.98, 0.0025
        )
        found = []
        for points in benchmark.points[:3]:
            for k in range(6):
                theta = math.radians(points.at[k])
                v_n, v_t = 3.9 * math.cos(theta), 3.9 * math.sin(theta)
                rebound = oblique_impact(law, v_n, v_t)
                value = {
                    "tangential_restitution": rebound.tangential,
                    "spin": rebound.surface_speed / 0.0025,
                    "rebound_angle": rebound.angle(v_n),
                }[points.quantity]
                found.append((value - points.values[k]) / points.floor)
        misses[share] = np.array(found)
    assert np.abs(misses[1.0]).max() == pytest.approx(3.7, abs=0.1)
    assert np.abs(misses[0.985]).max() == pytest.approx(2.2, abs=0.1)
    assert np.sum(misses[0.985] ** 2) < 0.6 * np.sum(misses[1.0] ** 2)


def test_published_points_of_test_5_are_those_of_half_the_shear_stiffness_and_a_growing_force():
    benchmark = load_benchmark("chung_ooi_5")
    contact, points = contact_of(benchmark, benchmark.material[0], "hertz", 1.0), benchmark.points[0]
    stiffness, shear = contact.normal / contact.mass, contact.shear / contact.mass
    dt = contact.impact(5.0).duration / 4000
    for k, v_t in enumerate(points.at):
        d, vn, vt, w, force = 0.0, 5.0, v_t, 0.0, 0.0
        while d >= 0.0:
            d += dt * vn
            normal = stiffness * max(d, 0.0) ** 1.5
            force += 0.5 * shear * math.sqrt(max(d, 0.0)) * (vt - w) * dt
            force = max(-0.3 * normal, min(0.3 * normal, force))
            vn, vt, w = vn - dt * normal, vt - dt * force, w + dt * force / INERTIA
        assert w / (0.3 * 5.0) == pytest.approx(points.values[k], abs=2.0 * points.uncertainty(k))


def test_a_model_without_spin_sticks_or_slides():
    benchmark = load_benchmark("kharaz")
    found = spinless_restitution(benchmark, contact_of(benchmark, benchmark.material[0], "hertz", 1.0))
    for angle, e_t in zip(benchmark.sweep.values, found, strict=True):
        assert e_t == pytest.approx(max(0.0, 1.0 - 0.092 * 2.0 / math.tan(math.radians(angle))), abs=1e-9)
