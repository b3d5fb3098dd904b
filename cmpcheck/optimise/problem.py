"""The design problem of a case: what a string of genes means, and what one sample of it is worth.

Which strings are tried is `search.py`, how their samples are run `evaluation.py`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from reference.case import Case, CaseError
from reference.case_optimise import Optimise, value_of
from reference.ensemble import StoppingRule, sample_case
from reference.toml_source import MISSING

String = tuple[float, ...]  # one value for each gene, in SI
PAPER_KEYS = ("pad.speed", "particles.count", "particles.mean_diameter", "particles.diameter_spread")


class Sample(NamedTuple):
    """One sample of a string; NaN and a text in `error` where it cannot be run."""

    cost: float
    flatness: float  # Pi, Eq (44)
    removal_rate: float  # mean height taken off the surface per time of the process, m/s
    abrasive_mass: float  # kg
    seconds: float
    error: str = ""


@dataclass(frozen=True)
class Problem:
    """A case with [optimise], and its strings.

    Raises CaseError for a case without that section, or with variants.
    """

    case: Case

    def __post_init__(self) -> None:
        if self.case.optimise is None:
            allowed = "required by `cmpcheck optimise`, but missing; polish_design has one to start from"
            raise self.case.error("optimise", MISSING, allowed)
        if self.case.declared_variants:
            raise self.case.error(
                "variant.0.name", self.case.declared_variants[0].name, "with [optimise], allowed: none"
            )

    @property
    def settings(self) -> Optimise:
        """The section [optimise]."""
        assert self.case.optimise is not None
        return self.case.optimise

    @property
    def keys(self) -> tuple[str, ...]:
        """The dotted key of each gene."""
        return tuple(gene.key for gene in self.settings.gene)

    @property
    def bounds(self) -> np.ndarray:
        """Least and largest value of each gene, (n, 2), SI."""
        return np.array([(gene.low, gene.high) for gene in self.settings.gene], dtype=float)

    @property
    def integer(self) -> tuple[bool, ...]:
        """Which genes are whole numbers."""
        return tuple(gene.integer for gene in self.settings.gene)

    @property
    def rule(self) -> StoppingRule:
        """How many samples a string gets."""
        part = self.settings
        return StoppingRule(part.minimum_samples, part.tolerance, part.maximum_samples)

    @property
    def plain(self) -> bool:
        """Whether the cost is flatness alone, as in the paper."""
        weights = self.settings.weights
        return (weights.flatness, weights.removal_rate, weights.abrasive_mass) == (1.0, 0.0, 0.0)

    @property
    def cost_name(self) -> str:
        """What the cost is called in tables and figures."""
        return "Π" if self.plain else "cost"

    def case_of(self, string: Sequence[float]) -> Case:
        """The case that a string stands for; raises CaseError where there is none."""
        whole = zip(self.keys, self.integer, string, strict=True)
        return self.case.replaced(
            {key: int(gene) if integer else float(gene) for key, integer, gene in whole}
        )

    def as_it_stands(self) -> String:
        """The string of the case's own values, which may lie outside the bounds."""
        values = [value_of(self.case, key) for key in self.keys]
        low = self.bounds[:, 0]
        return tuple(float(a if value is None else value) for value, a in zip(values, low, strict=True))


def evaluate_sample(problem: Problem, string: String, k: int) -> Sample:
    """Run sample k of a string, here; it has the seed of sample k of the design case, whatever the string.

    What makes this string impossible, such as particles that find no place, is returned as its `error`.
    """
    from reference.simulation import SimulationError, simulate

    begin = time.perf_counter()
    try:
        run = simulate(sample_case(problem.case_of(string), k))
    except (CaseError, SimulationError) as problem_met:
        reason = " ".join(str(problem_met).removeprefix("case: ").split())
        return Sample(math.nan, math.nan, math.nan, math.nan, time.perf_counter() - begin, reason)
    assert run.surface is not None
    assert run.surface_initial is not None
    assert run.case.removal is not None
    asperities = float(run.surface_initial.z.mean())  # above the base plane, m
    taken = asperities - float(run.surface.z.mean())
    flatness = float(run.history["flatness"].iloc[-1])
    mass, usual = abrasive_mass(run.case), abrasive_mass(problem.case)
    weights = problem.settings.weights
    cost = weights.flatness * flatness
    if not problem.plain:
        cost += weights.removal_rate * (1.0 - taken / asperities) + weights.abrasive_mass * mass / usual
    process_time = run.case.removal.acceleration * run.case.case.duration
    seconds = time.perf_counter() - begin
    return Sample(cost, flatness, taken / process_time, mass, seconds)


def abrasive_mass(case: Case) -> float:
    """Expected mass of the abrasives of a case, kg; with Section 4's diameters d^3 averages d̄^3 (1 + δ^2).

    >>> from reference import load_case
    >>> round(abrasive_mass(load_case("polish")) / (73 * 3950 * math.pi / 6 * 0.9e-6**3), 6)
    1.01
    """
    part, material = case.particles, case.material
    if part is None:
        return sum(material[p.material].density * math.pi / 6.0 * p.diameter**3 for p in case.particle)
    mean_cube = part.mean_diameter**3 * (1.0 + part.diameter_spread**2)
    return part.count * material[part.material].density * math.pi / 6.0 * mean_cube


def paper_columns(problem: Problem, string: Sequence[float]) -> dict[str, Any]:
    """The four columns of the paper's Table 1, and then the other genes under their keys."""
    genes = dict(zip(problem.keys, string, strict=True))
    names = dict(zip(PAPER_KEYS, ("V_pad", "N", "mean_diameter", "diameter_spread"), strict=True))
    columns: dict[str, Any] = {}
    for key, name in names.items():
        section = getattr(problem.case, key.split(".")[0])
        columns[name] = genes.get(key, None if section is None else value_of(problem.case, key))
    columns |= {key: value for key, value in genes.items() if key not in names}
    whole = {"N", *(key for key, integer in zip(problem.keys, problem.integer, strict=True) if integer)}
    return {name: int(v) if name in whole and v is not None else v for name, v in columns.items()}
