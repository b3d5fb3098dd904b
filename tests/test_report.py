"""The report: verdict and exit code, the four files, and that nothing in a record can break or leave them."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from report_example import HOSTILE, comparison, example, suite
from rich.console import Console

from cmpcheck import verdicts
from cmpcheck.report import exit_code, junit, report_json, summary_table, verdict, write_report
from cmpcheck.results import CaseResult, Trace

AGREE = comparison()
DISAGREE = comparison(status="disagree", error=2e-18)
KNOWN = comparison(status="disagree", error=2e-18, known_departure="legacy-wall-friction")
UNTESTED = comparison(status="not_tested", reason="inconclusive, n = 12")
FAILED = comparison(status="error", measured=math.nan, error=math.nan)
FILES = ("index.html", "report.md", "report.json", "junit.xml")

VOID = {"meta", "br", "hr", "img", "link", "input", "wbr"}


class Page(HTMLParser):
    """The elements, attributes and text of a page, and whether its tags are balanced."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.text: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)

    def values(self, name: str) -> list[str]:
        return [value for _, attribute, value in self.attributes if attribute == name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "latest"
    write_report(example(), path)
    return path


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "index.html").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "rows, absent, word, code, strict_code",
    [
        ([AGREE], False, "agree", 0, 0),
        ([AGREE], True, "incomplete", 0, 1),
        ([AGREE, UNTESTED], False, "incomplete", 0, 1),
        ([UNTESTED], False, "incomplete", 0, 1),
        ([AGREE, KNOWN], False, "agree", 0, 0),
        ([KNOWN, UNTESTED], False, "incomplete", 0, 1),
        ([AGREE, DISAGREE], False, "disagree", 1, 1),
        ([DISAGREE, UNTESTED], True, "disagree", 1, 1),
        ([AGREE, FAILED], False, "disagree", 1, 1),
        ([replace(FAILED, known_departure="does not excuse a failure")], False, "disagree", 1, 1),
        ([], False, "incomplete", 1, 1),
    ],
)
def test_verdict_and_exit_code(rows: list, absent: bool, word: str, code: int, strict_code: int) -> None:
    result = suite(rows, absent)
    assert (verdict(result), exit_code(result), exit_code(result, strict=True)) == (word, code, strict_code)


def test_a_case_without_any_row_makes_the_run_incomplete() -> None:
    result = suite()
    result.cases.append(CaseResult("swarm", "t", "s", "2"))
    assert verdict(result) == "incomplete"
    assert "No comparison was made for swarm." in verdicts.gaps(result)


def test_an_unknown_status_is_refused() -> None:
    with pytest.raises(ValueError, match="agreed"):
        verdict(suite([comparison(status="agreed")]))


def test_the_ratio_of_a_zero_tolerance_is_infinite_and_never_hides() -> None:
    exact, off = comparison(error=0.0, tolerance=0.0), comparison(status="disagree", tolerance=0.0)
    assert verdicts.ratio(exact) == 0
    assert verdicts.ratio(off) == math.inf
    assert verdicts.worst_first([AGREE, exact, UNTESTED, off, FAILED]) == [
        FAILED,
        off,
        UNTESTED,
        AGREE,
        exact,
    ]


def test_json_follows_the_schema(folder: Path) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    document = json.loads((folder / "report.json").read_text(encoding="utf-8"), parse_constant=refuse)
    assert document["schema"] == "cmpcheck-report/1"
    assert document["verdict"] == "disagree"
    for engine in document["engines"]:
        assert list(engine) == ["name", "version", "available", "reason"]
        assert isinstance(engine["available"], bool)
    required = ["case", "variant", "engine", "quantity", "equations", "unit", "reference", "measured"]
    required += ["error", "tolerance", "kind", "reason", "status"]
    assert len(document["comparisons"]) == len(example().comparisons)
    for row in document["comparisons"]:
        assert list(row)[: len(required)] == required
        assert set(row) - set(required) <= {"known_departure", "order"}
        assert row["status"] in {"agree", "disagree", "not_tested", "error"}
        assert row["kind"] in {"rounding", "discretisation", "statistical", "precision"}
        for name in ("reference", "measured", "error", "tolerance"):
            assert row[name] is None or isinstance(row[name], float)
    failed = next(row for row in document["comparisons"] if row["status"] == "error")
    assert failed["measured"] is failed["error"] is failed["tolerance"] is None
    assert sum("known_departure" in row for row in document["comparisons"]) == 1
    assert document["provenance"]["odd"] is None
    assert {c["case"] for c in document["convergences"]} == {"pair_head_on", "wall_bounce"}


