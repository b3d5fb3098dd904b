"""report.md: the report as text tables, for a terminal or a forge; no figures."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from cmpcheck import ensemble_text, verdicts
from cmpcheck.display import duration, number, percent, printable, quantity_text, ratio_text, words
from cmpcheck.page import printed_row, tally_text
from cmpcheck.results import CaseResult, Comparison, Ensemble, StudyResult, SuiteResult
from cmpcheck.sensitivity.page import Section
from cmpcheck.study_page import printed_table, printed_tables

_PARTS = (
    ("1 Verification: does the reference solve the paper's equations?", "1"),
    ("2 Cross-check: do the engines reproduce the reference?", "2"),
    ("3 Statistics: where trajectories cannot be compared, are the ensembles equivalent?", "3"),
)


def render(result: SuiteResult, sensitivity: Section | None = None) -> str:
    """The whole report as GitHub-flavoured Markdown."""
    word = verdicts.verdict(result)
    lines = [
        f"# cmpcheck: {word}",
        "",
        f"**{plain(verdicts.title(result))}**",
        "",
        plain(verdicts.headline(result)),
    ]
    lines += [plain(gap) for gap in verdicts.gaps(result)]
    lines += ["", f"Profile {plain(result.profile)}, {duration(result.seconds)}.", "", "## Engines", ""]
    lines += pipe_table(
        ["engine", "version"],
        [[e.name, (e.version or "unknown") if e.available else f"absent, not tested: {e.reason}"]
         for e in result.engines],
    )  # fmt: skip
    engines = verdicts.engine_names(result)
    lines += ["", "## Case by engine", "", "Largest error divided by its tolerance; up to 1 agrees.", ""]
    lines += pipe_table(
        ["case", *engines],
        [
            [case.name, *map(_cell, cells)]
            for case, cells in zip(result.cases, verdicts.matrix(result), strict=True)
        ],
    )
    closeness = verdicts.closeness(result)
    if closeness:
        lines += ["", "## How closely", "", "Largest error relative to the value compared with.", ""]
        lines += pipe_table(
            ["quantity", *engines],
            [[words(q), *(percent(row.get(engine)) for engine in engines)] for q, row in closeness.items()],
        )
    for title, part in _PARTS:
        sections = [section for case in result.cases for section in _case(case, part)]
        if sections:
            lines += ["", f"## {title}", *sections]
    if sensitivity is not None:
        lines += [
            "",
            "## 4 Sensitivity: what would the suite have caught?",
            "",
            plain(sensitivity.headline),
            "",
        ]
        lines += [f"- {plain(sentence)}" for sentence in sensitivity.blind_spots]
        lines += ["", plain(sensitivity.alarms)] if sensitivity.alarms else []
    if result.studies:
        lines += ["", "## Studies: what may a user rely on?"]
        lines += [line for study in result.studies for line in _study(study)]
    return "\n".join(lines) + "\n"


def plain(text: str) -> str:
    """Text that Markdown shows as it is: one line, and none of its characters has a meaning."""
    flat = " ".join(printable(text).split())
    return re.sub(r"([\\`*{}\[\]<>#|~&$]|(?<!\w)_|_(?!\w))", r"\\\1", flat)


def _case(case: CaseResult, part: str) -> list[str]:
    rows = [row for row in case.comparisons if verdicts.part_of(row) == part]
    convergences = [c for c in case.convergences if ("1" if c.engine == verdicts.REFERENCE else "2") == part]
    ensembles = case.ensembles if part == "3" else []
    if not rows and not convergences and not ensembles:
        return []
    lines = ["", f"### {plain(case.name)}: {plain(case.title)}", "", plain(case.sentence)]
    if case.equations:
        lines[-1] += f" (Eqs. {plain(case.equations)})"
    first = part == min(map(verdicts.part_of, case.comparisons), default="1")
    lines += [item for note in case.notes if first for item in ("", plain(note))]
    lines += [line for ensemble in ensembles for line in _ensemble(ensemble)]
    for table in map(printed_table, case.tables if part == "2" else []):
        lines += ["", f"{plain(table.caption)}.", "", *pipe_table(table.header, table.rows)]
    if rows:
        lines += ["", f"{len(rows)} comparison{'s' * (len(rows) > 1)}: {tally_text(rows)}.", "", *_rows(rows)]
    if convergences:
        lines += ["", "Limits:", ""]
        lines += pipe_table(
            ["variant", "engine", "quantity", "limit", "uncertainty", "target", "order", "in the"],
            [[c.variant, c.engine, words(c.quantity), quantity_text(c.extrapolated, c.unit),
              quantity_text(c.uncertainty, c.unit, digits=2), quantity_text(c.target, c.unit),
              "none" if c.order is None else number(c.order, 3), c.parameter] for c in convergences],
        )  # fmt: skip
    return lines


def _ensemble(ensemble: Ensemble) -> list[str]:
    lines = ["", f"#### {plain(ensemble_text.heading(ensemble))}"]
    lines += [item for text in ensemble.remarks for item in ("", plain(text))]
    tables = [ensemble_text.planning_table(ensemble)]
    if ensemble.ledger is not None:
        lines += ["", plain(" ".join(ensemble_text.ledger_sentences(ensemble)))]
        tables.append(ensemble_text.ledger_table(ensemble.ledger, ensemble.engine))
    for table in tables:
        lines += ["", plain(table.caption), "", *pipe_table(table.header, table.rows)]
    return lines


def _rows(rows: Iterable[Comparison]) -> list[str]:
    header = ["variant", "engine", "quantity", "Eq.", "reference", "measured", "error", "tolerance", "unit"]
    header += ["error/tol.", "order", "status", "how judged"]
    body: list[list[str]] = []
    for row in map(printed_row, rows):
        why = f"{row.kind}: {row.reason}"
        why += f"; known departure: {row.known_departure}" if row.known_departure else ""
        body.append([*row[:11], row.verdict, why])
    return pipe_table(header, body)


def _study(study: StudyResult) -> list[str]:
    lines = ["", f"### {plain(study.name)}: {plain(study.title)}", ""]
    if study.error:
        return [*lines, f"error: {plain(study.error)}"]
    lines += [plain(study.sentence), "", f"{plain(study.varied)} {plain(study.samples)}"]
    for table in printed_tables(study):
        lines += ["", f"{plain(table.caption)}:", "", *pipe_table(table.header, table.rows)]
    return lines


def _cell(cell: verdicts.Cell) -> str:
    if not cell.status:
        return "not compared"
    text = f"{verdicts.SYMBOLS[cell.status]} {verdicts.WORDS[cell.status]}"
    if cell.worst is not None and cell.status != "error":
        text += f" {ratio_text(cell.worst)}"
    return ", ".join([text, *(f"{n} {verdicts.WORDS[status]}" for status, n in cell.others)])


def pipe_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A pipe table with its columns aligned for reading as text; an empty column is left out."""
    columns = (
        [k for k in range(len(header)) if k < 1 or any(row[k] for row in rows)]
        if rows
        else range(len(header))
    )
    cells = [[plain(row[k]) for k in columns] for row in [header, *rows]]
    widths = [max(3, *(len(line[k]) for line in cells)) for k in range(len(cells[0]))]
    lines = [
        "| " + " | ".join(c.ljust(w) for c, w in zip(line, widths, strict=True)) + " |" for line in cells
    ]
    return [lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]]
