"""Engines that fail: every fault becomes `error` with a reason, in time, and everything else is judged.

`python -m benchmarks.reliability_engines [--full]` prints the findings.  The faults are commands at the end
of a deck's definitions, a box that lets particles out, a fix whose callback raises, and a package whose
engine does as badly.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np

from benchmarks.reliability_finding import Finding
from cmpcheck.engines import GROUP, lammps, lammps_run, make_engine
from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import deck_path
from cmpcheck.engines.liggghts import LiggghtsEngine
from cmpcheck.engines.plugin import PluginEngine
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.python_driver import PythonCallback
from cmpcheck.pool import problem_of, run_tasks
from cmpcheck.study import contact_settings
from cmpcheck.variant_task import Task, run_task
from reference.case import Case, load_case
from reference.process import build_setup

CASE, FIX_CASE = "pair_slip", "wall_bounce"
TIMEOUT, PATIENCE = 5.0, 120.0  # s, for a run that hangs, and for others
DRIVER = {"lammps": '\nif "${driver} != standalone', "liggghts": '\nif "${driver} != 0'}
WORDS = "the last words before the fault"
LATE = f"no answer within {TIMEOUT:g} s"


@dataclass(frozen=True)
class Fault:
    """What is done to a deck, and what must be said of it."""

    done: str
    command: str
    said: tuple[str, ...]


FAULTS = {
    "crash": Fault("A segmentation fault.", 'shell "kill -SEGV $PPID"', ("has died (signal SIGSEGV)", WORDS)),
    "killed": Fault("SIGKILL, as from the system.", 'shell "kill -KILL $PPID"', ("(signal SIGKILL)", WORDS)),
    "hang": Fault(f"No end; timeout = {TIMEOUT:g} s.", "shell sleep 1000", (LATE, WORDS)),
    "error": Fault("A command that there is not.", "nonsense", ("nonsense",)),
}


def findings(full: bool = False) -> list[Finding]:
    """Every fault in every engine that is there; without `full`, LAMMPS alone in one process."""
    found = _plugins() if full else []
    for kind in (LammpsEngine, LiggghtsEngine) if full else (LammpsEngine,):
        if not kind().info().available:
            continue
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
            for name, fault in FAULTS.items():
                found.append(_fault(kind, name, fault, Path(place)))
            found.append(_lost(kind, Path(place)))
    if LammpsEngine().info().available:
        found.append(_broken_fix())
        found += [_others_go_on(), *_killed_worker()] if full else []
    return found


def _fault(kind: Callable, name: str, fault: Fault, folder: Path) -> Finding:
    engine = kind()
    text = deck_path(CASE, "" if engine.name == "lammps" else engine.name).read_text("utf-8")
    line = DRIVER[engine.name]
    path = folder / f"in.{name}"
    path.write_text(text.replace(line, f'\nprint "{WORDS}"\n{fault.command}{line}'), "utf-8")
    case = load_case(CASE)
    table = {**case.engine[engine.name], "timeout": TIMEOUT if LATE in fault.said else PATIENCE}
    case = case.model_copy(update={"engine": {**case.engine, engine.name: table}})
    return _tried(f"{engine.name}, {name}", fault.done, lambda: _run(kind({CASE: path}), case), fault.said)


def _lost(kind: Callable, folder: Path) -> Finding:
    """Particles that leave the box."""
    engine = kind()
    text = deck_path(CASE, "" if engine.name == "lammps" else engine.name).read_text("utf-8")
    path = folder / "in.open"
    path.write_text(text.replace("p p ${boundary_z}", "p p f"), "utf-8")
    case = load_case(CASE)
    away = np.array([[0.0, 0.0, 50.0]] * 2)
    done, said = "Two particles leave through an open boundary at 50 m/s.", ("ost",)
    return _tried(f"{engine.name}, lost particles", done, lambda: _run(kind({CASE: path}), case, away), said)


PLUGIN = f"""
import os, signal, time
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.results import EngineInfo

class Faulty(ReferenceEngine):
    name = "faulty"
    def info(self): return EngineInfo("faulty", "1", True)
    def run(self, setup, resolution):
        print("{WORDS}", flush=True)
        return FAULTS[setup.case.case.title](setup, resolution)

def die(number): os.kill(os.getpid(), number)

FAULTS = {{"crash": lambda *_: die(signal.SIGSEGV), "killed": lambda *_: die(signal.SIGKILL),
          "hang": lambda *_: time.sleep(1000), "error": lambda *_: nonsense, "sound": ReferenceEngine().run}}
