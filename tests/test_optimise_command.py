"""`cmpcheck optimise`: what it writes, what it refuses, and that a killed run goes on to the same bytes."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import design_example as example
import pytest
import report_example
from typer.testing import CliRunner

from cmpcheck.cli import app
from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.links import designs_beside
from cmpcheck.optimise.problem import evaluate_sample
from cmpcheck.optimise.run import Plan, run_design
from cmpcheck.optimise.store import Store
from cmpcheck.page import render
from cmpcheck.shell import progress_bars

ROOT = Path(__file__).parents[1]
TABLE_1 = ["V_pad", "N", "mean_diameter", "diameter_spread", "cost", "standard_error", "samples"]


def design(folder: Path, evaluate=example.quick, plan=Plan(), **settings):  # noqa: B008
    problem = example.problem(**settings)
    store = Store.create(folder, problem.case, True)
    store._sql.execute("PRAGMA synchronous = OFF")
    try:
        with example.Threads(2) as workers, progress_bars() as bars:
            return run_design(problem, store, workers, plan, bars, partial(Evaluator, evaluate=evaluate))
    finally:
        store.close()


def complaint(*arguments: object) -> str:
    result = CliRunner().invoke(app, ["optimise", *map(str, arguments)])
    assert result.exit_code == 2, result.output
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    return lines[0]


def test_the_folder_holds_table_1_both_figures_and_the_page(tmp_path):
    found = design(tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    figures = {f"figure_{n}.{form}" for n in (7, 8) for form in ("svg", "png")}
    assert names == figures | {
        "optimise.sqlite",
        "case.toml",
        "table.csv",
        "table.md",
        "strings.csv",
        "index.html",
    }
    rows = list(csv.DictReader((tmp_path / "table.csv").open()))
    assert list(rows[0]) == TABLE_1
    assert len(rows) == 10
    costs = [float(row["cost"]) for row in rows]
    assert costs == sorted(costs)
    assert costs[0] == found.ranked[0].cost
    assert all(float(row["N"]) == int(row["N"]) for row in rows)
    every = list(csv.DictReader((tmp_path / "strings.csv").open()))
    assert len(every) == len(found.ranked) == 20
    page = (tmp_path / "index.html").read_text("utf-8")
    assert "Fig. 7" in page
    assert "skewness" in page
    assert "Fig. 8" in page
    assert "src=" not in page  # self-contained
    assert "The paper concludes that V_pad, N and d̄ cluster" in page


def test_methods_and_front_are_added_on_request_and_leave_the_table_as_it_was(tmp_path):
    pytest.importorskip("pymoo")
    design(tmp_path / "alone")
    found = design(tmp_path / "more", plan=Plan(2, "removal_rate"))
    for name in ("table.csv", "table.md", "strings.csv", "figure_7.svg", "figure_8.svg"):
        assert (tmp_path / "alone" / name).read_bytes() == (tmp_path / "more" / name).read_bytes()
    assert len(found.trials) == 8
    page = (tmp_path / "more" / "index.html").read_text("utf-8")
    assert "Best is: " in page
    assert "Flatness against removal rate" in page
    assert {"methods.csv", "methods.svg", "front.csv", "front.svg"} <= {
        p.name for p in (tmp_path / "more").iterdir()
    }


def test_what_was_asked_for_beside_the_search_is_asked_for_again_when_it_goes_on(tmp_path):
    case = example.design_case()
    store = Store.create(tmp_path, case, False)
    assert Plan.kept(store, 0, "") == Plan()
    Plan.kept(store, 2, "")
    store.close()
    store = Store.resume(tmp_path, case)
    assert Plan.kept(store, 0, "abrasive_mass") == Plan(2, "abrasive_mass")
    assert Plan.kept(store, 3, "") == Plan(3, "abrasive_mass")
    store.close()


def test_the_report_links_the_designs_that_lie_beside_it(tmp_path):
    assert designs_beside(tmp_path / "latest") == []
    design(tmp_path / "optimise" / "mine & yours")
    (tmp_path / "optimise" / "unfinished").mkdir()
    links = designs_beside(tmp_path / "latest")
    page = render(report_example.example(), links)
    assert 'href="../optimise/mine%20%26%20yours/index.html">mine &amp; yours</a>' in page
    assert "unfinished" not in page
    assert "Designing the process" not in render(report_example.example())


def test_a_design_of_which_nothing_can_be_run_says_so(tmp_path):
    def full(problem, string, k):
        nan = float("nan")
        return example.Sample(nan, nan, nan, nan, 0.0, "no room <at all>")

    design(tmp_path, full)
    assert "No string can be run: no room &lt;at all&gt;." in (tmp_path / "index.html").read_text("utf-8")


def test_impossible_strings_are_listed_with_their_reason(tmp_path):
    design(tmp_path, example.crowded)
    assert "Strings that cannot be run" in (tmp_path / "index.html").read_text("utf-8")
    every = list(csv.DictReader((tmp_path / "strings.csv").open()))
    assert {row["cost"] for row in every if row["reason"]} == {"inf"}


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["polish"], "polish.toml: optimise: required"),
        (["polish_design", "--resume"], "holds no optimisation to go on with"),
        (["polish_design", "--resume", "--force"], "allowed: one of them"),
        (["polish_design", "--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"], "allowed: one of them"),
    ],
)
def test_bad_options_are_one_line(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert words in complaint(*arguments)
    assert not list(tmp_path.iterdir())


def test_an_unreachable_scheduler_is_one_line(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("cmpcheck.optimise.workers.CONNECT_SECONDS", 1.0)
    line = complaint("polish_design", "--scheduler", "tcp://127.0.0.1:1", "--out", tmp_path / "out")
    assert "no scheduler answers in 1 s" in line
    assert not (tmp_path / "out").exists()


def test_without_pymoo_it_says_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    line = complaint("polish_design", "--compare-methods", "--out", tmp_path / "out")
    assert 'pip install "cmpcheck[optimise]"' in line


def command(case: Path, folder: Path, *more: str) -> subprocess.Popen:
    arguments = ["optimise", str(case), "--out", str(folder), *more]
    return subprocess.Popen(
        [sys.executable, "-m", "cmpcheck", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # background jobs ignore it
    )


def wait_for(process: subprocess.Popen, words: str) -> None:
    assert process.stderr is not None
    for line in process.stderr:
        if words in line:
            return
    raise AssertionError(f"ended without {words!r}")


@pytest.mark.slow
def test_interrupted_and_killed_it_goes_on_to_the_same_bytes(tmp_path):
    settings = {"distribution_samples": 5, "generations": 6}  # it must not end before the signal comes
    case = tmp_path / "mine.toml"
    example.design_case(**settings).save(case)
    first = command(case, tmp_path / "cut", "--jobs", "1")
    wait_for(first, "generation 2/6")
    first.send_signal(signal.SIGINT)
    out, err = first.communicate(timeout=60)
    assert first.returncode == 130, err
    assert err.splitlines()[-1].startswith(f"cmpcheck: interrupted: {tmp_path / 'cut'} keeps ")
    assert err.splitlines()[-1].endswith(f"cmpcheck optimise {case} --out {tmp_path / 'cut'} --resume")
    second = command(case, tmp_path / "cut", "--resume", "--jobs", "1")
    wait_for(second, "generation 3/6")
    second.kill()
    second.communicate()
    third = command(case, tmp_path / "cut", "--resume", "--jobs", "2")
    out, err = third.communicate(timeout=120)
    assert third.returncode == 0, err
    assert "page: " in out
    design(tmp_path / "straight", evaluate_sample, **settings)
    for name in ("table.csv", "strings.csv", "table.md", "figure_7.svg", "figure_8.svg"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "straight" / name).read_bytes(), name
