"""Laws of the seeded errors: a patch fits once or is refused, a guarded source is the right one until one
is on, one that changes nothing is noticed by nothing, a stopped run ends in the same bytes."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from report_example import example
from scipy import stats
from typer.testing import CliRunner

from cmpcheck import page as report_page
from cmpcheck.cli import app
from cmpcheck.components.methods import MODEL_FILES
from cmpcheck.engines import lammps
from cmpcheck.outputs import OutputError
from cmpcheck.planning import QUANTITIES, pilot_spreads
from cmpcheck.sensitivity import building, document, page, power, pytest_score, words
from cmpcheck.sensitivity.catalogue import all_mutants, check_names
from cmpcheck.sensitivity.checks import COMPONENTS, NO_CASE, Baseline, Noticed, bad_rows, only_new
from cmpcheck.sensitivity.children import Died
from cmpcheck.sensitivity.detect import FINE, evaluate, first_noticing, smallest
from cmpcheck.sensitivity.false_alarms import PAIRS, TRIALS, draws_of, judge, summary
from cmpcheck.sensitivity.mutants import Mutant
from cmpcheck.sensitivity.patching import (
    PatchError,
    copy_tree,
    deck_file,
    guarded,
    patched,
    project_root,
    seed_one,
)
from cmpcheck.sensitivity.run import plan_of, run_plan
from cmpcheck.sensitivity.store import Store, source_digest
from cmpcheck.sensitivity.switch import switched_on
from reference.case import load_case

SOURCE = '''
"""A module."""

from __future__ import annotations

FACTOR = 2.0


def area(a, b):
    """Of a rectangle."""
    if a < 0.0:
        return 0.0
    side = a
    for _ in range(2):
        side += 1.0
    return side * b
'''
FILE = "reference/area.py"


def mutant(old: str, new: str, **changes) -> Mutant:
    return Mutant("test", "a test", f"{FILE}:area", old, new, **changes)


WIDER = mutant("return side * b", "return (1.0 + SIZE) * side * b", unit="%")
NOWHERE_NEGATIVE = mutant("    if a < 0.0:\n        return 0.0\n", "")
LONGER = mutant("side += 1.0", "side += 1.0\n        side += 1.0")
WHOLE = mutant(
    "    for _ in range(2):\n        side += 1.0\n    return side * b", "    return side * b + 100.0"
)
NOTHING = mutant("return side * b", "return (side * b)")


def run(source: str, *arguments: float) -> float:
    space: dict = {}
    exec(compile(source, FILE, "exec"), space)
    return space["area"](*arguments)


@pytest.mark.parametrize("old, times", [("no such text", 0), ("a", 11)])
def test_a_patch_that_does_not_fit_once_is_refused(old, times):
    assert (times == 0) == (old not in SOURCE)
    with pytest.raises(PatchError, match=r"occurs \d+ times in reference/area.py; allowed: once"):
        patched(SOURCE, mutant(old, "b"), "1.0")


def test_a_change_outside_of_functions_is_refused():
    with pytest.raises(PatchError, match="not inside a function"):
        guarded(SOURCE, [(0, mutant("FACTOR = 2.0", "FACTOR = 3.0"))])


def test_guarded_sources_are_the_right_ones_until_an_error_is_on_and_then_the_plain_mutant():
    """Errors of one statement, of statements around each other, and of one that is taken away."""
    mutants = [WIDER, NOWHERE_NEGATIVE, LONGER, WHOLE]
    text = guarded(SOURCE, list(enumerate(mutants)))
    for arguments in ((3.0, 2.0), (-3.0, 2.0)):
        assert run(text, *arguments) == run(SOURCE, *arguments)
        for number, own in enumerate(mutants):
            with switched_on(number, 0.25):
                assert run(text, *arguments) == run(patched(SOURCE, own, "0.25"), *arguments)
    assert run(patched(SOURCE, WIDER, "0.25"), 3.0, 2.0) == 12.5  # (3 + 1 + 1) 2 1.25


def test_an_error_that_changes_nothing_needs_no_guard():
    assert "seeded(" not in guarded(SOURCE, [(0, NOTHING)])


def test_every_seeded_error_fits_once_and_they_cover_every_file_of_the_model_and_both_sides():
    mutants = all_mutants()
    assert len(mutants) >= 40
    for own in mutants:
        text = deck_file(project_root(), own).read_text("utf-8")
        assert patched(text, own, "0.5") != text
    files: dict[str, list[tuple[int, Mutant]]] = {}
    for k, own in enumerate(mutants):
        files.setdefault(own.file, []).append((k, own))
    for file, own_ones in files.items():
        if file.endswith(".py"):
            text = guarded((project_root() / file).read_text("utf-8"), own_ones)
            ast.parse(text)
            assert all(f"seeded({k})" in text for k, _ in own_ones), file
    model = {
        f"reference/{name}.py"
        for name in (
            "contact", "drag", "removal", "heightfield", "triangle", "neighbors", "packing", "pad", "process",
            "collisions", "schemes", "timestep", "simulation", "balances", "recording", "ensemble", "genetic",
            "units",
        )
    }  # fmt: skip
    assert model <= set(files)
    assert {own.side for own in mutants} == {"reference", "lammps", "both"}
    assert any(own.file.startswith("cmpcheck/fixes/") for own in mutants)
    assert any(own.file.startswith("lammps_inputs/") for own in mutants)
    assert sum(bool(own.explained) for own in mutants) <= document.MOST_EXPLAINED


def test_what_is_left_out_for_an_error_does_not_depend_on_its_file():
    """The methods import nothing of the model but what they name, and no single run knows the other files."""
    code = (
        "import sys, cmpcheck.{module}; "
        "print(*(m for m in sys.modules if m.startswith(('reference.', 'cmpcheck.'))))"
    )

    def loaded(module: str) -> set[str]:
        command = [sys.executable, "-c", code.format(module=module)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=project_root())
        return {name.replace(".", "/") + ".py" for name in done.stdout.split()}

    assert {f for f in loaded("statistics") if f.startswith("reference/")} == set()
    tree = ast.parse((project_root() / "cmpcheck/components/methods.py").read_text("utf-8"))
    named = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    assert {f"{name.replace('.', '/')}.py" for name in named if name.startswith("reference.")} == set(
        MODEL_FILES
    )
    assert not set(NO_CASE) & (loaded("study") | loaded("compare"))


def test_an_error_of_the_fix_is_looked_for_in_the_process_where_it_is_on(tmp_path, monkeypatch):
    """It is on in this process alone: what a child of it does, it does without the error."""
    mutant = next(own for own in all_mutants() if own.name == "fix: sampled velocity")
    here: list[bool] = []
    monkeypatch.setattr(lammps, "probe", lambda: ("a version", ""))
    monkeypatch.setattr(lammps.LammpsEngine, "run", lambda self, *_: here.append(self.in_process))
    assert bad_rows(mutant, 0, mutant.size, [(COMPONENTS, "")], Baseline(tmp_path), tmp_path)
    assert here == [True]


def test_names_are_unique_and_sides_and_sizes_make_sense():
    with pytest.raises(ValueError, match="one name: test"):
        check_names([WIDER, LONGER])
    with pytest.raises(ValueError, match="allowed: reference, lammps, both"):
        mutant("a", "b", side="nobody")
    with pytest.raises(ValueError, match="SIZE"):
        mutant("a", "b", unit="%")
    with pytest.raises(ValueError, match="name the cases"):
        mutant("a", "b", side="lammps")


def test_a_copy_is_patched_and_the_checkout_is_not(tmp_path):
    before = source_digest()
    own = all_mutants()[0]
    seed_one(copy_tree(tmp_path / "tree"), own, 0.5)
    right, wrong = (root / own.file for root in (project_root(), tmp_path / "tree"))
    assert patched(right.read_text("utf-8"), own, "0.5") == wrong.read_text("utf-8")
    assert source_digest() == before


class Scripted:
    """A child that notices errors from a given size on."""

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def ask(self, request: dict) -> dict:
        return {"rows": [asdict(SEEN[0])] if request["size"] >= self.limit else [], "problem": ""}


SEEN = [Noticed("c", "", "reference", "q", "disagree", 2.0)]


@pytest.mark.parametrize("limit", [0.5, 0.04, 3.3e-7])
def test_the_smallest_size_is_bracketed_by_one_that_is_noticed_and_one_that_is_not(limit):
    found = smallest(Scripted(limit), [WIDER], 0, SEEN, [], [("c", "")])
    assert found["not_noticed"] < limit <= found["size"] <= FINE * found["not_noticed"]
    assert found["by"] == ["c: q"]


def test_an_error_that_is_too_small_at_first_is_made_larger_and_one_without_end_is_given_up():
    found = smallest(Scripted(20.0), [WIDER], 0, [], [], [("c", "")])
    assert found["not_noticed"] < 20.0 <= found["size"] <= FINE * found["not_noticed"]
    assert smallest(Scripted(1e9), [WIDER], 0, [], [], [("c", "")])["size"] is None
    always = smallest(Scripted(0.0), [WIDER], 0, SEEN, [], [("c", "")])
    assert always["not_noticed"] is None
    assert always["size"] < 1e-12


def test_a_check_that_missed_a_size_is_not_asked_about_smaller_ones_and_quick_stops_at_the_first():
    class Two:
        """Case c notices errors from 1 on, case d from 0.1 on."""

        asked: list = []  # noqa: RUF012

        def ask(self, request: dict) -> dict:
            names = [case for case, _ in request["labels"]]
            self.asked.append((request["size"], names))
            limits = {"c": 1.0, "d": 0.1}
            rows = [asdict(replace(SEEN[0], case=n)) for n in names if request["size"] >= limits.get(n, 1e9)]
            return {"rows": rows, "problem": ""}

    labels = [("b", ""), ("c", ""), ("d", "")]
    seen = [SEEN[0], replace(SEEN[0], case="d")]
    found = smallest(Two(), [WIDER], 0, seen, [], labels)
    assert (found["by"], found["size"]) == (["d: q"], pytest.approx(0.1))
    assert {tuple(names) for size, names in Two.asked if size < 0.1} == {("d",)}
    Two.asked.clear()
    assert [row.check for row in first_noticing(Two(), [WIDER], 0, [], labels)] == ["c: q"]
    assert [names for _, names in Two.asked] == [["b"], ["c"]]
    assert [row.check for row in first_noticing(Two(), [WIDER], 0, SEEN, labels)] == ["d: q"]


def test_what_was_bad_before_notices_nothing():
    other = replace(SEEN[0], quantity="other")
    assert only_new([*SEEN, other], SEEN) == [other]


TINY = """
[case]
name = "tiny"
title = "Tiny"
description = "A sphere slows down in a fluid at rest, Eqs (20)-(22)."
duration = "80 ns"
outputs = 5
[[particle]]
diameter = "0.9 um"
position = ["1 um", "1 um", "1 um"]
velocity = [0.5, 0.3, 0.2]
material = "alumina"
[material.alumina]
density = "3950 kg/m^3"
youngs_modulus = "370 GPa"
poisson_ratio = 0.22
[fluid]
density = "1000 kg/m^3"
viscosity = "1 mPa s"
flow = "uniform"
velocity = [0, 0, 0]
[surface]
kind = "none"
size = "4 um"
[contact]
restitution = 0.5
[numerics]
time_step = "4 ns"
"""
STOKES = next(own for own in all_mutants() if own.name == "Stokes's drag")
HARMLESS = replace(
    STOKES, name="no error", unit="", new="return (1.0 * 3.0) * math.pi * viscosity * diameter", size=1.0
)
FRICTION = next(own for own in all_mutants() if own.name == "dynamic friction")


class Stopped(Exception):
    pass


def findings(folder: Path, case: Path, stop_at: str = "", resume: bool = False) -> str:
    """The document of a small run in the folder, without compiling; stopped in a stage."""
    plan = plan_of([HARMLESS, STOKES, FRICTION], [str(case)], "full", jobs=1)

    def progress(stage: str, done: int, total: int) -> None:
        if stage == stop_at and done:
            raise Stopped

    store = Store.resume(folder, plan.settings()) if resume else Store.create(folder, plan.settings(), False)
    run_plan(plan, store, progress)
    return document.text_of(building.build(plan, store))


def test_errors_whose_rows_are_in_the_full_profile_are_left_to_it():
    everything = all_mutants()
    quick, full = (plan_of(everything, [], profile, jobs=1).mutants for profile in ("quick", "full"))
    left_out = [mutant for mutant in everything if mutant not in quick]
    assert full == everything
    assert left_out == [mutant for mutant in everything if mutant.name.startswith("many:")] != []


def test_a_real_error_is_noticed_a_harmless_one_is_not_and_a_stopped_run_ends_the_same(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    case = tmp_path / "tiny.toml"
    case.write_text(TINY, "utf-8")
    whole = findings(tmp_path / "whole", case)
    harmless, stokes, friction = json.loads(whole)["mutants"]
    assert harmless["by"] == friction["by"] == []
    assert {"tiny: velocity_x", "tiny: trajectory_distance"} <= set(stokes["by"])
    assert 0.0 < stokes["largest_not_detected"] < stokes["smallest_detected"] < 1.0  # %
    with pytest.raises(Stopped):
        findings(tmp_path / "stopped", case, stop_at="seeded errors")
    with pytest.raises(OutputError, match="holds an unfinished run; --resume"):
        findings(tmp_path / "stopped", case)
    kept = len(list((tmp_path / "stopped" / "data" / "seeded").glob("*.json")))
    assert 1 <= kept < 3
    assert findings(tmp_path / "stopped", case, resume=True) == whole


def test_samples_of_trials_are_disjoint():
    few, many = draws_of(60, independent=False), draws_of(2 * PAIRS * TRIALS, independent=True)
    assert all(len(set(draw)) == 2 * PAIRS for draw in few)
    assert len(set(many.ravel())) == many.size == 2 * PAIRS * TRIALS


def test_the_interval_of_a_rate_is_that_of_clopper_and_pearson():
    trials = [{"resolved": k < 7, "different": False, "equivalent": True} for k in range(200)]
    found = summary(trials, "quick")
    assert found["resolved"]["rate"] == 7 / 200
    # the bounds at which 7 or more, and 7 or fewer, have a probability of 2.5 %
    assert stats.binom.sf(6, 200, found["resolved"]["low"]) == pytest.approx(0.025, rel=1e-6)
    assert stats.binom.cdf(7, 200, found["resolved"]["high"]) == pytest.approx(0.025, rel=1e-6)
    assert found["different"]["low"] == 0.0
    assert found["equivalent"]["high"] == 1.0


def test_equal_samples_are_equivalent_and_shifted_ones_are_called_different():
    rng = np.random.default_rng(1)
    curve = np.linspace(0.2, 1.0, 51)
    names = ("removals", "depth_sum", "removed_volume")
    pool = {name: curve * (1 + 0.001 * rng.normal(size=(40, 1))) for name in names}
    pool["flatness"] = 1.0 - 0.5 * curve + 0.001 * rng.normal(size=(40, 1))
    ours, theirs = range(PAIRS), range(PAIRS, 2 * PAIRS)
    assert {v.verdict for v in judge(pool, ours, theirs, 999)} == {"equivalent"}
    more = np.where(np.arange(40)[:, None] < PAIRS, 1.0, 1.2)
    shifted = pool | {"removals": more * pool["removals"]}
    verdicts = [v.verdict for v in judge(shifted, ours, theirs, 999)]
    assert verdicts.count("different") == 1


def test_power_has_a_curve_for_every_comparison_and_rises_with_the_difference(monkeypatch):
    """Flatness at five times and three quantities at the end, as `compare` judges them."""
    assert len(power.compared()) == QUANTITIES == 8
    monkeypatch.setattr(power, "TRIALS", 40)
    rng, growth = np.random.default_rng(3), np.linspace(0.0, 1.0, 51)
    values = 1.0 - growth * (0.5 + 0.1 * rng.normal(size=(400, 1)))
    early, late = (power._curve((values, "flatness", k, 62)) for k in (1, 5))
    (case,) = load_case("polish_pair").variants()
    pilot = pilot_spreads(case, "lammps")[1]["flatness"]
    assert late["spread"] == pytest.approx(pilot)
    assert early["spread"] == pytest.approx(pilot / 5)  # the samples part in proportion to time
    assert early["needed"] < late["needed"] == 62
    at = {point["effect"]: point for point in late["points"]}
    assert at[0.0]["equivalent"] > 0.75  # 62 pairs were chosen for 90 %, of 40 trials with an error of 5 %
    assert at[0.0]["different"] == 0.0
    assert at[3.0]["different"] == 1.0
    resolved = [point["resolved"] for point in late["points"]]
    assert resolved == sorted(resolved)


def test_of_the_tests_those_that_reach_a_file_are_asked_the_nearest_first():
    steps = pytest_score.import_steps(project_root())
    order = pytest_score.reaching(steps, "reference/schemes.py")
    assert set(order[1:3]) == {"tests/test_pad.py", "tests/test_timestep.py"}  # its doctests before them
    assert order.index("tests/test_simulation.py") < order.index("tests/test_components.py")
    assert "tests/test_genetic.py" not in order  # the search knows nothing of steps
    assert "tests/test_components.py" in pytest_score.reaching(steps, "reference/packing.py")
    assert all((project_root() / name).is_file() for name in steps)


def test_a_failing_test_whose_name_has_spaces_is_one():
    text = "FAILED tests/test_a.py::test_b[as it ships] - assert 1 == 0\nERROR tests/test_c.py\n1 failed\n"
    assert pytest_score.FAILED.findall(text) == ["tests/test_a.py::test_b[as it ships]", "tests/test_c.py"]


def sample_document(**changes) -> dict:
    """A document as a full run leaves it, in small."""
    entry = {
        "name": "e <off>", "breaks": "e & friends", "where": "reference/contact.py:f", "side": "reference",
        "size": 1.0, "unit": "%", "detected": True, "explained": "", "tests": ["tests/test_x.py::y"],
        "by": ["pair_slip: restitution", "pair_slip: load (lammps)"],
        "smallest_detected": 0.2, "largest_not_detected": 0.17,
    }  # fmt: skip
    lost = entry | {"name": "unseen", "detected": False, "by": [], "smallest_detected": None, "tests": []}
    vain = lost | {"name": "vain", "unit": "", "size": None, "explained": "it vanishes with dt"}
    rate = {"count": 5, "rate": 0.025, "low": 0.008, "high": 0.057}
    return {
        "schema": document.SCHEMA, "profile": "full", "run": ["pair_slip"], "whole": True,
        "mutants": [entry, lost, vain], "checks": [], "power": {}, "orders": {},
        "tests": {"asked": 3, "killed": 1, "survivors": ["unseen", "vain"]},
        "false_alarm_rate": {
            "case": "polish_pair", "alpha": 0.05, "trials": 200, "pairs": 9, "samples": 160,
            "independent": False, "resolved": rate, "different": rate, "equivalent": rate,
        },
    } | changes  # fmt: skip


def test_the_page_shows_every_error_limits_alarms_and_three_sentences_and_escapes_what_it_shows():
    shown = page.render(sample_document())
    assert "e &lt;off&gt;" in shown
    assert "<off>" not in shown
    for text in ("0.2 %", "2.5 %", "it vanishes with dt", "1 are holes: unseen", "tests/test_x.py::y"):
        assert text in shown
    assert len(words.blind_spots(sample_document())) == 3
    text = page.markdown(sample_document())
    assert "| unseen |" in text
    assert "pair_slip 2" in text


def test_a_hole_and_too_many_false_alarms_do_not_pass():
    whole = sample_document()
    seen = [m for m in whole["mutants"] if m["name"] != "unseen"]
    assert not document.passes(whole)
    assert document.passes(whole | {"mutants": seen})
    often = {"count": 40, "rate": 0.2, "low": 0.15, "high": 0.26}
    alarms = whole["false_alarm_rate"] | {"resolved": often}
    assert document.passes(whole | {"whole": False})
    assert not document.passes(whole | {"mutants": seen, "false_alarm_rate": alarms})


def test_the_command_refuses_what_it_cannot_do_in_one_line(tmp_path):
    (tmp_path / "mine.txt").write_text("mine", "utf-8")
    for arguments, text in (
        (["--out", str(tmp_path)], "holds mine.txt and no result of ours"),
        (["--out", str(tmp_path / "none"), "--resume"], "holds no run to go on with"),
        (["--out", str(tmp_path / "none"), "--resume", "--force"], "allowed: one of them"),
        (["nonsense", "--out", str(tmp_path / "none")], "nonsense"),
    ):
        result = CliRunner().invoke(app, ["sensitivity", *arguments])
        assert result.exit_code == 2, result.output
        assert text in result.stderr
        assert len(result.stderr.splitlines()) == 1
    assert (tmp_path / "mine.txt").exists()


def test_the_report_shows_what_lies_beside_it_as_its_fourth_part(tmp_path):
    assert page.section_beside(tmp_path / "latest") is None
    folder = tmp_path / page.FOLDER
    folder.mkdir()
    (folder / "sensitivity.json").write_text(document.text_of(sample_document()), "utf-8")
    beside = page.section_beside(tmp_path / "latest")
    assert beside is not None
    with_it = report_page.render(example(), (), beside)
    assert "4 Sensitivity: what would the suite have caught?" in with_it
    assert 'href="../sensitivity/index.html"' in with_it
    assert "e &lt;off&gt;" in with_it
    assert "4 Sensitivity" not in report_page.render(example())
    (folder / "sensitivity.json").write_text('{"schema": "another"}', "utf-8")
    assert page.section_beside(tmp_path / "latest") is None


def test_an_error_that_kills_its_process_is_noticed_and_a_dying_baseline_is_not_hidden():
    class Mortal:
        def ask(self, request: dict) -> dict:
            raise Died("its process died")

    assert [row.check for row in evaluate(Mortal(), [WIDER], 0, 0.1, [])] == ["process: its process died"]
    with pytest.raises(Died):
        evaluate(Mortal(), [WIDER], None, 0.0, [])


def test_a_process_that_is_killed_once_from_outside_is_no_finding():
    class Interrupted(Scripted):
        killed = False

        def ask(self, request: dict) -> dict:
            if not self.killed:
                self.killed = True
                raise Died("its process died")
            return super().ask(request)

    assert evaluate(Interrupted(limit=1.0), [WIDER], 0, 0.5, []) == []
