"""The page of its own, the same as Markdown, and what the report of `cmpcheck compare` shows of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cmpcheck.display import printable
from cmpcheck.sensitivity import words
from cmpcheck.sensitivity.document import explained, read

FOLDER = "sensitivity"  # beside a report, as `cmpcheck sensitivity` writes it by default


class Section(NamedTuple):
    """What the templates place; figures are SVG."""

    headline: str
    blind_spots: list[str]
    columns: list[str]
    rows: list[dict[str, Any]]
    explained: list[tuple[str, str]]
    limits: Markup
    others: list[tuple[str, str]]  # limits in other units than percent
    alarms: str
    power: list[tuple[Markup, str]]
    sizes: str  # of samples, in a sentence
    pairs: tuple[list[str], list[list[str]]]
    orders: tuple[list[str], list[list[str]]]
    nasa: tuple[list[str], list[list[str]]]
    tests: str
    profile: str
    href: str = ""  # of the page of its own, from the report


def section(document: dict[str, Any], href: str = "") -> Section:
    """The document as it is placed."""
    from cmpcheck.sensitivity.figures import limits_figure, power_figures  # matplotlib takes a second

    names = words.columns(document)
    rows = [
        {
            "name": m["name"], "breaks": m["breaks"], "where": m["where"], "side": words.SIDES[m["side"]],
            "size": words.size_text(m), "limit": words.limit_text(m), "finest": words.finest_check(m),
            "cells": words.cells(m, names),
            "detected": m["detected"], "explained": bool(m["explained"]),
            "tests": "" if m["tests"] is None else (m["tests"][0] if m["tests"] else "none"),
            "tests_in_words": words.test_in_words(m["tests"]),
        }
        for m in document["mutants"]
    ]  # fmt: skip
    others = [
        (m["name"], words.limit_text(m))
        for m in document["mutants"]
        if m["unit"] and not m["unit"].startswith(words.PERCENT) and m["smallest_detected"] is not None
    ]
    return Section(
        headline=words.headline(document),
        blind_spots=words.blind_spots(document),
        columns=names,
        rows=rows,
        explained=[(m["name"], m["explained"]) for m in explained(document)],
        limits=Markup(limits_figure(document, "sl")),  # matplotlib escapes what it writes
        others=others,
        alarms=words.alarm_sentence(document),
        power=[(Markup(svg), caption) for svg, caption in power_figures(document, "sp")],
        sizes=words.pair_sentence(document),
        pairs=words.pair_rows(document),
        orders=words.order_rows(document),
        nasa=words.nasa_rows(document),
        tests=words.test_sentence(document),
        profile=document["profile"],
        href=href,
    )


def section_beside(report: Path) -> Section | None:
    """What was found beside a report: for reports/latest in reports/sensitivity."""
    document = read(report.parent / FOLDER)
    return None if document is None else section(document, f"../{FOLDER}/index.html")


def render(document: dict[str, Any]) -> str:
    """The page of its own, as one self-contained HTML document."""
    environment = Environment(
        loader=PackageLoader("cmpcheck"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=lambda value: value if isinstance(value, Markup) else printable(value),
    )  # fmt: skip
    return environment.get_template("sensitivity.html.j2").render(sensitivity=section(document)) + "\n"


def markdown(document: dict[str, Any]) -> str:
    """The same as Markdown: sentences, limits, and who notices what."""
    shown = section(document)
    lines = ["# What the suite would have caught", "", shown.headline, ""]
    lines += [f"- {sentence}" for sentence in shown.blind_spots]
    header = ["seeded error", "what it breaks", "made by", "size", "smallest noticed", "noticed by"]
    table = [
        [m["name"], m["breaks"], words.SIDES[m["side"]], words.size_text(m), words.limit_text(m), _cases(m)]
        for m in document["mutants"]
    ]
    lines += ["", "## Seeded errors", "", *_table(header, table)]
    if shown.explained:
        lines += ["", "## Why some cannot be noticed", ""]
        lines += [f"- {name}: {reason}" for name, reason in shown.explained]
    for title, text, (heads, rows) in (
        ("False alarms", shown.alarms, ([], [])),
        ("Sample sizes", shown.sizes, shown.pairs),
        ("Observed orders", "", shown.orders),
        ("NASA's example of grid convergence", "", shown.nasa),
        ("The tests", shown.tests, ([], [])),
    ):
        if text or rows:
            lines += ["", f"## {title}", ""]
            lines += [text] if text else []
            lines += ["", *_table(heads, rows)] if text and rows else _table(heads, rows) if rows else []
    return "\n".join(lines) + "\n"


def _cases(mutant: dict[str, Any]) -> str:
    """The cases that notice an error, each with the number of its checks."""
    counts: dict[str, int] = {}
    for check in mutant["by"]:
        counts[check.partition(":")[0]] = counts.get(check.partition(":")[0], 0) + 1
    return ", ".join(f"{name} {count}" for name, count in counts.items()) or "nothing"


def _table(header: list[str], rows: list[list[str]]) -> list[str]:
    lines = ["| " + " | ".join(header) + " |", "|---" * len(header) + "|"]
    return lines + [
        "| " + " | ".join(printable(cell).replace("|", "\\|") for cell in row) + " |" for row in rows
    ]
