"""The section [optimise] of a case file: which of its numbers are varied, within which bounds, and how long.

A gene is one number of the case, named by its dotted key.  Its bounds are read by setting them in the case,
so that they have the dimension, the range and the errors of that key.  The search itself is `genetic.py`,
the cost of a string `cmpcheck/optimise`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, StrictInt

from reference.case_sections import NotNegative, Section
from reference.toml_source import MISSING, CaseError, Refusal, nearest

if TYPE_CHECKING:
    from reference.case import Case

FIXED = (
    "case",
    "cost",
    "engine",
    "numerics",
    "optimise",
)  # what is computed and how: no parameters of a process


class Gene(Section):
    """[[optimise.gene]]: one number of the case that is varied."""

    key: str  # dotted, such as pad.speed
    low: Any  # in any unit of that key; SI once the case is loaded
    high: Any

    @property
    def integer(self) -> bool:
        """Whether the key takes whole numbers only."""
        return isinstance(self.low, int)


class Weights(Section):
    """[optimise.weights]: cost = flatness Pi + removal_rate (1 - R/R_1) + abrasive_mass M/M_0.

    R is the removal rate and R_1 the one that takes all asperities off within the run; M is the mass of the
    abrasives and M_0 that of the case as it stands.  So each term is about 1 for a process without any merit.
    """

    flatness: NotNegative = 1.0
    removal_rate: NotNegative = 0.0
    abrasive_mass: NotNegative = 0.0


class Optimise(Section):
    """[optimise]: genes, the genetic algorithm, and ensembles. Paper: Sections 3.2 and 4.1."""

    population: Annotated[StrictInt, Field(ge=4)] = 20  # S
    parents: Annotated[StrictInt, Field(ge=2)] = 4  # K
    generations: Annotated[StrictInt, Field(ge=1)] = 10
    minimum_samples: Annotated[StrictInt, Field(ge=2)] = 15
    maximum_samples: Annotated[StrictInt, Field(ge=2)] = 200
    tolerance: NotNegative = 0.01  # of the mean cost, absolute
    distribution_samples: Annotated[StrictInt, Field(ge=2)] = 60  # of each distribution in Fig. 7
    weights: Weights = Weights()
    gene: tuple[Gene, ...] = ()


def resolve(case: Case) -> Case:
    """The case with the bounds of its genes in SI; raises Refusal for a section that makes no sense."""
    part = case.optimise
    if part is None:
        return case
    _check_sizes(part)
    _check_goal(case, part)
    genes = tuple(_resolved(case, k, gene) for k, gene in enumerate(part.gene))
    return case.model_copy(update={"optimise": part.model_copy(update={"gene": genes})})


def _check_sizes(part: Optimise) -> None:
    if part.parents % 2 or 2 * part.parents > part.population:
        allowed = f"allowed: even, from 2 to half the population of {part.population}"
        raise Refusal(("optimise", "parents"), part.parents, allowed)
    if part.maximum_samples < part.minimum_samples:
        allowed = f"allowed: >= minimum_samples, {part.minimum_samples}"
        raise Refusal(("optimise", "maximum_samples"), part.maximum_samples, allowed)
    if not part.gene:
        raise Refusal(("optimise", "gene"), MISSING, "required, at least one [[optimise.gene]], but missing")
    for k, gene in enumerate(part.gene):
        if gene.key in [other.key for other in part.gene[:k]]:
            raise Refusal(("optimise", "gene", k, "key"), gene.key, "used twice; allowed: each key once")


def _check_goal(case: Case, part: Optimise) -> None:
    if case.surface.kind != "asperities" or case.removal is None:
        raise Refusal(
            ("optimise",), MISSING, "needs surface.kind = 'asperities' and [removal]: Eq (44) is its cost"
        )
    if not any((part.weights.flatness, part.weights.removal_rate, part.weights.abrasive_mass)):
        raise Refusal(("optimise", "weights"), MISSING, "all zero; allowed: at least one above zero")


def _resolved(case: Case, k: int, gene: Gene) -> Gene:
    """The gene with its bounds in SI."""
    _require_number(case, k, gene.key)
    low, high = (_bound(case, k, gene, end) for end in ("low", "high"))
    if not low < high:
        at = ("optimise", "gene", k, "high")
        raise Refusal(at, gene.high, f"allowed: > low, {low:g}, for the bounds of {gene.key}")
    return gene.model_copy(update={"low": low, "high": high})


def _bound(case: Case, k: int, gene: Gene, end: str) -> float | int:
    """One bound as the key takes it."""
    written = getattr(gene, end)
    try:
        found = value_of(case.replaced({gene.key: written}), gene.key)
    except CaseError as problem:
        at = ("optimise", "gene", k, end)
        raise Refusal(at, written, str(problem).removeprefix("case: ")) from None
    assert isinstance(found, float | int)
    return found


def _require_number(case: Case, k: int, key: str) -> None:
    """Refuse a key that is not a number of this case."""
    at, parts = ("optimise", "gene", k, "key"), key.split(".")
    sections = sorted(
        name for name in type(case).model_fields if isinstance(getattr(case, name), Section | Mapping)
    )
    allowed = [name for name in sections if name not in FIXED]
    if parts[0] not in allowed:
        raise Refusal(at, key, f"no section of this case that may vary; {nearest(parts[0], allowed)}")
    here: Any = getattr(case, parts[0])
    for n, part in enumerate(parts[1:], start=1):
        known = list(_members(here))
        if part not in known:
            what = f"{'.'.join(parts[:n])} has no such key; {nearest(part, known)}"
            raise Refusal(at, key, what)
        here = here[part] if isinstance(here, Mapping) else getattr(here, part)
    if here is not None and (isinstance(here, bool) or not isinstance(here, float | int)):
        raise Refusal(at, key, "not a number; allowed: keys of numbers, such as pad.speed or particles.count")


def _members(part: Any) -> Iterable[str]:
    if isinstance(part, Mapping):
        return part
    return type(part).model_fields if isinstance(part, Section) else ()


def value_of(case: Case, key: str) -> Any:
    """What a dotted key of a case holds.

    >>> from reference import load_case
    >>> value_of(load_case("polish"), "pad.speed")
    1.0
    """
    here: Any = case
    for part in key.split("."):
        here = here[part] if isinstance(here, Mapping) else getattr(here, part)
    return here
