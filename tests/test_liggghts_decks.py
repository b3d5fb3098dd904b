"""Laws of the LIGGGHTS decks: each runs as it should with `liggghts -in`, agrees with its closed form, does
not when its physics is another, and has the numbers and the surface of its case."""

from __future__ import annotations

import math
import os
import re
import runpy
import shutil
import subprocess
from pathlib import Path

import pytest
from scipy.optimize import brentq

from cmpcheck.engines.child import MPI_VARIABLES
from cmpcheck.engines.lammps_setup import Deck, deck_path
from cmpcheck.engines.liggghts_library import available
from cmpcheck.engines.liggghts_setup import wall_lines
from cmpcheck.published.benchmark import benchmark_names
from cmpcheck.study import contact_settings
from reference.case import load_case

PAIRS = ("pair_head_on", "pair_slip", "pair_stick")
DRAG = ("drag_relaxation", "drag_regimes", "couette_drift")
WALLS = ("wall_bounce", "wall_oblique", "asperity_bounce", "bounce_train")
DECKS = PAIRS + DRAG + WALLS
NEEDS_CMPCHECK = ("polish_pair",)  # what is removed, and the pad
# The machine's Open MPI, which LIGGGHTS is linked with: the launcher beside `lmp` is that of another MPI
LAUNCHER = shutil.which("mpiexec.openmpi", path="/usr/bin:/usr/local/bin")
# Two ranks add the same few numbers in another order: a few units in the last place of a sum
BETWEEN_RANKS = 1e-12
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")
RESULT = re.compile(r"after|error|friction impulse|normal impulse|restitution|sphere|velocity")

FOUND, REASON = available()
needs_liggghts = pytest.mark.skipif(not FOUND, reason=REASON or "LIGGGHTS is there")
needs_launcher = pytest.mark.skipif(LAUNCHER is None, reason="mpiexec.openmpi is not installed")


