"""Laws of a comparison that was interrupted or killed: what is finished is not done again, what comes out is
what would have come out, and a file is whole or not there."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_example import example
from test_cli import call, complaint

from cmpcheck import outputs, suite
from cmpcheck.finished import Finished
from cmpcheck.outputs import OutputError
from cmpcheck.records import RECORDS, from_json, settled, to_json
from cmpcheck.report import report_json
from cmpcheck.results import Chart, Column, Comparison, Curve, Estimate, Outcome, StudyResult, Table
from cmpcheck.variant_task import run_task

CASES = ("pair_stick", "couette_drift", "drag_relaxation")
COMPARE = ("compare", *CASES, "--engine", "reference", "--jobs", 1, "--out", "report")
NAN = float("nan")
ROW = Comparison(
    "c",
    "v",
    "lammps",
    "load",
    "30",
    "N",
    np.float64(0.1),
    1e-300,
    math.inf,
    NAN,
    "rounding",
    "é <b>",
    "error",
)


def without_times(value: object) -> object:
    """A report without the wall-clock times in it."""
    if isinstance(value, dict):
        return {key: without_times(inner) for key, inner in value.items() if key != "seconds"}
    if isinstance(value, list):
        return [without_times(inner) for inner in value]
    return value


def report(folder: str) -> object:
    return without_times(json.loads(Path(folder, "report.json").read_text("utf-8")))


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


# Records


def test_records_come_back_with_the_same_types_and_bits():
    found = Outcome([ROW], notes=["a", "b"], seconds=0.1)
    table = Table("t", (Column("x", "m"),), (("text", 1, 2.0, Estimate(1.0, 0.1)),))
    chart = Chart("c", Column("x"), Column("y"), (Curve("k", (0.0, NAN), (1.0, -0.0)),))
    study = StudyResult("s", "", "", "", (table,), "", (chart,))
    assert repr(settled(found)) == repr(Outcome([replace(ROW, reference=0.1)], notes=["a", "b"], seconds=0.1))
    assert repr(settled(study)) == repr(study)
    assert repr(settled([found, study])) == repr((settled(found), study))


def test_a_whole_report_survives_being_kept():
    found = example()
    kept = replace(found, cases=[settled(case) for case in found.cases])
    assert report_json(kept) == report_json(found)
    assert repr(settled(kept.cases)) == repr(tuple(kept.cases))


def test_nothing_but_a_record_is_read_or_written():
    assert {"Comparison", "Outcome", "LedgerMatch", "Estimate"} <= set(RECORDS)
    with pytest.raises(TypeError, match="Path is no part of a result"):
        to_json(Path())
    for text in ('{"$": "Path"}', '{"$": "Column", "nonsense": 1}', '{"name": 1}', "{"):
        with pytest.raises((KeyError, TypeError, ValueError)):
            from_json(text)


# What is kept


def test_what_cannot_be_read_counts_as_not_there(tmp_path):
    kept = Finished.begin(tmp_path, {"profile": "quick"})
    kept.put("tasks", "a/b", [ROW])
    (file,) = (tmp_path / outputs.FINISHED).glob("*/*.json")
    whole = file.read_text("utf-8")
    assert kept.get("tasks", "a/b")[0].case == "c"
    assert kept.get("tasks", "a/B") is None  # another name
    for damage in (whole[:-20], "", "[]]", '[{"$": "Comparison"}]'):
        file.write_text(damage, "utf-8")
        assert kept.get("tasks", "a/b") is None


def test_another_comparison_is_not_gone_on_with(tmp_path):
    Finished.begin(tmp_path, {"profile": "quick"})
    with pytest.raises(OutputError, match=r"other profile: was 'quick', is 'full'; allowed: "):
        Finished.go_on(tmp_path, {"profile": "full"})
    with pytest.raises(OutputError, match="holds no comparison"):
        Finished.go_on(tmp_path / "elsewhere", {})


# The command


def in_here(tasks, jobs):
    """Tasks in this process, which has everything loaded."""
    return ((task, run_task(task)) for task in tasks)


@pytest.fixture(autouse=True)
def _in_this_process(monkeypatch):
    monkeypatch.setattr(suite, "_in_processes", in_here)


def stop_after(monkeypatch, finished: int, how: BaseException) -> None:
    """End the command when so many tasks have been finished."""

    def some(tasks, jobs):
        for k, task in enumerate(tasks):
            if k == finished:
                raise how
            yield task, run_task(task)

    monkeypatch.setattr(suite, "_in_processes", some)


def test_an_interrupted_comparison_goes_on_to_the_same_report_without_doing_anything_again(here, monkeypatch):
    assert call(*COMPARE[:-1], "whole").exit_code == 0
    with monkeypatch.context() as patch:
        stop_after(patch, 2, KeyboardInterrupt())
        stopped = call(*COMPARE)
    assert stopped.exit_code == 130
    assert "--resume" in stopped.stderr
    assert not Path("report/report.json").exists()
    assert "holds an unfinished comparison; --resume goes on" in complaint(*COMPARE)
    assert "profile: was 'quick', is 'full'" in complaint(*COMPARE, "--resume", "--profile", "full")
    again = []
    with monkeypatch.context() as patch:
        patch.setattr(suite, "_in_processes", lambda tasks, jobs: again.extend(tasks) or in_here(tasks, jobs))
        assert call(*COMPARE, "--resume").exit_code == 0
    assert len(again) == 1
    assert report("report") == report("whole")
    for name in ("report.md", "index.html", "junit.xml"):
        one, other = (Path(folder, name).read_text("utf-8") for folder in ("report", "whole"))
        assert len(one.splitlines()) == len(other.splitlines())
    assert sorted(os.listdir("report")) == sorted(outputs.REPORT_ENTRIES)
    runs = [sorted(str(p.relative_to(f)) for p in Path(f, "data").rglob("*")) for f in ("report", "whole")]
    assert runs[0] == runs[1]
    assert "holds a complete report" in complaint(*COMPARE, "--resume")


def test_what_was_found_before_an_error_is_kept(here, monkeypatch):
    with monkeypatch.context() as patch:
        stop_after(patch, 1, OSError(28, "No space left on device", "report/.unfinished/x"))
        stopped = call(*COMPARE)
    assert stopped.exit_code == 1
    (line,) = stopped.stderr.splitlines()
    assert line.startswith("cmpcheck: report/.unfinished/x: No space left on device; report is as it was; ")
    assert line.endswith("--resume")
    assert call(*COMPARE, "--resume").exit_code == 0


def test_resume_without_anything_to_go_on_with_starts(here):
    assert (
        call("compare", "drag_relaxation", "--engine", "reference", "--out", "new", "--resume").exit_code == 0
    )


@pytest.mark.parametrize("moved", range(len(outputs.REPORT_ENTRIES) + 1))
def test_a_publication_that_was_killed_is_ended_by_the_next_one(moved, tmp_path, monkeypatch):
    """Killed after so many of its files were moved: whatever was moved stays, the rest follows."""
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "old").touch()
    (tmp_path / "report.json").write_text('{"schema": "cmpcheck-report/1"}', "utf-8")
    staging = outputs.stage_report(tmp_path, force=False)
    for name in outputs.REPORT_ENTRIES:
        (staging / name).mkdir() if name == "data" else (staging / name).write_text("new", "utf-8")
    (staging / "data" / "new").touch()
    real, count = os.replace, []

    def killed(source, target):
        if len(count) == moved:
            raise KeyboardInterrupt
        count.append(source)
        real(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", killed)
        with pytest.raises(KeyboardInterrupt):
            outputs.publish_report(staging, tmp_path)
    staging = outputs.stage_report(tmp_path, force=False, resume=True)
    outputs.publish_report(staging, tmp_path)
    assert sorted(os.listdir(tmp_path)) == sorted(outputs.REPORT_ENTRIES)
    assert os.listdir(tmp_path / "data") == ["new"]
    assert (tmp_path / "report.json").read_text("utf-8") == "new"


def test_workers_end_when_the_process_that_leads_them_is_killed(tmp_path):
    command = [sys.executable, "-m", "cmpcheck", "compare", "swarm", "wall_oblique"]
    command += ["--engine", "reference", "--jobs", "2", "--out", str(tmp_path / "report")]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    workers: list[int] = []
    try:
        for _ in range(600):
            workers = children_of(process.pid)
            if len(workers) >= 3:  # two workers and the tracker of resources
                break
            time.sleep(0.05)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert len(workers) >= 3
    for _ in range(200):
        if not any(Path(f"/proc/{worker}/task").exists() and not _zombie(worker) for worker in workers):
            return
        time.sleep(0.05)
    pytest.fail(f"still there: {workers}")


def children_of(process: int) -> list[int]:
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            if int(stat.read_text().rsplit(")", 1)[1].split()[1]) == process:
                found.append(int(stat.parent.name))
        except (OSError, ValueError):
            continue
    return found


def _zombie(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True
