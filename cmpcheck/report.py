"""Write the report of one run of the suite: index.html, report.md, report.json and junit.xml.

Which verdict, exit code and matrix a result has is in `verdicts.py`, the page in `page.py`, its figures in
`plots.py`, the Markdown in `markdown.py`.  The folder's data/ is the suite's own.
"""

from __future__ import annotations

import json
import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from rich.table import Table
from rich.text import Text

from cmpcheck import verdicts
from cmpcheck.display import printable, quantity_text, ratio_text
from cmpcheck.optimise.links import DesignLink
from cmpcheck.results import STATUSES, Comparison, EngineInfo, SuiteResult
from cmpcheck.sensitivity.page import Section
from cmpcheck.verdicts import exit_code, verdict

SCHEMA = "cmpcheck-report/1"
_COLOURS = {
    "agree": "green",
    "disagree": "red",
    verdicts.KNOWN: "yellow",
    "not_tested": "dim",
    "error": "magenta",
}

__all__ = ["SCHEMA", "exit_code", "junit", "report_json", "summary_table", "verdict", "write_report"]


def write_report(
    result: SuiteResult, folder: Path, designs: Sequence[DesignLink] = (), sensitivity: Section | None = None,
    jobs: int = 1,
) -> None:  # fmt: skip
    """Write the four files into `folder`, which is created if need be; equal results give equal bytes.

    The page links the `designs`, and shows the `sensitivity` of the suite as its fourth part.  `jobs`
    processes draw its figures.
    """
    from cmpcheck import markdown, page

    folder = Path(folder)
    files = {
        "report.json": report_json(result),
        "junit.xml": junit(result),
        "report.md": markdown.render(result, sensitivity),
        "index.html": page.render(result, designs, sensitivity, jobs),
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")


def report_json(result: SuiteResult) -> str:
    """The result as JSON of schema "cmpcheck-report/1"; NaN and infinity are null."""
    document = {
        "schema": SCHEMA,
        "verdict": verdict(result),
        "engines": [
            {f.name: getattr(engine, f.name) for f in fields(EngineInfo)} for engine in result.engines
        ],
        "comparisons": [_json_row(row) for row in result.comparisons],
        "counts": {status: sum(r.status == status for r in result.comparisons) for status in STATUSES},
        "cases": [
            {
                "name": case.name,
                "title": case.title,
                "sentence": case.sentence,
                "equations": case.equations,
                "notes": case.notes,
                "seconds": case.seconds,
            }
            for case in result.cases
        ],
        "convergences": [
            asdict(convergence) | {"case": case.name}
            for case in result.cases
            for convergence in case.convergences
        ],
        "ensembles": [asdict(ensemble) for case in result.cases for ensemble in case.ensembles],
        "studies": [asdict(study) for study in result.studies],
        "provenance": result.provenance,
        "profile": result.profile,
        "seconds": result.seconds,
    }
    return json.dumps(_plain(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _json_row(row: Comparison) -> dict[str, Any]:
    entry = asdict(row)
    if not row.known_departure:
        del entry["known_departure"]
    return entry


def _plain(value: Any) -> Any:
    """The value in JSON's own types; what is not finite is null, what JSON does not know is text."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value) if math.isfinite(value) else None
    if hasattr(value, "_asdict"):
        return _plain(value._asdict())
    if isinstance(value, Mapping):
        return {printable(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (set, frozenset)):
        return sorted((_plain(inner) for inner in value), key=str)
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return printable(value)


def junit(result: SuiteResult) -> str:
    """The comparisons as JUnit XML, one test case each.

    A known departure is skipped, not failed, as it does not change the exit code either.
    """
    root = ElementTree.Element("testsuites", name="cmpcheck", time=f"{result.seconds:.3f}")
    totals = {"tests": 0, "failures": 0, "errors": 0, "skipped": 0}
    for case in result.cases:
        counts = verdicts.count(case.comparisons)
        tally = {
            "tests": len(case.comparisons),
            "failures": counts.get("disagree", 0),
            "errors": counts.get("error", 0),
            "skipped": counts.get("not_tested", 0) + counts.get(verdicts.KNOWN, 0),
        }
        totals = {key: totals[key] + n for key, n in tally.items()}
        attributes = {"name": printable(case.name), "time": f"{case.seconds:.3f}"}
        attributes |= {key: str(n) for key, n in tally.items()}
        suite = ElementTree.SubElement(root, "testsuite", attributes)
        for row in case.comparisons:
            _junit_row(suite, row)
    root.attrib |= {key: str(n) for key, n in totals.items()}
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def _junit_row(suite: ElementTree.Element, row: Comparison) -> None:
    classname = f"{row.case}.{row.variant}" if row.variant else row.case
    test = ElementTree.SubElement(
        suite,
        "testcase",
        classname=printable(classname),
        name=printable(f"{row.engine}: {row.quantity}"),
        time="0",
    )
    standing = verdicts.standing(row)
    if standing == "agree":
        return
    tag = {"disagree": "failure", "error": "error"}.get(standing, "skipped")
    message = row.reason
    if standing == "disagree":
        message = f"error {quantity_text(row.error, row.unit, digits=3)}, "
        message += f"tolerance {quantity_text(row.tolerance, row.unit, digits=3)}"
    elif standing == verdicts.KNOWN:
        message = f"known departure: {row.known_departure}"
    detail = ElementTree.SubElement(test, tag, message=printable(message))
    if tag != "skipped":
        detail.set("type", row.kind)
        detail.text = printable(
            f"reference {row.reference!r} {row.unit}\nmeasured {row.measured!r} {row.unit}\n"
            f"error {row.error!r}\ntolerance {row.tolerance!r} ({row.kind}: {row.reason})\n"
            f"Eqs. {row.equations}"
        )


def summary_table(result: SuiteResult) -> Table:
    """Case x engine with the worst error against its tolerance, for the terminal."""
    table = Table(caption="largest error / tolerance; up to 1 agrees", caption_justify="left")
    table.add_column("case")
    for engine in verdicts.engine_names(result):
        table.add_column(Text(printable(engine)))
    for case, cells in zip(result.cases, verdicts.matrix(result), strict=True):
        table.add_row(Text(printable(case.name)), *map(_cell_text, cells))
    return table


def _cell_text(cell: verdicts.Cell) -> Text:
    if not cell.status:
        return Text("not compared", "dim")
    text = Text(f"{verdicts.SYMBOLS[cell.status]} {verdicts.WORDS[cell.status]}", _COLOURS[cell.status])
    if cell.worst is not None and cell.status != "error":
        text.append(f" {ratio_text(cell.worst)}")
    for status, n in cell.others:
        text.append(f"\n{n} {verdicts.WORDS[status]}", "dim")
    return text