def liggghts(deck: Path, *flags: str, ranks: int = 1, folder: Path) -> tuple[int, list[str]]:
    """Run a deck where it is, as a user would; return the exit code and the lines of its log."""
    launcher = [LAUNCHER, "--allow-run-as-root", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    log = folder / f"log{ranks}"
    done = subprocess.run(
        [str(word) for word in (*launcher, "liggghts", "-in", deck.name, "-log", log, *flags)],
        cwd=deck.parent,
        env={key: value for key, value in os.environ.items() if not key.startswith(MPI_VARIABLES)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        timeout=120,
    )
    return done.returncode, log.read_text("utf-8", "replace").splitlines()  # `quit 1` adds stray bytes


def deck(name: str) -> Path:
    return deck_path(name, "liggghts")


def changed(name: str, folder: Path, *replacements: tuple[str, str]) -> Path:
    """A copy of a deck, beside its meshes, with each text, which must be there, replaced."""
    text = deck(name).read_text("utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    for mesh in deck(name).parent.glob("*.stl"):
        shutil.copy(mesh, folder)
    path = folder / f"in.{name}"
    path.write_text(text, "utf-8")
    return path


def results(lines: list[str]) -> list[str]:
    """The lines in which a deck states its results, without the errors, which are differences of these."""
    return [re.split(r"(?:, |^)error", line)[0] for line in lines if RESULT.match(line)]


def test_every_deck_has_a_case():
    found = {path.name for path in deck("wall_bounce").parent.glob("in.*")}
    elsewhere = {"finnie_wear", *benchmark_names()}  # tested with the study, and with the benchmarks
    assert found == {f"in.{name}" for name in {*DECKS, *NEEDS_CMPCHECK, *elsewhere}}


@needs_liggghts
@needs_launcher
@pytest.mark.parametrize("name", DECKS)
def test_a_deck_agrees_with_its_closed_form_on_one_and_two_ranks(name, tmp_path):
    flags = ["-var", "duration", "0.2"] if name == "bounce_train" else []  # two of its impacts
    one, two = (liggghts(deck(name), *flags, ranks=ranks, folder=tmp_path) for ranks in (1, 2))
    for code, lines in (one, two):
        assert code == 0
        assert f"in.{name}: agrees" in lines
    ours, theirs = results(one[1]), results(two[1])
    assert len(ours) > 0
    assert [NUMBER.sub("#", line) for line in ours] == [NUMBER.sub("#", line) for line in theirs]
    for line, other in zip(ours, theirs, strict=True):
        for a, b in zip(NUMBER.findall(line), NUMBER.findall(other), strict=True):
            assert float(a) == pytest.approx(float(b), rel=BETWEEN_RANKS, abs=BETWEEN_RANKS), line


@needs_liggghts
@pytest.mark.parametrize(
    "name, flags",
    [
        ("pair_head_on", "restitution 0.2"),
        ("pair_head_on", "restitution 0.8"),
        ("pair_head_on", "restitution 1"),
        ("wall_bounce", "restitution 0.2 steps_per_contact 30"),
        ("wall_oblique", "vx 0.3 vy 0.4 vz -0.866025"),
        ("asperity_bounce", "x 3.08 y 2.43 z 1.257"),
        ("asperity_bounce", "x 3.05 y 3.05 z 1.26"),
        ("asperity_bounce", "x 3.627 y 2.37 z 0.759"),
    ],
)
def test_a_deck_agrees_for_other_values_too(name, flags, tmp_path):
    words = flags.split()
    pairs = zip(words[::2], words[1::2], strict=True)
    code, lines = liggghts(deck(name), *(w for pair in pairs for w in ("-var", *pair)), folder=tmp_path)
    assert (code, f"in.{name}: agrees" in lines) == (0, True)


@needs_liggghts
def test_the_asperity_deck_shows_that_a_convex_edge_is_counted_twice(tmp_path):
    code, lines = liggghts(
        deck("asperity_bounce"), "-var", "x", "3", "-var", "steps_per_contact", "400", folder=tmp_path
    )
    assert code == 1
    returned = float(NUMBER.findall(next(line for line in lines if line.startswith("velocity")))[5])
    # two springs and dashpots have sqrt(2) of the damping ratio cos(phi); half a step more or less of both
    # dashpots, at touch, is 2 ln(2)/n of the speed, n steps, and as much comes of the late velocity
    assert returned == pytest.approx(restitution(2**0.5 * damping_ratio(0.5)), rel=4 * math.log(2) / 400)


def restitution(ratio: float) -> float:
    """What a dashpot of this damping ratio returns if it never pulls: ln(e) = -2 phi cot(phi)."""
    phi = math.acos(ratio)
    return math.exp(-2 * phi / math.tan(phi))


def damping_ratio(e: float) -> float:
    """The inverse."""
    return float(brentq(lambda ratio: restitution(ratio) - e, 1e-9, 1 - 1e-9))


@needs_liggghts
@pytest.mark.parametrize("name", DECKS)
def test_a_deck_that_simulates_nothing_fails(name, tmp_path):
    code, lines = liggghts(deck(name), "-var", "duration", "0", folder=tmp_path)
    assert code == 1
    assert any("is not simulated" in line or "nothing was simulated" in line for line in lines)


@needs_liggghts
@pytest.mark.parametrize("name", DECKS + NEEDS_CMPCHECK)
def test_no_deck_ends_well_for_another_driver(name, tmp_path):
    driver = "0" if name in NEEDS_CMPCHECK else "1"
    meshes = ["-var", "surface_mesh", "flat.stl", "-var", "pad_mesh", "flat.stl"]
    code, lines = liggghts(deck(name), "-var", "driver", driver, *meshes, folder=tmp_path)
    assert code == 1
    assert any(line.startswith("Loop time") for line in lines) is False


DAMPED = ("cos(v_phi)*v_frequency/v_late)", "cos(v_phi)*v_frequency/v_late*1.05)")


@needs_liggghts
@pytest.mark.parametrize(
    "name, old, new",
    [
        *((name, *DAMPED) for name in (*PAIRS, *WALLS)),
        ("pair_head_on", "limitForce on", "limitForce off"),
        ("pair_slip", "peratomtypepair 1 ${friction}", "peratomtypepair 1 $(0.97*v_friction)"),
        ("pair_stick", "grip      equal $(30/", "grip      equal $(2/"),
        ("wall_oblique", "fix integrate", "fix push all addforce 1e2 0 0\nfix integrate"),
        ("drag_relaxation", "(6*PI*v_viscosity*c_particle)", "(6.02*PI*v_viscosity*c_particle)"),
        ("couette_drift", "v_k*(v_wall_speed*z/v_gap-vx)", "v_k*(v_wall_speed*z/v_gap*1.001-vx)"),
        ("drag_regimes", "1.354*v_h", "1.354*v_h*30"),
        ("drag_regimes", "v_high^(-0.354)", "v_high^(-0.36)"),
        ("bounce_train", "(6*PI*v_viscosity*c_particle)", "(6.6*PI*v_viscosity*c_particle)"),
    ],
)  # fmt: skip
def test_a_deck_with_other_physics_fails_its_own_check(name, old, new, tmp_path):
    code, lines = liggghts(changed(name, tmp_path, (old, new)), folder=tmp_path)
    assert code == 1
    assert f"ERROR: in.{name} disagrees with the closed form" in lines


@needs_liggghts
@pytest.mark.parametrize("name", ["drag_relaxation", "couette_drift", "bounce_train"])
def test_a_deck_with_stokes_drag_ends_beyond_its_range(name, tmp_path):
    code, lines = liggghts(deck(name), "-var", "viscosity", "400", folder=tmp_path)
    assert code == 1
    assert not any("agrees" in line for line in lines)


@needs_liggghts
@pytest.mark.parametrize("name", [*PAIRS, *WALLS])
def test_a_deck_says_so_when_its_contact_law_has_no_such_restitution(name, tmp_path):
    code, lines = liggghts(deck(name), "-var", "restitution", "0.1", folder=tmp_path)
    assert code == 1
    assert "ERROR: this contact law needs a restitution above exp(-2)" in lines


def test_the_meshes_that_ship_are_those_of_the_cases(tmp_path):
    tool = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "surfaces.py"))
    for path in tool["write"](tmp_path):
        assert path.read_bytes() == (deck("wall_bounce").parent / path.name).read_bytes()
    for name in WALLS:
        (mesh,) = values(name)["surface_mesh"]
        surfaces = [load_case(case).surface for case in (name, tool["CASES"][mesh])]
        assert len({(s.kind, s.size, s.nodes, s.asperity_height) for s in surfaces}) == 1


@pytest.mark.parametrize("name", DECKS)
def test_a_deck_is_as_the_engine_needs_it(name):
    text = deck(name).read_text("utf-8")
    assert wall_lines(Deck(deck(name), text))[2:] == (("surface", "wall") if name in WALLS else ("", ""))
    assert "create_atoms" not in Deck(deck(name), text).definitions()
    # LIGGGHTS takes it as the last words of a line only
    assert all(line.endswith("limitForce on") for line in text.splitlines() if " model hooke/" in line)


def values(name: str) -> dict[str, list[str]]:
    """Defaults of the index variables of a deck."""
    found = re.findall(r"(?m)^variable +(\w+) +index +([^#$\n]+)", deck(name).read_text("utf-8"))
    return {key: text.split() for key, text in found}


@pytest.mark.parametrize("name", DECKS)
def test_a_deck_has_the_numbers_of_its_case(name):
    case, index = load_case(name), values(name)

    def same(key: str, *expected: float) -> None:
        assert [float(value) for value in index[key]] == pytest.approx(expected, rel=1e-12, abs=1e-12), key

    same("length_x", case.surface.size * 1e6)
    same("length_y", case.surface.size * 1e6)
    same("duration", case.case.duration * 1e6)
    seconds, steps = contact_settings(case, "liggghts" if "liggghts" in case.engine else "lammps")
    if name in DRAG:
        same("time_step", seconds * 1e6 / steps)
    else:
        same("contact_duration", seconds * 1e6)
        same("steps_per_contact", steps)
        same("restitution", case.contact.restitution)
    if name in PAIRS:
        same("friction", case.contact.dynamic_friction)
    if case.fluid:
        same("fluid_density", case.fluid.density)
        same("viscosity", case.fluid.viscosity / 1e-6)
        if case.fluid.velocity:
            for axis, speed in zip("xyz", case.fluid.velocity, strict=True):
                same(f"flow_{axis}", speed)
        else:
            same("wall_speed", case.fluid.wall_speed)
            same("gap", case.fluid.gap * 1e6)
    for quantity, numbers in particles(case).items():
        if f"{quantity}1" in index:
            for k, number in enumerate(numbers, 1):
                same(f"{quantity}{k}", number)
        else:
            same(quantity, *(set(numbers) if quantity == "density" else numbers))


def particles(case) -> dict[str, list[float]]:
    """What the decks say of each particle, in um, us and kg/m3."""
    rows = {
        "diameter": [p.diameter * 1e6 for p in case.particle],
        "density": [case.material[p.material].density for p in case.particle],
    }
    for axis, letter in enumerate("xyz"):
        rows[letter] = [p.position[axis] * 1e6 for p in case.particle]
        rows[f"v{letter}"] = [p.velocity[axis] for p in case.particle]
    return rows
