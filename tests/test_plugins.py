"""Engines of other packages: the examples are installed as a user does, and compared by the command."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from cmpcheck import engines
from cmpcheck.compare import compare_study
from cmpcheck.engines import engine_names, is_plugin, make_engine
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.protocol import NotSupported, Resolution
from cmpcheck.judges import judge_of
from cmpcheck.study import align_outputs, contact_settings, engine_study, has_settings
from reference.case import CASES, load_case
from reference.process import build_setup
from reference.simulation import simulate_setup

EXAMPLES = Path(__file__).parents[1] / "examples"
QUICK = ("steps_per_contact = 100", "steps_per_contact = 60")


def install(example: str, folder: Path) -> dict[str, str]:
    """Install an example into a folder of its own; the environment in which it is found."""
    source, target = folder / "source", folder / "site"
    shutil.copytree(EXAMPLES / example, source)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"]
    command = [*pip, "--no-build-isolation", "--no-index", "--target", target, source]
    subprocess.run(command, check=True, capture_output=True, text=True)
    return os.environ | {"PYTHONPATH": str(target)}


def compare(
    environment: dict[str, str], folder: Path, cases: list[str], *options: str
) -> tuple[int, list[dict[str, str]]]:
    """Exit code and rows of the engine that is not the reference."""
    command = [
        sys.executable,
        "-m",
        "cmpcheck",
        "compare",
        *cases,
        *options,
        "--jobs",
        "1",
        "--out",
        folder / "out",
    ]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert "Traceback" not in done.stderr
    rows = json.loads((folder / "out" / "report.json").read_text("utf-8"))["comparisons"]
    return done.returncode, [row for row in rows if row["engine"] != "reference"]


def one_variant(folder: Path, duration: str) -> str:
    """pair_head_on with e = 0.5 only, and longer contacts in fewer steps."""
    text = (CASES / "pair_head_on.toml").read_text("utf-8")
    head, _, _ = text.partition("[[variant]]")
    assert QUICK[0] in head
    head = head.replace(*QUICK).replace('contact_duration = "0.5 ns"', f'contact_duration = "{duration}"')
    (folder / "mine.toml").write_text(head, "utf-8")
    return "mine.toml"


def test_the_example_is_found_by_its_entry_point_and_judged(tmp_path):
    environment = install("engine_plugin", tmp_path)
    code, rows = compare(
        environment, tmp_path, [one_variant(tmp_path, "1 ns"), "pair_slip"], "--engine", "two_spheres"
    )
    assert code == 0
    head_on = [row for row in rows if row["case"] == "pair_head_on"]
    assert {row["status"] for row in head_on} == {"agree"}
    assert {"restitution", "normal_impulse", "velocity_x", "trajectory_distance"} <= {
        r["quantity"] for r in head_on
    }
    (slip,) = [row for row in rows if row["case"] == "pair_slip"]
    assert slip["status"] == "not_tested"
    assert "two spheres without wall and friction" in slip["reason"]


@pytest.mark.parametrize("factor, status", [(1.0, "agree"), (1.01, "disagree")])
def test_one_percent_of_restitution_of_the_example_is_noticed(factor, status, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES / "engine_plugin")
    case = load_case(tmp_path / one_variant(tmp_path, "1 ns"))
    setup = align_outputs(build_setup(case))
    engine, judge = import_module("two_spheres").TwoSpheres(), judge_of(setup)
    wrong = setup.model._replace(restitution=factor * setup.model.restitution)
    monkeypatch.setattr("cmpcheck.study.settings_table", lambda case, name: "lammps")
    study = engine_study(engine, judge, replace(setup, model=wrong), "quick", "native")
    found = {row.quantity: row.status for row in compare_study(case, study, {})}
    assert found["restitution"] == found["normal_impulse"] == status
    assert found["momentum"] == "agree"


@pytest.fixture
def plugin(monkeypatch):
    """Pretend that entry points are there."""

    def pretend(*points: tuple[str, str]) -> None:
        found = EntryPoints(EntryPoint(name, value, engines.GROUP) for name, value in points)
        monkeypatch.setattr(engines, "entry_points", lambda group: found)

    return pretend


@pytest.mark.parametrize(
    "points, reason",
    [
        ([("mine", "no_such_module:Engine")], "no_such_module:Engine: ModuleNotFoundError"),
        ([("mine", "math:pi")], "TypeError"),
        ([("mine", "builtins:dict")], "AttributeError"),
        ([("mine", "cmpcheck.engines.reference:ReferenceEngine")], "it is no engine named mine"),
        ([("mine", "a:A"), ("mine", "b:B")], "several packages bring an engine mine: a:A, b:B"),
    ],
)
def test_a_plugin_that_cannot_be_used_says_why_in_one_line(points, reason, plugin):
    plugin(*points)
    info = make_engine("mine").info()
    assert not info.available
    assert reason in info.reason
    assert "\n" not in info.reason


FAULTY = """
import os, time
from cmpcheck.engines.protocol import NotSupported
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.results import EngineInfo