def test_json_numbers_are_not_rounded() -> None:
    value = 0.1 + 0.2
    row = json.loads(report_json(suite([comparison(measured=value)])))["comparisons"][0]
    assert row["measured"] == value


def test_junit_has_one_test_case_per_comparison(folder: Path) -> None:
    root = ElementTree.parse(folder / "junit.xml").getroot()
    rows = example().comparisons
    cases = list(root.iter("testcase"))
    assert len(cases) == len(rows) == int(root.attrib["tests"])
    known = sum(row.status == "disagree" and bool(row.known_departure) for row in rows)
    expected = {
        "failure": sum(row.status == "disagree" for row in rows) - known,
        "error": sum(row.status == "error" for row in rows),
        "skipped": sum(row.status == "not_tested" for row in rows) + known,
    }
    for tag, attribute in (("failure", "failures"), ("error", "errors"), ("skipped", "skipped")):
        found = [element for element in root.iter(tag) if element.attrib["message"]]
        assert len(found) == expected[tag] == int(root.attrib[attribute]) > 0
        assert sum(int(s.attrib[attribute]) for s in root.iter("testsuite")) == expected[tag]
    assert cases[0].attrib["classname"] == "pair_head_on.e=0.2"
    assert cases[0].attrib["name"] == "reference: normal_impulse"


def test_junit_is_well_formed_whatever_the_names() -> None:
    text = junit(suite([comparison(case="\x00\x1b ]]> \ud800", reason="&<\ufffe", status="error")]))
    ElementTree.fromstring(text.encode())


def test_the_page_loads_nothing_from_anywhere(page: Page, folder: Path) -> None:
    assert {"script", "link", "img", "iframe", "object", "embed", "base"}.isdisjoint(page.tags)
    assert page.values("src") == []
    assert all(value.startswith("#") for value in page.values("href"))
    assert not any(name.startswith("on") for _, name, _ in page.attributes)
    text = (folder / "index.html").read_text(encoding="utf-8")
    assert "@import" not in text
    assert all(part.startswith("#") for part in text.split("url(")[1:])


def test_the_page_is_balanced_and_its_links_arrive(page: Page) -> None:
    assert page.open == []
    names = page.values("id")
    assert len(names) == len(set(names))
    assert {value[1:] for value in page.values("href")} <= set(names)


def test_hostile_names_are_shown_and_not_obeyed(page: Page, folder: Path) -> None:
    assert "script" not in page.tags
    assert HOSTILE in "".join(page.text)
    for name in ("index.html", "junit.xml"):
        assert "<script" not in (folder / name).read_text(encoding="utf-8")
    markdown = (folder / "report.md").read_text(encoding="utf-8")
    assert "\\<script\\>" in markdown
    assert "<script" not in markdown.replace("\\<script", "")
    assert "[a link](" not in markdown
    for text in ("".join(page.text), markdown):
        assert "\x1b" not in text
        assert "\x00" not in text


def test_markdown_tables_are_rectangular(folder: Path) -> None:
    lines = (folder / "report.md").read_text(encoding="utf-8").splitlines()
    tables: list[list[str]] = [[]]
    for line in lines:
        if line.startswith("|"):
            tables[-1].append(line)
        elif tables[-1]:
            tables.append([])
    assert len([table for table in tables if table]) >= 6
    for table in tables:
        assert len({line.replace("\\|", "").count("|") for line in table}) <= 1