"""


def _plugins() -> list[Finding]:
    """The same faults in an engine of another package; then a sound run of it."""
    case, found = load_case(CASE), []
    table = {"contact_duration": 1e-9, "steps_per_contact": 20.0}

    def run(what: str) -> object:
        tables = case.engine | {"faulty": table | {"timeout": TIMEOUT if what == "hang" else PATIENCE}}
        header = case.case.model_copy(update={"title": what})
        setup = build_setup(case.model_copy(update={"case": header, "engine": tables}).variants()[0])
        return engine.run(setup, Resolution(setup.time_step))

    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
        (Path(place) / "faulty_engine.py").write_text(PLUGIN, "utf-8")
        sys.path.insert(0, place)
        try:
            engine = PluginEngine(EntryPoint("faulty", "faulty_engine:Faulty", GROUP))
            for name, fault in FAULTS.items():
                said = fault.said if name != "error" else ("NameError", "nonsense")
                done = fault.done if name != "error" else "A name that there is not."
                found.append(
                    _tried(f"another package, {name}", done, partial(run, name), said, partial(run, "sound"))
                )
        finally:
            sys.path.remove(place)
    return found


def _run(engine, case: Case, velocity: np.ndarray | None = None) -> object:  # type: ignore[no-untyped-def]
    setup = build_setup(case.variants()[0])
    if velocity is not None:
        setup = replace(setup, state=replace(setup.state, velocity=velocity))
    duration, steps = contact_settings(setup.case, engine.name)
    return engine.run(setup, Resolution(duration / steps, duration, "soft"))


def _tried(
    name: str,
    done: str,
    run: Callable[[], object],
    said: tuple[str, ...],
    sound: Callable[[], object] | None = None,
) -> Finding:
    """The error that must come, in one line; then a sound run in the same process."""
    begin = time.perf_counter()
    try:
        run()
        outcome, holds = "nothing was noticed", False
    except EngineError as problem:
        outcome = str(problem)
        holds = "\n" not in outcome and all(part in outcome for part in said)
    seconds = time.perf_counter() - begin
    if sound is None:
        _run(make_engine(name.partition(",")[0]), load_case(CASE))
    else:
        sound()
    told = outcome.partition(": ")[2] or outcome
    return Finding(name, done, _short(told), holds and seconds < PATIENCE, {"s until the error": seconds})


def _short(text: str) -> str:
    """Without the places of files."""
    words = [Path(word.rstrip(":")).name if word.startswith("/") else word for word in text.split()]
    return " ".join(words)[:300]


def simulate_with_a_broken_fix(*asked):  # type: ignore[no-untyped-def]
    """Runs in the child: the plain fix, whose callback raises at its first step."""

    def broken(self: PythonCallback, *_: object) -> None:
        raise ZeroDivisionError("seeded")

    whole, plain = PythonCallback._step, lammps_run.SlurryFix
    PythonCallback._step = broken  # type: ignore[method-assign]
    lammps_run.SlurryFix = lambda *args, **settings: plain(*args, **settings, compiled=False)  # type: ignore
    try:
        return lammps_run.simulate(*asked)
    finally:
        PythonCallback._step, lammps_run.SlurryFix = whole, plain  # type: ignore


def _broken_fix() -> Finding:
    from benchmarks import reliability_engines as importable  # also when this is the main module

    def run() -> object:
        sound = lammps.simulate
        lammps.simulate = importable.simulate_with_a_broken_fix
        try:
            return _run(LammpsEngine(), load_case(FIX_CASE))
        finally:
            lammps.simulate = sound

    done, said = "The callback raises at its first step.", ("the fix failed: ZeroDivisionError", "seeded")
    return _tried("lammps, exception in the fix", done, run, said)


def _others_go_on() -> Finding:
    """A task whose LAMMPS crashes: the reference and LIGGGHTS are judged."""
    others = tuple(name for name in ("lammps", "liggghts") if make_engine(name).info().available)
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
        path, line = Path(place) / "in.crash", DRIVER["lammps"]
        text = deck_path(CASE).read_text("utf-8").replace(line, f"\n{FAULTS['crash'].command}{line}")
        path.write_text(text, "utf-8")
        task = Task(load_case(CASE), 0, others, "quick", Path(place) / "data", {CASE: path})
        rows = run_task(task).comparisons
    errors = {row.engine for row in rows if row.status == "error"}
    judged = {row.engine for row in rows if row.status in ("agree", "disagree")}
    holds = errors == {"lammps"} and judged == {"reference", *others} - {"lammps"}
    outcome = f"error: {', '.join(sorted(errors))}; judged: {', '.join(sorted(judged))}"
    done, numbers = "One variant whose LAMMPS crashes.", {"rows": float(len(rows))}
    return Finding("the other engines", done, outcome, holds, numbers)


def work(task: tuple[str, str]) -> str:
    """A task that is killed: "once", "always" or never."""
    how, mark = task
    if how == "always" or (how == "once" and not Path(mark).exists()):
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def _killed_worker() -> list[Finding]:
    """A worker killed from outside: its task is done again, and one that is killed again is an error."""
    from benchmarks import reliability_engines as importable

    found = []
    for how, expected in (("once", ""), ("always", "the process that ran it died")):
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
            tasks = [(how, f"{place}/mark"), *(("never", "") for _ in range(3))]
            said = {task[0]: problem_of(future) for task, future in run_tasks(importable.work, tasks, 2)}
        holds = said == {how: expected, "never": ""}
        outcome = f"its task: {said.get(how) or 'done'}; the others: {said.get('never') or 'done'}"
        done = "SIGKILL while it does one of four tasks."
        found.append(Finding(f"a worker, killed {how}", done, outcome, holds))
    return found


if __name__ == "__main__":
    for finding in findings("--full" in sys.argv):
        print(finding.line(), flush=True)
