"""What a design run came to, as records and as tables: the paper's Table 1, and all strings.

What follows from it in words is `findings.py`, in pictures `figures.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from cmpcheck.display import number, scale
from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.front import Front
from cmpcheck.optimise.methods import Trial
from cmpcheck.optimise.problem import PAPER_KEYS, Problem, String, paper_columns
from cmpcheck.optimise.search import MAIN
from cmpcheck.optimise.store import Asked, Evaluated

TOP = 10  # strings in the paper's Table 1
SYMBOLS = {"V_pad": "V_pad", "N": "N", "mean_diameter": "d̄", "diameter_spread": "δd"}
UNITS = {"V_pad": "m/s", "N": "1", "mean_diameter": "m", "diameter_spread": "1"}


@dataclass(frozen=True)
class Distribution:
    """The costs of samples with equal parameters."""

    label: str
    string: String
    costs: np.ndarray  # (n,)


@dataclass(frozen=True)
class Design:
    """A finished run."""

    problem: Problem
    asked: list[Asked]  # in the order of asking
    distributions: list[Distribution]
    top_samples: list[np.ndarray]  # costs of the top strings, each (n,)
    samples: int  # in all
    seconds: float  # of computing, summed over workers
    trials: list[Trial] = field(default_factory=list)
    front: Front | None = None

    @property
    def ranked(self) -> list[Evaluated]:
        """The different strings, best first."""
        return ranked(self.asked)

    @property
    def history(self) -> list[float]:
        """The best cost after each generation."""
        last = max(asked.generation for asked in self.asked)
        return [
            min(asked.found.cost for asked in self.asked if asked.generation <= generation)
            for generation in range(1, last + 1)
        ]


def ranked(asked: Sequence[Asked]) -> list[Evaluated]:
    """The different strings, best first; of equal costs the one that was asked for first."""
    return sorted({a.found.string: a.found for a in asked}.values(), key=lambda found: found.cost)


def collect(
    problem: Problem, evaluator: Evaluator, trials: Sequence[Trial] = (), front: Front | None = None
) -> Design:
    """The design from what is in the store; samples for Fig. 7 are run if they are missing."""
    asked = evaluator.store.asked(MAIN)
    top = ranked(asked)[:TOP]
    sets = {"the case as it stands": problem.as_it_stands(), "the best string": top[0].string}
    size = problem.settings.distribution_samples
    found = evaluator.samples(list(sets.values()), size)
    distributions = [
        Distribution(label, string, np.array([sample.cost for sample in samples]))
        for (label, string), samples in zip(sets.items(), found, strict=True)
        if len(samples) == size
    ]
    top = [found for found in top if math.isfinite(found.cost)]
    costs = [
        np.array([known[k].cost for k in range(found.samples)])
        for found in top
        for known in [evaluator.store.samples(evaluator.store.number_of(found.string))]
    ]
    samples, seconds = evaluator.store.totals()
    return Design(problem, asked, distributions, costs, samples, seconds, list(trials), front)


def table(problem: Problem, found: Sequence[Evaluated]) -> pd.DataFrame:
    """Strings in the columns of the paper's Table 1, with standard error and number of samples."""
    rows = [
        paper_columns(problem, one.string)
        | {"cost": one.cost, "standard_error": one.standard_error, "samples": one.samples}
        for one in found
    ]
    return pd.DataFrame(rows)


def write_tables(design: Design, folder: Path) -> list[Path]:
    """table.csv and table.md, the top ten; strings.csv, all strings, with the reason of infinite costs."""
    top = table(design.problem, design.ranked[:TOP])
    every = table(design.problem, design.ranked)
    first = {asked.found.string: asked for asked in reversed(design.asked)}
    every["generation"] = [first[found.string].generation for found in design.ranked]
    every["origin"] = [first[found.string].origin for found in design.ranked]
    every["reason"] = [found.reason for found in design.ranked]
    texts = {
        "table.csv": top.to_csv(index=False),
        "strings.csv": every.to_csv(index=False),
        "table.md": markdown_table(design),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, "utf-8", newline="\n")
    return [folder / name for name in texts]


def printed_table(design: Design) -> tuple[list[str], list[list[str]]]:
    """Heads and cells of Table 1 as people read it."""
    found = design.ranked[:TOP]
    columns = [paper_columns(design.problem, one.string) for one in found]
    units = UNITS | {key: "1" for key in columns[0] if key not in UNITS}
    heads, texts = [], []
    for name, unit in units.items():
        values = [row[name] for row in columns]
        if all(value is None for value in values):
            continue
        factor, label = scale(max(abs(v) for v in values if v is not None), unit)
        heads.append(SYMBOLS.get(name, name) + (f" ({label})" if label else ""))
        texts.append([number(v * factor, 3) for v in values])
    heads += [design.problem.cost_name, "standard error", "samples"]
    texts += [
        [number(one.cost, 3) for one in found],
        [number(one.standard_error, 2) for one in found],
        [str(one.samples) for one in found],
    ]
    return heads, [list(row) for row in zip(*texts, strict=True)]


def markdown_table(design: Design) -> str:
    """The top ten in the form of the paper's Table 1."""
    heads, rows = printed_table(design)
    lines = [f"# Top {len(rows)} strings of {design.problem.case.name}", "", *_lines(heads, rows)]
    bounds = ", ".join(
        f"{gene_name(gene.key)} {gene_text(gene.key, gene.low)} to {gene_text(gene.key, gene.high)}"
        for gene in design.problem.settings.gene
    )
    part = design.problem.settings
    rule = f"{part.minimum_samples} to {part.maximum_samples} samples, tolerance {part.tolerance:g}"
    exponent = design.problem.case.cost.exponent
    notes = f"Bounds, which are ours: {bounds}. Ensembles: {rule}. q = {exponent:g}."
    size = design.problem.case.surface.size
    unit = (
        f"The paper's Table 1 prints d̄ = 0.03 without a unit: 0.03 D would be {1e6 * 0.03 * size:g} µm here."
    )
    return "\n".join([*lines, "", notes, unit, ""])


def gene_name(key: str) -> str:
    """The paper's symbol of a gene, or its key."""
    names = dict(zip(PAPER_KEYS, SYMBOLS.values(), strict=True))
    return names.get(key, key)


def gene_text(key: str, value: float) -> str:
    """A value of a gene with its unit."""
    units = dict(zip(PAPER_KEYS, UNITS.values(), strict=True))
    factor, label = scale(value, units.get(key, "1"))
    return f"{number(value * factor, 3)} {label}".rstrip()


def _lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table."""
    marks = "|".join("---:" for _ in heads)
    return [f"| {' | '.join(heads)} |", f"|{marks}|", *(f"| {' | '.join(row)} |" for row in rows)]
