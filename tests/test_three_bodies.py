"""A resting sphere struck by another: impacts in turn, soft contacts at once, and what LAMMPS does."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.lammps_library import available
from cmpcheck.engines.lammps_setup import departure_deck
from cmpcheck.engines.protocol import Resolution
from cmpcheck.three_bodies import pinned_restitution, struck_by_impulses, struck_softly
from reference.case import load_case
from reference.exact import resting_struck
from reference.process import build_setup

needs_lammps = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
STEPS = 200  # per contact: the dashpot acts a step more or less at touch, 2 ln(1/e)/n = 0.007 of the speed


def test_impacts_in_turn_keep_momentum_and_give_the_polynomials_in_e():
    e = 0.5
    struck = resting_struck(1.0, 1.0, 1.0, e)
    assert struck.lower == pytest.approx(e * (1 + e) * (1 - e) ** 2 / 4, rel=1e-14)
    assert struck.upper == pytest.approx((1 + e) * (1 + e * e) / 4 - (1 - e) / 2, rel=1e-14)
    assert struck.approaches == pytest.approx([(1 + e) / 2, (1 + e) * (1 - e) ** 2 / 4], rel=1e-14)
    assert struck.normal_impulse == pytest.approx(1.0 + struck.lower + struck.upper, rel=1e-14)


def test_impacts_that_do_not_end_are_refused():
    with pytest.raises(ValueError, match="do not end"):
        resting_struck(1.0, 1.0, 1.0, 0.1)  # below 7 - 4 sqrt(3) there is no end


@pytest.mark.parametrize("restitution", [0.3, 0.5, 0.8])
def test_a_stiff_wall_pins_the_resting_sphere(restitution):
    stiff = struck_softly(0.05, restitution)
    # the lower sphere yields by (m*/m) (w_pair/w_wall)^2 = 0.05^2/2 of the pair's overlap
    assert stiff.lower == pytest.approx(0.0, abs=0.01)
    assert stiff.upper == pytest.approx(pinned_restitution(restitution), abs=0.005)


@pytest.mark.parametrize("ratio", [0.2, 1.0, 5.0])
def test_no_ratio_of_contact_times_makes_soft_contacts_follow_in_turn(ratio):
    soft, turn = struck_softly(ratio, 0.5), resting_struck(1.0, 1.0, 1.0, 0.5)
    assert soft.normal_impulse > 1.15 * turn.normal_impulse
    assert (
        max(soft.approaches) < 0.05 < min(turn.approaches)
    )  # nothing to be removed above a threshold of 0.05


@needs_lammps
@pytest.mark.parametrize("ratio", [0.5, 1.0, 4.0])
def test_lammps_does_what_springs_do_at_any_contact_duration(ratio):
    setup, limit = build_setup(load_case("resting_struck")), struck_softly(ratio, 0.5)
    for wall in (1e-9, 0.25e-9):
        step = wall * min(1.0, 1.0 / ratio) / STEPS
        run = LammpsEngine().run(setup, Resolution(step, wall, "soft", 1.0 / ratio))
        # three contacts, each off by 2 ln(2)/n of the speed at most
        assert run.velocities[-1, :, 2] == pytest.approx([limit.lower, limit.upper], abs=6 * 0.693 / STEPS)
        assert not (run.contacts["removed_volume"] > 0.0).any()


@needs_lammps
def test_impulses_resume_a_contact_that_had_let_go():
    setup, limit = build_setup(load_case("resting_struck")), struck_by_impulses(0.5)
    run = LammpsEngine().run(setup, Resolution(1e-9 / STEPS, 1e-9, "impulse"))
    allowed = 6 * 0.693 / STEPS
    assert run.velocities[-1, :, 2] == pytest.approx([limit.lower, limit.upper], abs=allowed)
    walls = run.contacts[(run.contacts["kind"] == "surface") & (run.contacts["removed_volume"] > 0.0)]
    assert walls["approach_speed"].to_numpy() == pytest.approx(limit.approaches, abs=allowed)


@needs_lammps
@pytest.mark.parametrize(
    "deck, limit",
    [("in.resting_struck", struck_softly(1.0, 0.5)), ("in.resumed_contact", struck_by_impulses(0.5))],
)
def test_a_departure_shows_in_plain_lammps_alone(deck, limit, tmp_path):
    command = [Path(sys.executable).parent / "lmp", "-in", departure_deck(deck), "-log", "none"]
    done = subprocess.run(map(str, command), cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout[-300:]
    line = next(line for line in done.stdout.splitlines() if line.startswith("lower"))
    lower, _, upper, _ = map(float, re.findall(r"\d\.\d+", line))
    assert (lower, upper) == pytest.approx((limit.lower, limit.upper), abs=6 * 0.693 / STEPS)
