"""index.html of a design run: what stands where.

Sentences come from `findings.py`, figures from `figures.py`, markup and style from `templates/`.
"""

from __future__ import annotations

import math
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from cmpcheck import provenance
from cmpcheck.display import duration, number, printable, quantity_text
from cmpcheck.optimise import figures, findings
from cmpcheck.optimise.methods import methods_table
from cmpcheck.optimise.results import Design, gene_name, gene_text, printed_table

IMPOSSIBLE_SHOWN = 20


def render(design: Design) -> str:
    """The whole page as one self-contained HTML document."""
    environment = Environment(
        loader=PackageLoader("cmpcheck"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, finalize=lambda value: value if isinstance(value, Markup) else printable(value),
    )  # fmt: skip
    case, best = design.problem.case, design.ranked[0]
    heads, rows = printed_table(design)
    impossible = [one for one in design.ranked if math.isinf(one.cost)]
    trust = [findings.stopping(design), findings.selection(design), findings.indistinct(design)]
    return (
        environment.get_template("optimise.html.j2").render(
            name=case.name,
            title=case.case.title,
            description=case.case.description,
            effort=f"{design.samples} samples, {duration(design.seconds)} of computing",
            headline=headline(design),
            heads=heads,
            rows=rows,
            table_remarks=_table_remarks(design),
            conclusion=findings.conclusion(design),
            spreads=[_spread_row(spread) for spread in findings.spreads(design)],
            gene_remarks=[
                text for text in (findings.importance(design), findings.bound_remark(design)) if text
            ],
            figures=[
                {
                    "title": drawing.title,
                    "caption": drawing.caption,
                    "panels": [Markup(text) for text in figures.inline(drawing)],  # matplotlib escapes
                }
                for drawing in figures.drawings(design)
            ],
            methods=_methods(design),
            trust=[text for text in trust if text] if math.isfinite(best.cost) else [],
            impossible=[
                (_string_text(design, one.string), one.reason) for one in impossible[:IMPOSSIBLE_SHOWN]
            ],
            provenance=_provenance(design),
        )
        + "\n"
    )


def headline(design: Design) -> str:
    """The best string in one sentence."""
    best, name = design.ranked[0], design.problem.cost_name
    if math.isinf(best.cost):
        return f"No string can be run: {best.reason}."
    return (
        f"Best of {len(design.ranked)} strings: {_string_text(design, best.string)}, with {name} = "
        f"{number(best.cost, 3)} ± {number(best.standard_error, 2)} over {best.samples} samples."
    )


def _string_text(design: Design, string: tuple[float, ...]) -> str:
    genes = zip(design.problem.keys, string, strict=True)
    return ", ".join(f"{gene_name(key)} {gene_text(key, value)}" for key, value in genes)


def _table_remarks(design: Design) -> list[str]:
    part, case = design.problem.settings, design.problem.case
    assert case.removal is not None
    weights = part.weights
    remarks = [
        f"{part.generations} generations of {part.population} strings, {part.parents} parents; "
        f"{part.minimum_samples} to {part.maximum_samples} samples each, on the same random surfaces for "
        f"every string; q = {case.cost.exponent:g}. The bounds are ours: the paper gives none.",
        f"Removal is accelerated by A = {case.removal.acceleration:g}: "
        f"{quantity_text(case.case.duration, 's')} stand for "
        f"{quantity_text(case.removal.acceleration * case.case.duration, 's')}.",
        f"The paper prints d̄ = 0.03 without a unit; read as 0.03 D it would be "
        f"{1e6 * 0.03 * case.surface.size:g} µm here.",
    ]
    if not design.problem.plain:
        remarks.append(
            f"cost = {weights.flatness:g} Π + {weights.removal_rate:g} (1 − R/R₁) + "
            f"{weights.abrasive_mass:g} M/M₀; the removal rate R₁ takes all asperities off within the run, "
            "M₀ is the mass of the abrasives in the case as it stands."
        )
    return remarks


def _spread_row(spread: findings.Spread) -> list[str]:
    said = findings.PAPER_CLUSTERS.get(spread.key)
    ends = [gene_text(spread.key, value) for value in (spread.low, spread.high, spread.least, spread.most)]
    return [
        gene_name(spread.key),
        f"{ends[0]} to {ends[1]}",
        f"{ends[2]} to {ends[3]}",
        f"{number(100 * spread.relative, 2)} %",
        number(spread.chance, 2),
        _over_mean(spread),
        "clusters" if spread.clusters else "spreads",
        {True: "clusters", False: "spreads", None: ""}[said],
        f"{number(100 * spread.share.explained, 2)} % (p = {number(spread.share.chance, 1)})",
    ]


def _over_mean(spread: findings.Spread) -> str:
    paper = findings.PAPER_RANGES.get(spread.key)
    known = f" (paper {number(100 * paper, 2)} %)" if paper is not None else ""
    return f"{number(100 * spread.over_mean, 2)} %{known}"


def _methods(design: Design) -> tuple[list[str], list[list[str]]] | None:
    if not design.trials:
        return None
    table = methods_table(design.problem, design.trials)
    heads = ["method", "seed", "samples", "strings", "least cost", "on fresh samples", "standard error"]
    rows = [
        [str(row[0]), *(str(v) for v in row[1:4]), *(number(v, 3) for v in row[4:6]), number(row[6], 2)]
        for row in table.iloc[:, :7].itertuples(index=False)
    ]
    return heads, rows


def _provenance(design: Design) -> list[tuple[str, Any]]:
    record = provenance.collect([design.problem.case])
    machine = record["machine"]
    rows = [("cmpcheck", record["cmpcheck"]), ("commit", record["commit"]), ("python", record["python"])]
    rows += list(record["versions"].items())
    rows += [
        ("case", record["cases"][design.problem.case.name]["digest"]),
        ("seed", design.problem.case.case.seed),
    ]
    return [*rows, ("machine", f"{machine['system']} {machine['architecture']}")]
