"""index.html: what stands where on the page, and its figures.

The markup and style are in `templates/`, the curves in `plots.py`, drawn by `drawings.py`; numbers are
formatted here: the templates only place text.  Everything that comes from records is escaped by Jinja.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cmpcheck import ensemble_text, verdicts
from cmpcheck.display import duration, number, percent, printable, ratio_text, scale, words
from cmpcheck.drawings import Drawings
from cmpcheck.optimise.links import DesignLink
from cmpcheck.results import CaseResult, Chart, Comparison, Convergence, Ensemble, SuiteResult, Trace
from cmpcheck.sensitivity.page import Section
from cmpcheck.study_page import PrintedTable, printed_studies, printed_table
from cmpcheck.verdicts import KNOWN, REFERENCE

ROWS_SHOWN = 6  # a longer table shows its worst rows and folds the rest
PANELS = 6  # figures per case and part


class Row(NamedTuple):
    """A comparison as it is printed."""

    variant: str
    engine: str
    quantity: str
    equations: str
    reference: str
    measured: str
    error: str
    tolerance: str
    unit: str
    ratio: str
    order: str
    kind: str
    reason: str
    status: str  # class of the row
    verdict: str  # symbol and words
    known_departure: str


class Panel(NamedTuple):
    """A figure with its caption."""

    svg: Markup
    caption: str


class EnsembleBlock(NamedTuple):
    """One ensemble of two engines in part 3."""

    heading: str
    panels: list[Panel]
    remarks: tuple[str, ...]
    planning: ensemble_text.TextTable
    ledger: ensemble_text.TextTable | None
    parting: list[str]


@dataclass
class Block:
    """One case in one part of the report."""

    anchor: str
    number: str
    case: CaseResult
    rows: list[Row]
    worst: list[Row]  # empty where all rows are shown
    tally: str
    panels: list[Panel] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    tables: list[PrintedTable] = field(default_factory=list)  # in part 2
    ensembles: list[EnsembleBlock] = field(default_factory=list)  # in part 3
    first: bool = True  # the first part in which the case stands, where its notes are shown


def printed_row(row: Comparison) -> Row:
    """The comparison with its numbers in one human unit: that of the reference, or of a zero's error."""
    sizes = [abs(v) for v in (row.reference, row.measured) if math.isfinite(v)]
    factor, unit = scale(max(sizes, default=0.0), row.unit)
    standing = verdicts.standing(row)
    return Row(
        variant=printable(row.variant),
        engine=printable(row.engine),
        quantity=words(row.quantity),
        equations=printable(row.equations),
        reference=number(row.reference * factor),
        measured=number(row.measured * factor),
        error=number(row.error * factor, 2),
        tolerance=number(row.tolerance * factor, 2),
        unit=unit,
        ratio=ratio_text(verdicts.ratio(row)),
        order="" if row.order is None else number(row.order, 3),
        kind=printable(row.kind),
        reason=printable(row.reason),
        status=standing,
        verdict=f"{verdicts.SYMBOLS[standing]} {verdicts.WORDS[standing]}",
        known_departure=printable(row.known_departure),
    )


def tally_text(rows: Iterable[Comparison]) -> str:
    """The counts of the statuses in words, e.g. "23 agree, 1 not tested"."""
    return ", ".join(f"{n} {verdicts.WORDS[status]}" for status, n in verdicts.count(rows).items())


