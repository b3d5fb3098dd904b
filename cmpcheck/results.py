"""What the suite found: plain records between `suite.py`, which fills them, and the report, which shows them.

No computing and no formatting here.  All numbers are SI floats.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

STATUSES = ("agree", "disagree", "not_tested", "error")


@dataclass(frozen=True)
class EngineInfo:
    """One engine as it was found on this machine."""

    name: str
    version: str
    available: bool
    reason: str = ""  # why it is not available, and the command that would install it


@dataclass(frozen=True)
class Comparison:
    """Two values of one quantity side by side, and the verdict on them (a row of report.json)."""

    case: str
    variant: str
    engine: str
    quantity: str
    equations: str  # of the paper, e.g. "9, 12"
    unit: str
    reference: float
    measured: float
    error: float  # |measured - reference|, in `unit`
    tolerance: float  # derived, in `unit`
    kind: str  # rounding | discretisation | statistical | precision
    reason: str  # how the tolerance was derived, or why there is no verdict
    status: str  # one of STATUSES
    known_departure: str = ""
    order: float | None = None  # observed order of convergence where there is one


@dataclass(frozen=True)
class Convergence:
    """A quantity on successively refined levels, coarsest first, and what it tends to."""

    case: str
    variant: str
    engine: str
    quantity: str
    unit: str
    parameter: str  # "time step" or "contact duration"
    levels: tuple[float, ...]  # s
    values: tuple[float, ...]  # mean over the phases
    spreads: tuple[float, ...]  # half range over the phases
    extrapolated: float
    uncertainty: float
    order: float | None
    target: float  # the exact or reference value


@dataclass(frozen=True)
class Trace:
    """A curve to be drawn: one observable of one engine over time."""

    case: str
    variant: str
    engine: str
    label: str  # e.g. "height of particle 0", "distance to the reference", "normal impulse"
    unit: str
    times: tuple[float, ...]  # s
    values: tuple[float, ...]
    style: str = "line"  # line | points (impacts)


@dataclass
class CaseResult:
    """All that was found for one case."""

    name: str
    title: str
    sentence: str  # the physics in one sentence
    equations: str
    comparisons: list[Comparison] = field(default_factory=list)
    convergences: list[Convergence] = field(default_factory=list)
    traces: list[Trace] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0


class Estimate(NamedTuple):
    """A mean over samples and its standard error, in the unit of its column."""

    value: float
    standard_error: float


class Column(NamedTuple):
    """What stands in a column of a study's table, or along an axis of its chart."""

    name: str
    unit: str = "1"


@dataclass(frozen=True)
class Curve:
    """One curve of a chart, with a band or error bars where `lower` and `upper` are given."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    lower: tuple[float, ...] = ()
    upper: tuple[float, ...] = ()
    style: str = "line"  # line | points


@dataclass(frozen=True)
class Chart:
    """Curves over a common axis."""

    caption: str
    x: Column
    y: Column
    curves: tuple[Curve, ...]
    logarithmic: bool = False  # both axes


@dataclass(frozen=True)
class Table:
    """Rows of text, numbers, or means with their standard errors."""

    caption: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[str | float | Estimate, ...], ...]


@dataclass(frozen=True)
class StudyResult:
    """What one study found."""

    name: str
    title: str
    varied: str  # what was varied, what was held, how it was measured
    samples: str  # which case, seed and samples
    tables: tuple[Table, ...]
    sentence: str  # what a user may rely on, made from the numbers
    charts: tuple[Chart, ...] = ()
    error: str = ""  # why nothing was found
    seconds: float = 0.0


@dataclass
class SuiteResult:
    """One run of `cmpcheck compare`."""

    profile: str
    engines: list[EngineInfo]
    cases: list[CaseResult]
    provenance: dict[str, Any]
    seconds: float = 0.0
    studies: list[StudyResult] = field(default_factory=list)

    @property
    def comparisons(self) -> list[Comparison]:
        """Every row of every case, in order."""
        return [row for case in self.cases for row in case.comparisons]