def test_the_page_says_what_a_reader_must_know(page: Page) -> None:
    text = " ".join("".join(page.text).split())
    assert "Something disagrees" in text
    assert "2 of 47 comparisons lie outside the tolerance and 1 could not be computed" in text
    assert "1 disagrees by a known departure" in text
    assert "liggghts is absent and was not tested." in text
    assert "apt install liggghts" in text
    for word in ("✓ agree", "✗ disagree", "≠ disagree, known", "– not tested", "! error"):
        assert word in text
    assert (
        "Exact to rounding at every level, so nothing to plot: Normal impulse (e=0.2, e=0.5, e=0.8, e=1)"
        in text
    )
    assert text.index("1 Verification") < text.index("2 Cross-check")


def test_every_comparison_stands_in_page_and_markdown(page: Page, folder: Path) -> None:
    rows = [value for value in page.values("class") if value.startswith("row-")]
    assert len(rows) >= len(example().comparisons)
    lines = (folder / "report.md").read_text(encoding="utf-8").splitlines()
    assert sum("discretisation:" in line or "rounding:" in line for line in lines) == sum(
        row.kind in ("discretisation", "rounding") for row in example().comparisons
    )


def test_a_part_without_content_is_left_out(tmp_path: Path) -> None:
    write_report(suite([comparison(engine="reference")]), tmp_path)
    text = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "1 Verification" in text
    assert "2 Cross-check" not in text
    assert "Part 2" not in text


@pytest.mark.parametrize("rows, absent", [([], False), ([], True), ([UNTESTED], True), ([KNOWN], False)])
def test_a_poor_result_still_gives_four_files(tmp_path: Path, rows: list, absent: bool) -> None:
    write_report(suite(rows, absent), tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(FILES)
    assert Page((tmp_path / "index.html").read_text(encoding="utf-8")).open == []


def test_equal_results_give_equal_bytes_in_another_process(folder: Path, tmp_path: Path) -> None:
    script = (
        "import pathlib, sys; from report_example import example; from cmpcheck.report import write_report; "
        "write_report(example(), pathlib.Path(sys.argv[1]))"
    )
    here = Path(__file__).parent
    environment = {"PYTHONPATH": f"{here.parent}:{here}", "PYTHONHASHSEED": "7", "PATH": "/usr/bin:/bin"}
    subprocess.run([sys.executable, "-c", script, str(tmp_path)], check=True, env=environment)
    for name in FILES:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_a_long_run_stays_small(tmp_path: Path) -> None:
    result = example()
    t = tuple(k * 1e-9 for k in range(20_000))
    waves = tuple(math.sin(k * 0.37) for k in range(20_000))
    case = result.cases[0]
    for label in range(6):
        for engine in ("reference", "lammps"):
            for style in ("line", "points"):
                case.traces.append(
                    Trace("pair_head_on", "", engine, f"{style} {label}", "m", t, waves, style)
                )
    result.cases = [replace(case, name=f"case_{k}") for k in range(3)]
    write_report(result, tmp_path)
    assert (tmp_path / "index.html").stat().st_size < 3_000_000 * 3 / 11  # of eleven cases
    assert "Not drawn here" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_the_table_for_the_terminal_takes_names_as_text() -> None:
    result: Any = suite([comparison(case="[red]x[/red]"), DISAGREE], absent=True)
    result.cases[0].name = "[bold]pair[/bold]"
    console = Console(width=120, record=True, force_terminal=False)
    console.print(summary_table(result))
    text = console.export_text()
    assert "[bold]pair[/bold]" in text
    assert "✗ disagree 2" in text
    assert "1 agree" in text
    assert "– not tested" in text


def test_importing_the_report_does_not_load_matplotlib() -> None:
    script = "import sys, cmpcheck.report; sys.exit('matplotlib' in sys.modules)"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=Path(__file__).parents[1])