class Faulty(ReferenceEngine):
    name = "faulty"
    def info(self): return EngineInfo("faulty", "1", True)
    def run(self, setup, resolution):
        print("the last words", flush=True)
        return FAULTS[setup.case.case.title](setup, resolution)

def refuse(*_): raise NotSupported("too much")

FAULTS = {"hang": lambda *_: time.sleep(1000), "crash": lambda *_: os.abort(), "exit": lambda *_: os._exit(3),
          "none": lambda *_: None, "bug": lambda *_: 1 / 0, "refuse": refuse, "sound": ReferenceEngine().run}
"""


def test_a_plugin_that_fails_is_an_error_in_time_with_its_last_words(plugin, tmp_path, monkeypatch):
    (tmp_path / "faulty_engine.py").write_text(FAULTY, "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    plugin(("faulty", "faulty_engine:Faulty"))
    engine, case = make_engine("faulty"), load_case("pair_head_on").variants()[0]
    table = {"contact_duration": 1e-9, "steps_per_contact": 20.0}

    def run(fault, **more):
        tables = {**case.engine, "faulty": table | more}
        header = case.case.model_copy(update={"title": fault})
        setup = build_setup(case.model_copy(update={"case": header, "engine": tables}))
        return engine.run(setup, Resolution(setup.time_step))

    for fault, said in {
        "crash": r"faulty: the process has died \(signal SIGABRT\) \(log: the last words\)",
        "exit": r"has died \(exit code 3\)",
        "none": "run has returned NoneType",
        "bug": "ZeroDivisionError: division by zero",
    }.items():
        with pytest.raises(EngineError, match=said):
            run(fault)
    with pytest.raises(NotSupported, match="too much"):
        run("refuse")
    begin = time.monotonic()
    with pytest.raises(
        EngineError, match=r"no answer within 2 s; the process was ended \(log: the last words"
    ):
        run("hang", timeout="2 s")
    assert time.monotonic() - begin < 60  # of the 1000 s that it would have taken
    sound = run("sound")
    assert sound.positions.tobytes() == simulate_setup(build_setup(case)).positions.tobytes()


def test_a_plugin_that_hangs_at_its_import_is_not_available(plugin, tmp_path, monkeypatch):
    (tmp_path / "endless_engine.py").write_text("import time\ntime.sleep(1000)\n", "utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("cmpcheck.engines.plugin.ANSWERS_WITHIN", 1.0)
    plugin(("endless", "endless_engine:Engine"))
    info = make_engine("endless").info()
    assert not info.available
    assert info.reason.startswith("endless_engine:Engine: no answer within 1 s")


def test_engines_that_ship_keep_their_names(plugin):
    plugin(("lammps", "builtins:dict"), ("mine", "builtins:dict"))
    assert engine_names() == (*engines.ENGINES, "mine")
    assert not is_plugin("lammps")
    assert type(make_engine("lammps")).__name__ == "LammpsEngine"


def test_a_plugin_takes_lammps_contacts_unless_the_case_has_its_own(plugin):
    case = load_case("pair_slip")
    plugin(("mine", "builtins:dict"))
    assert has_settings(case, "mine")
    assert contact_settings(case, "mine") == contact_settings(case, "lammps")
    own = case.model_copy(
        update={"engine": case.engine | {"mine": {"contact_duration": 1e-9, "steps_per_contact": 9}}}
    )
    assert contact_settings(own, "mine") == (1e-9, 9.0)
    plugin()
    assert not has_settings(case, "mine")


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("yade") is None, reason="no command yade: apt-get install yade")
def test_yade_agrees_on_pairs_and_a_flat_wall(tmp_path):
    environment = install("yade", tmp_path)
    text = (CASES / "wall_bounce.toml").read_text("utf-8")
    pickup = '[[variant]]\nname = "pickup"\noverrides.removal.mass_pickup = true\n\n'
    assert pickup in text
    (tmp_path / "wall.toml").write_text(text.replace(pickup, ""), "utf-8")
    cases = ["pair_slip", "wall.toml", "drag_relaxation"]
    code, rows = compare(environment, tmp_path, cases, "--engine", "yade")
    assert code == 0
    assert {row["status"] for row in rows if row["case"] != "drag_relaxation"} == {"agree"}
    assert {row["case"] for row in rows if row["status"] == "agree"} == {"pair_slip", "wall_bounce"}
    (drag,) = [row for row in rows if row["case"] == "drag_relaxation"]
    assert drag["status"] == "not_tested"
