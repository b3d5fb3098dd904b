"""Laws of `cmpcheck rerun`: it repeats what a report was asked for, and says what changed, row by row."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path

import pytest
from report_example import example
from test_cli import call, complaint

from cmpcheck import suite
from cmpcheck.report import report_json
from cmpcheck.rerun import ROUND_OFF, compare_reports
from cmpcheck.rerun_words import changes_json, changes_markdown, sentences
from cmpcheck.variant_task import run_task
from reference.case import CASES

OWN = '{"schema": "cmpcheck-report/1", "provenance": {"request": {"cases": ["x"], "own_cases": ["x"]}}}'


@pytest.fixture(scope="module")
def document() -> dict:
    return json.loads(report_json(example()))


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty working directory; tasks run in this process, which has everything loaded."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(suite, "_in_processes", lambda tasks, jobs: ((t, run_task(t)) for t in tasks))
    return tmp_path


def change_of(document: dict, wanted: str = "agree", kind: str = "discretisation", **changes: object) -> str:
    """What is said of the first row of that verdict and kind when it has other numbers."""
    after = deepcopy(document)
    row = next(
        r for r in after["comparisons"] if (r["status"], r["kind"]) == (wanted, kind) and r["measured"]
    )
    k = after["comparisons"].index(row)
    row |= {key: value(row) if callable(value) else value for key, value in changes.items()}
    found = compare_reports(document, after)
    assert [r.change for n, r in enumerate(found.rows) if n != k] == ["identical"] * (len(found.rows) - 1)
    return found.rows[k].change


def test_a_report_is_identical_with_itself(document):
    found = compare_reports(document, deepcopy(document))
    assert {row.change for row in found.rows} == {"identical"}
    assert not found.any
    assert found.origins == ()


@pytest.mark.parametrize(
    "factor, change",
    [(1.0, "identical"), (1.0 + 0.9 * ROUND_OFF, "round-off"), (1.0 + 2.0 * ROUND_OFF, "value")],
)
def test_a_value_that_moves_by_more_than_rounding_is_told(document, factor, change):
    assert change_of(document, measured=lambda row: row["measured"] * factor) == change


@pytest.mark.parametrize("share, change", [(0.9, "round-off"), (1e9, "value")])
def test_a_row_that_bounds_rounding_says_itself_what_rounding_is(document, share, change):
    def moved(row):
        return row["measured"] + share * row["tolerance"]

    assert change_of(document, kind="rounding", measured=moved) == change


def test_a_verdict_that_changes_is_told_whatever_the_numbers(document):
    assert change_of(document, status="disagree") == "verdict"


def test_rows_that_are_gone_or_new_are_told(document):
    fewer = deepcopy(document)
    del fewer["comparisons"][0]
    assert compare_reports(document, fewer).counts["gone"] == 1
    assert compare_reports(fewer, document).counts["new"] == 1
    assert compare_reports(fewer, document).any


def test_what_reports_are_made_with_is_told_and_is_no_change_of_results(document):
    other = deepcopy(document)
    other["provenance"]["versions"] = {"numpy": "9.9"}
    other["provenance"]["cases"] = {"pair_head_on": {"digest": "0", "seed": 2}}
    found = compare_reports(document, other)
    assert not found.any
    assert "versions.numpy" in {origin.key for origin in found.origins}
    assert any("versions.numpy" in line and "9.9" in line for line in sentences(found))
    assert "9.9" in changes_markdown(found)


def test_all_of_it_is_json(document):
    fewer = deepcopy(document)
    del fewer["comparisons"][0]
    found = json.loads(changes_json(compare_reports(document, fewer)))
    assert found["schema"] == "cmpcheck-changes/1"
    assert found["counts"]["gone"] == 1
    assert found["rows"][0]["after"] is None
    assert found["rows"][0]["before"]["status"] == document["comparisons"][0]["status"]


# The command


def test_a_report_is_repeated_to_the_same_numbers(here):
    assert call("compare", "drag_relaxation", "--engine", "reference", "--out", "report").exit_code == 0
    found = call("rerun", "report", "--out", "again")
    assert found.exit_code == 0, found.stderr
    assert "identical" in found.stdout.splitlines()[0]
    changes = json.loads(Path("again/changes.json").read_text("utf-8"))
    assert changes["counts"]["identical"] == len(changes["rows"]) > 0
    assert changes["origins"] == []
    again = json.loads(Path("again/report.json").read_text("utf-8"))
    assert {engine["name"] for engine in again["engines"]} == {"reference"}


def test_ones_own_case_is_repeated_from_the_report_and_what_changed_is_told(here):
    text = (CASES / "drag_relaxation.toml").read_text("utf-8").replace('"drag_relaxation"', '"mine"', 1)
    Path("mine.toml").write_text(text, "utf-8")
    assert call("compare", "mine.toml", "--engine", "reference", "--out", "report").exit_code == 0
    Path("mine.toml").unlink()
    document = json.loads(Path("report/report.json").read_text("utf-8"))
    row = next(row for row in document["comparisons"] if row["measured"])
    row["measured"] *= 1.001
    document["provenance"]["versions"]["numpy"] = "1.0"
    Path("report/report.json").write_text(json.dumps(document), "utf-8")
    found = call("rerun", "report/report.json", "--out", "again")
    assert found.exit_code == 1
    assert f"value changed: mine {row['variant']}, reference, {row['quantity']}" in found.stdout
    assert "versions.numpy: 1.0 -> " in found.stdout
    assert "| value changed" in Path("again/changes.md").read_text("utf-8")


@pytest.mark.parametrize(
    "content, said",
    [
        (None, "No such file"),
        ("{", "no report"),
        ('{"schema": "other/1"}', "no report of ours"),
        ('{"schema": "cmpcheck-report/1", "provenance": {}}', "does not say what was asked for"),
        ('{"schema": "cmpcheck-report/1", "provenance": {"request": {"cases": 3}}}', "damaged"),
        (OWN, "keep its data/"),
    ],
)
def test_what_cannot_be_repeated_is_one_line(here, content, said):
    if content is not None:
        Path("report.json").write_text(content, "utf-8")
    assert said in complaint("rerun", "report.json", "--out", "again")
    assert not Path("again").exists()


def test_a_report_is_not_written_over_itself(here):
    Path("report").mkdir()
    Path("report/report.json").write_text('{"schema": "cmpcheck-report/1"}', "utf-8")
    assert "choose another folder" in complaint("rerun", "report", "--out", "report")
