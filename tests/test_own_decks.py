"""A user's own deck: what it lacks is named before anything runs, and the verdict is about what came out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cmpcheck.cli import app
from cmpcheck.engines.lammps_contract import check_deck, contract
from cmpcheck.engines.lammps_library import available
from cmpcheck.engines.lammps_setup import DRIVER_LINE, Deck, deck_path
from cmpcheck.engines.protocol import Resolution
from cmpcheck.study import contact_settings
from reference.case import CASES, CaseError, load_case
from reference.process import build_setup

pytestmark = pytest.mark.skipif(not available()[0], reason="LAMMPS is not installed")
runner = CliRunner()

# the input that gives the restitution e back to a contact that never pulls, as in in.pair_slip
WALL = """\
variable e index 0.5
variable effective_mass index 1.0
variable phi equal $(PI/2*sqrt(1+ln(v_e)/2))
variable newton equal v_phi-(v_phi*cos(v_phi)+ln(v_e)/2*sin(v_phi))/&
((1+ln(v_e)/2)*cos(v_phi)-v_phi*sin(v_phi))
variable phi equal ${newton}
variable phi equal ${newton}
variable phi equal ${newton}
variable stiffness equal $(v_effective_mass*(2*v_phi/(v_contact_duration*sin(v_phi)))^2)
fix wall all wall/gran granular hooke ${stiffness} $(exp(-PI/tan(v_phi))) &
  tangential linear_nohistory 0 0 damping coeff_restitution limit_damping zplane 0 NULL
"""


def deck(folder: Path, name: str, *replacements: tuple[str, str]) -> Path:
    """The deck that `init --deck` writes, with texts replaced."""
    shipped = deck_path(name)
    text = contract(name, Deck(shipped, shipped.read_text("utf-8")))
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / "in.mine"
    path.write_text(text, "utf-8")
    return path


def native_wall(folder: Path, wall: str) -> Path:
    """in.wall_bounce with a wall of LAMMPS's own in the place of the fix."""
    path = deck(folder, "wall_bounce")
    text = path.read_text("utf-8")
    head = text[: DRIVER_LINE.search(text).start()]
    head, count = re.subn(r"(?m)^fix cmpcheck_state .*\n", lambda _: wall, head)
    assert count == 1
    path.write_text(head + 'if "${driver} == standalone" then "run 0"\n', "utf-8")
    return path


def case_file(folder: Path, name: str, *replacements: tuple[str, str]) -> Path:
    text = (CASES / f"{name}.toml").read_text("utf-8")
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / "mine.toml"
    path.write_text(text, "utf-8")
    return path


@pytest.fixture(scope="module")
def judged(tmp_path_factory) -> dict[str, dict[str, set[str]]]:
    """Statuses of LAMMPS's rows by case and quantity: of the deck that agrees, and of all others together."""
    others = [name for name in DECKS if name != "own_wall"]
    return compare(["own_wall"], tmp_path_factory) | compare(others, tmp_path_factory)


def compare(names: list[str], tmp_path_factory) -> dict[str, dict[str, set[str]]]:
    """Statuses of LAMMPS's rows by case and quantity, of some of `DECKS`, from the command line."""
    arguments = ["compare", "--engine", "lammps", "--jobs", "1"]
    for name in names:
        case, write = DECKS[name]
        folder = tmp_path_factory.mktemp(name)
        renamed = (f'name = "{case}"', f'name = "{name}"')
        arguments += [str(case_file(folder, case, renamed, *([NO_PICKUP] if case == "wall_bounce" else [])))]
        arguments += ["--deck", f"{name}={write(folder)}"]
    out = tmp_path_factory.mktemp("report") / "report"
    result = runner.invoke(app, [*arguments, "--out", str(out)])
    assert result.exception is None or isinstance(result.exception, SystemExit)
    found: dict[str, dict[str, set[str]]] = {name: {} for name in names}
    for row in json.loads((out / "report.json").read_text("utf-8"))["comparisons"]:
        if row["engine"] == "lammps":
            found[row["case"]].setdefault(row["quantity"], set()).add(row["status"])
    wrong = [s for rows in found.values() for s in rows.values() if "disagree" in s or "error" in s]
    assert (result.exit_code == 1) == bool(wrong)
    return found


