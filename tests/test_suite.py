"""From cases to results: who judges a case, what a task does for it, and what becomes of failures.

The numbers in the rows are the business of `test_compare.py` and `test_judges.py`.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import pytest

from cmpcheck import suite, variant_task
from cmpcheck.compare import compare_study
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.judges import judge_of
from cmpcheck.judges.drag import DragJudge
from cmpcheck.judges.pair import PairJudge
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.judges.train import TrainJudge
from cmpcheck.judges.wall import WallJudge
from cmpcheck.published.run import BenchmarkTask
from cmpcheck.results import Comparison, EngineInfo, Outcome
from cmpcheck.study import align_outputs, reference_study
from cmpcheck.suite import run_suite
from cmpcheck.suite_parts import ComponentTask
from cmpcheck.variant_task import Task, run_task
from reference.case import CASES, CaseError, load_case
from reference.process import build_setup
from reference.recording import Run

QUICK = ("steps_per_contact = 50", "steps_per_contact = 4")  # the fakes' contacts need not be resolved


def case_file(folder: Path, name: str, *changes: tuple[str, str]) -> Path:
    """A copy of a shipped case with texts replaced."""
    text = (CASES / f"{name}.toml").read_text("utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"mine{len(list(folder.iterdir()))}.toml"
    path.write_text(text, "utf-8")
    return path


# Who judges a case

JUDGES = {
    "asperity_bounce": WallJudge,
    "bounce_train": TrainJudge,
    "couette_drift": DragJudge,
    "drag_regimes": DragJudge,
    "drag_relaxation": DragJudge,
    "pair_head_on": PairJudge,
    "pair_slip": PairJudge,
    "pair_stick": PairJudge,
    "swarm": SwarmJudge,
    "wall_bounce": WallJudge,
    "wall_oblique": WallJudge,
}
FLUID = '[fluid]\ndensity = 1000\nviscosity = 1e-3\nflow = "uniform"\nvelocity = [0, 0, 0]\n\n[contact]'
SHORT = ('duration = "50 ns"', 'duration = "10 ns"')


@pytest.mark.parametrize("name", JUDGES)
def test_a_case_is_judged_by_its_structure(name):
    for variant in load_case(name).variants():
        assert type(judge_of(build_setup(variant))) is JUDGES[name]


def test_a_case_that_nobody_can_judge_is_refused_in_one_line(tmp_path):
    case = load_case(case_file(tmp_path, "swarm", ("[contact]", FLUID)))
    with pytest.raises(CaseError, match="swarm: no comparison is known for this kind of case; allowed: "):
        judge_of(build_setup(case))


@pytest.mark.parametrize(
    "name, change",
    [
        ("pair_slip", SHORT),
        ("bounce_train", ("velocity = [0, 0, -0.5]  # m/s\n\n", "velocity = [0, 0, 0.5]  # m/s\n\n")),
    ],
)
def test_spheres_that_meet_nothing_are_refused_in_one_line(name, change, tmp_path):
    with pytest.raises(CaseError):
        judge_of(build_setup(load_case(case_file(tmp_path, name, change))))


def test_a_sphere_that_does_not_reach_the_wall_is_judged_by_its_flight(tmp_path):
    case = load_case(case_file(tmp_path, "wall_bounce", ('duration = "80 ns"', 'duration = "10 ns"')))
    setup = align_outputs(build_setup(case.variants()[0]))
    study = reference_study(ReferenceEngine(), judge_of(setup), setup, "quick")
    assert {row.status for row in compare_study(setup.case, study, None)} == {"agree"}


# Tasks


FORMS = ("soft", "impulse", "native")


class Fake:
    """The reference as the engine "lammps"; `failure` is raised in the contact forms named."""

    name = "lammps"
    surface_forms: tuple[str, ...] = ("soft", "impulse")

    def __init__(
        self, failure: Exception | None = None, forms: tuple[str, ...] = ("soft", "impulse", "native")
    ):
        self.failure, self.forms = failure, forms

    def info(self) -> EngineInfo:
        return EngineInfo(self.name, "0", True)

    def run(self, setup, resolution) -> Run:
        if self.failure is not None and resolution.form in self.forms:
            raise self.failure
        return ReferenceEngine().run(setup, resolution)


@pytest.fixture
def use(monkeypatch):
    """Put engines in the places of the reference and LAMMPS."""

    def put(lammps, reference=None) -> None:
        engines = {"reference": reference or ReferenceEngine(), "lammps": lammps}
        monkeypatch.setattr(suite, "engine_names", lambda: tuple(engines))
        for module in (suite, variant_task):
            monkeypatch.setattr(module, "make_engine", lambda name, decks=None: engines[name])

    return put


def in_this_process(tasks: list[Task], jobs: int) -> Iterator[tuple[Task, Outcome]]:
    return ((task, run_task(task)) for task in tasks)


def task_of(case: str | Path, folder: Path, engines: tuple[str, ...] = ("lammps",)) -> Task:
    return Task(load_case(case), 0, engines, "quick", folder, {})


def statuses(rows: list[Comparison], engine: str) -> set[str]:
    return {row.status for row in rows if row.engine == engine}


def test_a_task_compares_every_engine_and_keeps_the_finest_runs(use, tmp_path):
    use(Fake())
    path = case_file(tmp_path, "wall_bounce", QUICK)
    outcome = run_task(task_of(path, tmp_path / "data"))
    assert statuses(outcome.comparisons, "reference") == statuses(outcome.comparisons, "lammps") == {"agree"}
    kept = tmp_path / "data" / "wall_bounce" / "pickup"
    assert sorted(folder.name for folder in kept.iterdir()) == ["lammps-impulse", "lammps-soft", "reference"]
    assert all(Run.load(folder).provenance["complete"] for folder in kept.iterdir())
    assert {trace.engine for trace in outcome.traces} == {"exact", "reference", "lammps"}
    assert {record.engine for record in outcome.convergences} == {"reference", "lammps"}


def test_an_engine_that_fails_becomes_an_error_row_for_each_form_of_contact(use, tmp_path):
    use(Fake(RuntimeError("no such thing")))
    rows = run_task(task_of(case_file(tmp_path, "wall_bounce", QUICK), tmp_path / "data")).comparisons
    failed = [row for row in rows if row.engine == "lammps"]
    assert [(row.status, row.reason) for row in failed] == [
        ("error", "soft: no such thing"),
        ("error", "impulse: no such thing"),
    ]
    assert statuses(rows, "reference") == {"agree"}


def test_a_form_that_fails_leaves_the_other_alone(use, tmp_path):
    use(Fake(RuntimeError("no such thing"), ("soft",)))
    rows = run_task(task_of(case_file(tmp_path, "wall_bounce", QUICK), tmp_path / "data")).comparisons
    assert [row.quantity for row in rows if row.status == "error"] == ["run"]
    assert {row.status for row in rows if row.engine == "lammps" and "impulse" in row.variant} == {"agree"}


@pytest.mark.parametrize("failure", [ValueError("no such thing"), KeyError("no such thing")])
def test_whatever_an_engine_raises_becomes_an_error_row(failure, use, tmp_path):
    use(Fake(failure))
    rows = run_task(task_of("drag_relaxation", tmp_path)).comparisons
    assert statuses(rows, "lammps") == {"error"}


def test_a_reference_that_fails_leaves_nothing_to_compare_with(use, tmp_path):
    use(Fake(), reference=Fake(RuntimeError("not finite")))
    rows = run_task(task_of("drag_relaxation", tmp_path)).comparisons
    assert [(row.engine, row.status, row.reason) for row in rows] == [("reference", "error", "not finite")]


def test_an_engine_without_settings_in_the_case_is_not_tested(use, tmp_path):
    use(Fake(RuntimeError("must not be run")))
    text = (CASES / "drag_relaxation.toml").read_text("utf-8")
    path = case_file(tmp_path, "drag_relaxation", (text[text.index("[engine.lammps]") :], ""))
    task, missing = (
        task_of(path, tmp_path / "data"),
        "[engine.lammps] with contact_duration and steps_per_contact",
    )
    asked = run_task(replace(task, asked=True)).comparisons
    (row,) = (row for row in asked if row.engine == "lammps")
    assert row.status == "not_tested"
    assert missing in row.reason
    found = run_task(task)  # the engine is just there: no row, but it is said
    assert all(row.engine == "reference" for row in found.comparisons)
    assert any(missing in note for note in found.notes)
    assert statuses(asked, "reference") == {"agree"}


# The suite


@pytest.mark.parametrize(
    "name, change, complaint",
    [
        ("swarm", ("[contact]", FLUID), "no comparison is known"),
        ("drag_relaxation", ("steps_per_contact = 50", "steps_per_contact = 0"), "allowed: > 0"),
    ],
)
def test_bad_cases_are_refused_before_anything_is_run(name, change, complaint, use, tmp_path, monkeypatch):
    use(Fake())
    monkeypatch.setattr(suite, "_in_processes", lambda tasks, jobs: pytest.fail("something was run"))
    path = str(case_file(tmp_path, name, change))
    with pytest.raises(CaseError, match=complaint):
        run_suite(["couette_drift", path], None, "quick", tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()


def test_results_come_in_the_order_asked_for_whatever_is_ready_first(use, tmp_path, monkeypatch):
    use(Fake())
    monkeypatch.setattr(suite, "_in_processes", lambda tasks, jobs: in_this_process(tasks[::-1], jobs))
    told = []
    names = ["pair_head_on", "drag_relaxation"]
    result = run_suite(names, [], "quick", tmp_path, 1, progress=lambda *step: told.append(step))
    assert [case.name for case in result.cases] == names
    variants = [row.variant.split(",")[0] for row in result.cases[0].comparisons]
    assert list(dict.fromkeys(variants)) == ["e0.2", "e0.5", "e0.8", "e1"]
    assert told == [("drag_relaxation", 1, 1), *(("pair_head_on", k, 4) for k in (1, 2, 3, 4))]
    assert [engine.name for engine in result.engines] == ["reference"]
    assert result.cases[1].equations == "20-22, 37-39"


def test_two_cases_of_one_name_are_refused(use, tmp_path, monkeypatch):
    use(Fake())
    monkeypatch.setattr(suite, "_in_processes", in_this_process)
    faster = ("velocity = [0.5, 0.2, 0.1]", "velocity = [0.6, 0.2, 0.1]")
    with pytest.raises(CaseError):
        run_suite(
            ["drag_relaxation", str(case_file(tmp_path, "drag_relaxation", faster))], [], "quick", tmp_path, 1
        )


def test_the_rows_do_not_depend_on_how_many_processes_there_are(tmp_path, monkeypatch):
    names = ["drag_relaxation", "couette_drift", "pair_stick"]
    two = run_suite(names, [], "quick", tmp_path / "two", 2)
    monkeypatch.setattr(suite, "_in_processes", in_this_process)
    one = run_suite(names, [], "quick", tmp_path / "one", 1)
    assert len(one.comparisons) > 30
    assert [repr(row) for row in one.comparisons] == [repr(row) for row in two.comparisons]


class Fatal(tuple):
    """Engines at the mention of which a worker dies without a word, as compiled code may."""

    def __iter__(self):
        if multiprocessing.parent_process() is not None:
            os._exit(1)
        return super().__iter__()


def test_a_worker_that_dies_takes_only_its_own_task_with_it(tmp_path):
    """The longest task is the first to be run, so that the other one is waiting when the worker dies."""
    long, short = (task_of(name, tmp_path, ()) for name in ("couette_drift", "drag_relaxation"))
    deadly = replace(long, engines=Fatal(["lammps"]))
    assert deadly.cost > short.cost
    outcomes = {task.case.name: outcome for task, outcome in suite._in_processes([short, deadly], 1)}
    (row,) = outcomes["couette_drift"].comparisons
    assert (row.case, row.status, row.reason) == ("couette_drift", "error", "the process that ran it died")
    assert len(outcomes["drag_relaxation"].comparisons) > 1
    assert statuses(outcomes["drag_relaxation"].comparisons, "reference") == {"agree"}


def test_a_benchmark_or_the_components_whose_worker_dies_are_an_error_of_each_engine(tmp_path):
    future: Future = Future()
    future.set_exception(BrokenProcessPool())
    benchmark = BenchmarkTask("kharaz", ("lammps", "liggghts"), "quick", tmp_path)
    tasks = benchmark, ComponentTask(("reference",), "quick")
    for task, engines in zip(tasks, (["lammps", "liggghts"], ["reference"]), strict=True):
        found = suite._found(task, future)
        assert found.lost
        assert found.name == task.name
        assert [row.engine for row in found.comparisons] == engines
        assert {row.status for row in found.comparisons} == {"error"}
        assert all("the process that ran it died" in row.reason for row in found.comparisons)


def test_the_longest_tasks_are_those_of_the_finest_meshes_in_liggghts(tmp_path):
    """A step in LIGGGHTS visits every triangle, one elsewhere a few particles."""
    wall, pair = (task_of(name, tmp_path, ("lammps", "liggghts")) for name in ("wall_oblique", "pair_stick"))
    assert wall.cost > 10.0 * pair.cost
    assert replace(wall, engines=("lammps",)).cost < 0.1 * wall.cost
