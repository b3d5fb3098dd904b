"""Laws of engines that fail: a crash, a hang, a lost particle or a broken fix is an error of that engine's
comparisons, with the reason and the last lines of its log, and everything else goes on."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmpcheck.engines import lammps, lammps_library, lammps_run, liggghts_library
from cmpcheck.engines.child import Child, shared_child
from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.engines.liggghts import LiggghtsEngine
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes import python_driver
from cmpcheck.study import contact_settings
from cmpcheck.variant_task import Task, run_task
from reference.case import CaseError, load_case
from reference.process import build_setup

CRASH, HANG = 'shell "kill -SEGV $PPID"', "shell sleep 1000"
ENGINES = [
    pytest.param(
        LammpsEngine, "", "pair_slip", '\nif "${driver} != standalone', id="lammps",
        marks=pytest.mark.skipif(not lammps_library.available()[0], reason="LAMMPS is not installed"),
    ),
    pytest.param(
        LiggghtsEngine, "liggghts", "pair_slip", '\nif "${driver} != 0', id="liggghts",
        marks=pytest.mark.skipif(not liggghts_library.available()[0], reason="LIGGGHTS is not installed"),
    ),
]  # fmt: skip
needs_lammps = pytest.mark.skipif(not lammps_library.available()[0], reason="LAMMPS is not installed")


def deck_with(folder: Path, case: str, engine: str, driver_line: str, command: str) -> dict[str, Path]:
    """The deck that ships, with a command at the end of its definitions."""
    text = deck_path(case, engine).read_text("utf-8")
    assert text.count(driver_line) == 1
    (folder / "in.faulty").write_text(text.replace(driver_line, f"\n{command}{driver_line}"), "utf-8")
    return {case: folder / "in.faulty"}


def run(engine, case, **changes):
    setup = replace(build_setup(case.variants()[0]), **changes)
    duration, steps = contact_settings(setup.case, engine.name)
    return engine.run(setup, Resolution(duration / steps, duration, "soft"))


def with_timeout(name: str, engine: str, timeout: object):
    case = load_case(name)
    table = {**case.engine[engine], "timeout": timeout}
    return case.model_copy(update={"engine": {**case.engine, engine: table}})


@pytest.mark.parametrize("engine, folder, name, line", ENGINES)
def test_a_crash_is_an_error_with_the_last_words_and_the_next_run_is_made(
    engine, folder, name, line, tmp_path
):
    decks = deck_with(tmp_path, name, folder, line, f'print "the last words"\n{CRASH}')
    with pytest.raises(EngineError, match=r"the process has died \(signal SIGSEGV\) \(log: .*last words"):
        run(engine(decks), load_case(name))
    assert run(engine(), load_case(name)).provenance["complete"]


@pytest.mark.parametrize("engine, folder, name, line", ENGINES)
def test_a_hang_is_ended_after_the_time_that_the_case_allows(engine, folder, name, line, tmp_path):
    decks, made = deck_with(tmp_path, name, folder, line, HANG), engine()
    case = with_timeout(name, made.name, "1.5 s")
    begin = time.monotonic()
    with pytest.raises(EngineError, match=r"no answer within 1\.5 s; the process was ended"):
        run(engine(decks), case)
    assert time.monotonic() - begin < 60  # of the 1000 s that it would have taken
    assert run(made, load_case(name)).provenance["complete"]


@pytest.mark.parametrize("timeout", [0, -1, "3 m"])
def test_a_time_that_is_no_time_is_refused(timeout):
    with pytest.raises(CaseError, match=r"engine\.lammps\.timeout"):
        run(LammpsEngine(), with_timeout("pair_slip", "lammps", timeout))


def test_an_mpi_that_aborts_where_it_is_loaded_is_a_missing_engine(monkeypatch):
    """As without room for its shared memory; in this process it would be the end of it."""
    lammps._asked.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(lammps, "probe", os.abort)
        info = LammpsEngine().info()
    lammps._asked.cache_clear()
    assert not info.available
    assert info.reason.startswith("LAMMPS: the process has died (signal SIGABRT)")
    assert LammpsEngine().info().available == lammps_library.available()[0]


@needs_lammps
def test_what_an_engine_has_started_ends_with_it(tmp_path):
    mark = tmp_path / "pid"
    line = '\nif "${driver} != standalone'
    decks = deck_with(tmp_path, "pair_slip", "", line, f'shell "echo $$ > {mark}; sleep 1000"')
    for seconds in (1, 3, 20):  # until it has had the time to start
        with pytest.raises(EngineError, match="no answer"):
            run(LammpsEngine(decks), with_timeout("pair_slip", "lammps", f"{seconds} s"))
        if mark.exists():
            break
    for _ in range(100):
        if not _runs(int(mark.read_text())):
            return
        time.sleep(0.05)
    pytest.fail("the shell of the engine is still there")


def _runs(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@needs_lammps
def test_lost_particles_are_an_error(tmp_path):
    text = deck_path("pair_slip").read_text("utf-8")
    assert "boundary p p ${boundary_z}" in text
    (tmp_path / "in.open").write_text(text.replace("p p ${boundary_z}", "p p f"), "utf-8")
    case = load_case("pair_slip")
    away = replace(build_setup(case).state, velocity=np.array([[0.0, 0.0, 50.0]] * 2))
    with pytest.raises(EngineError, match=r"[Ll]ost atoms"):
        run(LammpsEngine({"pair_slip": tmp_path / "in.open"}), case, state=away)


def simulate_with_a_broken_fix(*asked):
    """Runs in the child: the plain fix, whose callback raises at its first step."""

    def broken(self, *_):
        raise ZeroDivisionError("seeded")

    driver = python_driver.PythonCallback
    whole, plain = driver._step, lammps_run.SlurryFix
    driver._step = broken
    lammps_run.SlurryFix = lambda *args, **settings: plain(*args, **settings, compiled=False)
    try:
        return lammps_run.simulate(*asked)
    finally:
        driver._step, lammps_run.SlurryFix = whole, plain


@needs_lammps
def test_an_exception_in_the_fix_is_an_error_and_the_next_run_is_made(monkeypatch):
    case = load_case("wall_bounce")
    with monkeypatch.context() as patch:
        patch.setattr(lammps, "simulate", simulate_with_a_broken_fix)
        with pytest.raises(EngineError, match=r"the fix failed: ZeroDivisionError.*seeded"):
            run(LammpsEngine(), case)
    assert len(run(LammpsEngine(), case).contacts) == 1


@needs_lammps
def test_the_rest_of_a_task_goes_on(tmp_path):
    """LAMMPS crashes in every form; the reference is judged, and so is LIGGGHTS where it is there."""
    decks = deck_with(tmp_path, "pair_stick", "", '\nif "${driver} != standalone', CRASH)
    others = ("lammps", "liggghts") if liggghts_library.available()[0] else ("lammps",)
    rows = run_task(Task(load_case("pair_stick"), 0, others, "quick", tmp_path / "data", decks)).comparisons
    (failed,) = (row for row in rows if row.status == "error")
    assert failed.engine == "lammps"
    assert "SIGSEGV" in failed.reason
    assert "shell" in failed.reason
    judged = {row.engine for row in rows if row.status in ("agree", "disagree")}
    assert judged == {"reference", *others} - {"lammps"}


def grandchild() -> int:
    """Runs in a child: starts a child of its own there, and tells its process."""
    return shared_child("inner").call(os.getpid, timeout=60)


def test_a_child_ends_when_its_parent_was_killed():
    outer = Child()
    inner = outer.call(grandchild, timeout=60)
    assert _runs(inner)
    outer.stop()  # by SIGKILL
    for _ in range(100):
        if not _runs(inner):
            return
        time.sleep(0.1)
    pytest.fail("the child of a killed process is still there")