def check(name: str, path: Path) -> None:
    case = load_case(name).variants()[0]
    duration, steps = contact_settings(case, "lammps")
    check_deck(path, build_setup(case), Resolution(duration / steps, duration))


@pytest.mark.parametrize("name", ["pair_slip", "wall_bounce", "couette_drift", "swarm", "polish_pair"])
def test_a_deck_that_init_wrote_lacks_nothing(name, tmp_path):
    check(name, deck(tmp_path, name))


@pytest.mark.parametrize(
    "replacements, lacks",
    [
        (
            [("units micro\n", "units si\n"), ("atom_style sphere 1", "atom_style atomic")],
            ["units micro", "sphere 1"],
        ),
        ([("block 0 ${length_x}", "block 0 4")], ["a box periodic along x with the period length_x"]),
        ([("boundary p p", "boundary p f")], ["a box periodic along y"]),
        ([("fix integrate all nve", "# none")], ["a fix that integrates the motion"]),
        ([("create_box 1 box", "create_box 1 box\ncreate_atoms 1 single 1 1 1")], ["without create_atoms"]),
        ([('if "${driver}', 'if "a${driver}')], ['no line begins with  if "${driver}']),
        ([("pair_style granular", "pair_style granlar")], ["Unrecognized pair style"]),
        ([("pair_coeff * *", "# none &\n#")], ["pair coeff"]),
    ],
)
def test_all_that_a_deck_lacks_is_named_at_once(replacements, lacks, tmp_path):
    path = deck(tmp_path, "pair_slip", *replacements)
    with pytest.raises(CaseError) as caught:
        check("pair_slip", path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert all(part.lower() in message.lower() for part in lacks), message


def test_the_state_of_the_fix_is_named(tmp_path):
    with pytest.raises(CaseError, match="per-atom state of the fix: fix cmpcheck_state"):
        check("wall_bounce", deck(tmp_path, "wall_bounce", ("d2_cmpcheck 49", "d2_cmpcheck 3")))


def test_a_deck_that_lacks_something_ends_the_command_before_anything_runs(tmp_path):
    path = deck(tmp_path, "pair_slip", ("fix integrate all nve", "# none"))
    out = tmp_path / "report"
    arguments = [
        "compare",
        "pair_slip",
        "--engine",
        "lammps",
        "--deck",
        f"pair_slip={path}",
        "--out",
        str(out),
    ]
    result = runner.invoke(app, arguments)
    assert (result.exit_code, result.stdout, len(result.stderr.splitlines())) == (2, "", 1)
    assert "the deck lacks a fix that integrates the motion" in result.stderr
    assert not out.exists()


NO_PICKUP = ('[[variant]]\nname = "pickup"\noverrides.removal.mass_pickup = true\n\n', "")
DECKS = {  # the case that each is of, and what writes it
    "slips_two_percent_more": (
        "pair_slip",
        lambda folder: deck(folder, "pair_slip", (" ${friction} damping", " $(1.02*v_friction) damping")),
    ),
    "own_wall": ("wall_bounce", lambda folder: native_wall(folder, WALL)),
    "own_wall_too_elastic": (
        "wall_bounce", lambda folder: native_wall(folder, WALL.replace("e index 0.5", "e index 0.505"))
    ),
    "no_wall": ("wall_bounce", lambda folder: native_wall(folder, "")),
}  # fmt: skip


def test_two_percent_of_friction_disagree(judged):
    found = judged["slips_two_percent_more"]
    assert found["friction_impulse"] == found["energy_lost"] == {"disagree"}
    assert found["momentum"] == {"agree"}


@pytest.mark.parametrize("name, status", [("own_wall", "agree"), ("own_wall_too_elastic", "disagree")])
def test_a_wall_of_lammps_is_judged_by_what_comes_out(name, status, judged):
    found = judged[name]
    assert found["restitution"] == found["velocity_z"] == found["normal_impulse"] == {status}
    assert found["trajectory_distance"] == {"agree"} or status == "disagree"
    assert not {"load", "removed_volume", "impacts"} & set(found)  # not observed, so not compared


def test_a_deck_without_a_wall_is_an_error_where_one_is_reached(judged):
    assert judged["no_wall"] == {"run": {"error"}}