def render(
    result: SuiteResult, designs: Sequence[DesignLink] = (), sensitivity: Section | None = None, jobs: int = 1
) -> str:
    """The whole page as one self-contained HTML document, linking design runs; `jobs` processes draw."""
    drawings = Drawings()
    environment = Environment(
        loader=PackageLoader("cmpcheck"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=lambda value: value if isinstance(value, Markup) else printable(value),
    )  # fmt: skip
    parts = {part: _blocks(result, part, drawings) for part in ("1", "2", "3")}
    anchors = {(block.case.name, part): block.anchor for part, blocks in parts.items() for block in blocks}
    text = environment.get_template("index.html.j2").render(
        result=result,
        verdict=verdicts.verdict(result),
        title=verdicts.title(result),
        headline=verdicts.headline(result),
        gaps=verdicts.gaps(result),
        tally=tally_text(result.comparisons),
        engines=verdicts.engine_names(result),
        matrix=verdicts.matrix(result),
        closeness=_closeness(result),
        closeness_engines=_judged(result),
        verification=parts["1"],
        crosscheck=parts["2"],
        statistics=parts["3"],
        studies=printed_studies(result, drawings),
        anchors=anchors,
        designs=designs,
        sensitivity=sensitivity,
        provenance=list(_flat(result.provenance)),
        symbols=verdicts.SYMBOLS,
        status_words=verdicts.WORDS,
        duration=duration,
        ratio_text=ratio_text,
        known=KNOWN,
        reference=REFERENCE,
    )
    return drawings.place(text, jobs) + "\n"


def _closeness(result: SuiteResult) -> list[tuple[str, list[str]]]:
    names = _judged(result)
    return [
        (words(name), [percent(row.get(engine)) for engine in names])
        for name, row in verdicts.closeness(result).items()
    ]


def _judged(result: SuiteResult) -> list[str]:
    """The engines that have a relative error."""
    found = {engine for row in verdicts.closeness(result).values() for engine in row}
    return [name for name in verdicts.engine_names(result) if name in found]


def _blocks(result: SuiteResult, part: str, drawings: Drawings) -> list[Block]:
    """The cases that have anything to show in a part: "1" the reference, "2" other engines, "3" ensembles."""
    blocks: list[Block] = []
    for index, case in enumerate(result.cases):
        own = [row for row in case.comparisons if verdicts.part_of(row) == part]
        ensembles = case.ensembles if part == "3" else []
        home = "3" if case.ensembles else "2"
        convergences = [c for c in case.convergences if ("1" if c.engine == REFERENCE else home) == part]
        crossed = {t.label for t in case.traces if t.engine not in (REFERENCE, "exact")}
        traces = [t for t in case.traces if (home if t.label in crossed else "1") == part]
        charts = case.charts if part == "2" else []
        if not (own or convergences or traces or ensembles or charts):
            continue
        anchor = f"part-{part}-case-{index + 1}"
        ordered = verdicts.worst_first(own)
        grave = sum(verdicts.standing(row) in ("error", "disagree", KNOWN) for row in own)
        shown = max(ROWS_SHOWN, min(grave, 20))
        block = Block(
            anchor, f"{part}.{len(blocks) + 1}", case, [printed_row(row) for row in own],
            [printed_row(row) for row in ordered[:shown]] if len(own) > shown + 2 else [], tally_text(own),
        )  # fmt: skip
        block.first = part == min(map(verdicts.part_of, case.comparisons), default=part)
        block.panels += _chart_panels(charts, block.number, drawings)
        _draw(block, traces, convergences, drawings)
        block.tables = [printed_table(table) for table in case.tables] if part == "2" else []
        block.ensembles = [_ensemble(e, f"e{block.number}.{k}", drawings) for k, e in enumerate(ensembles)]
        blocks.append(block)
    return blocks


def _chart_panels(charts: Sequence[Chart], number: str, drawings: Drawings) -> list[Panel]:
    from cmpcheck.charts import chart_figure

    return [
        Panel(drawings.note(chart_figure, chart, f"c{number}.{k}"), printable(chart.caption))
        for k, chart in enumerate(charts)
    ]


def _ensemble(ensemble: Ensemble, key: str, drawings: Drawings) -> EnsembleBlock:
    """An ensemble's figures, tables and sentences."""
    from cmpcheck.plots_ensembles import ensemble_figure

    panels = [
        Panel(
            drawings.note(ensemble_figure, curve, ensemble.engine, f"{key}.{k}"),
            ensemble_text.curve_caption(curve, ensemble),
        )
        for k, curve in enumerate(ensemble.curves)
    ]
    ledger = ensemble.ledger
    return EnsembleBlock(
        ensemble_text.heading(ensemble),
        panels,
        ensemble.remarks,
        ensemble_text.planning_table(ensemble),
        None if ledger is None else ensemble_text.ledger_table(ledger, ensemble.engine),
        [] if ledger is None else ensemble_text.ledger_sentences(ensemble),
    )


def _draw(
    block: Block, traces: Sequence[Trace], convergences: Sequence[Convergence], drawings: Drawings
) -> None:
    """Add the figures of a block, and in words what is not drawn."""
    from cmpcheck import plots

    until = max((time for trace in traces for time in trace.times if math.isfinite(time)), default=0.0)
    groups: list[tuple[Any, list[Any], str, dict[str, float]]] = []
    for (label, _, style), members in _grouped(traces, lambda t: (t.label, t.unit, t.style)):
        drawn = [t for t in members if any(map(math.isfinite, t.values))]
        what = f"{_capital(words(label))} over time" + (", each impact a point" if style == "points" else "")
        chunks = _chunks(drawn, plots.SERIES)
        groups += [(plots.trace_figure, chunk, what, {"until": until}) for chunk in chunks]
    bounds = {
        (row.variant, row.engine, row.quantity): row.tolerance
        for row in block.case.comparisons
        if row.kind == "rounding" and math.isfinite(row.tolerance)
    }
    exact = [
        c
        for c in convergences
        if plots.drawable(c)
        and plots.exact_to_rounding(c, bounds.get((c.variant, c.engine, c.quantity), 0.0))
    ]
    rough = [c for c in convergences if plots.drawable(c) and c not in exact]
    for (quantity, _, parameter), members in _grouped(rough, lambda c: (c.quantity, c.unit, c.parameter)):
        what = f"Convergence of {words(quantity)} in the {printable(parameter)}"
        groups += [(plots.convergence_figure, chunk, what, {}) for chunk in _chunks(members, plots.SERIES)]
    for k, (draw, members, what, options) in enumerate(groups[:PANELS]):
        svg = drawings.note(draw, members, f"f{block.number}.{k}", **options)
        block.panels.append(Panel(svg, what))
    if len(groups) > PANELS:
        left = ", ".join(what[0].lower() + what[1:] for _, _, what, _ in groups[PANELS:])
        block.remarks.append(f"Not drawn here, but in data/: {left}.")
    if exact:
        names = [_capital(words(q)) + _variants(m) for (q,), m in _grouped(exact, lambda c: (c.quantity,))]
        block.remarks.append(f"Exact to rounding at every level, so nothing to plot: {'; '.join(names)}.")


def _variants(convergences: Sequence[Convergence]) -> str:
    names = list(dict.fromkeys(printable(c.variant) for c in convergences if c.variant))
    return f" ({', '.join(names)})" if names else ""


def _grouped(records: Iterable[Any], key: Any) -> list[tuple[Any, list[Any]]]:
    groups: dict[Any, list[Any]] = {}
    for record in records:
        groups.setdefault(key(record), []).append(record)
    return list(groups.items())


def _chunks(records: Sequence[Any], size: int) -> list[list[Any]]:
    """Records split so that no part has more than `size` variants; several engines stay together."""
    variants = list(dict.fromkeys(record.variant for record in records))
    cuts = [variants[k : k + size] for k in range(0, len(variants), size)]
    return [[record for record in records if record.variant in cut] for cut in cuts]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _flat(value: Any, path: str = "") -> Iterable[tuple[str, str]]:
    """Nested provenance as lines of dotted key and text."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else str(key))
    elif isinstance(value, (list, tuple)):
        yield path, ", ".join(map(str, value))
    else:
        yield path, str(value)
