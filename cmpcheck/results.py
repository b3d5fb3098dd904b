"""What the suite found: plain records between the tasks, which fill them, and the report, which shows them.

No computing and no formatting here.  All numbers are SI floats.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

STATUSES = ("agree", "disagree", "not_tested", "error")
COMPONENTS = "components"  # name of the result that is of no case


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


@dataclass(frozen=True)
class MeanCurve:
    """A mean over samples and its confidence band, at the times of an `EnsembleCurve`."""

    mean: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]


@dataclass(frozen=True)
class EnsembleCurve:
    """One quantity of paired samples over time: both engines, and the paired difference beside its margin."""

    quantity: str
    unit: str
    times: tuple[float, ...]  # s
    reference: MeanCurve  # 95 %
    measured: MeanCurve  # 95 %
    difference: MeanCurve  # measured minus reference, 90 %: the interval that is held against the margin
    margin: float  # in `unit`
    margin_rule: str  # where the margin comes from, e.g. "5 % of the reference's final mean"


@dataclass(frozen=True)
class Planning:
    """How many pairs one quantity needs, and what those that were run can tell.

    Spreads, margin and difference are in the quantity's unit, or shares of the reference's mean.
    """

    engine: str  # the reference: its own step size, the same quantity at two of them
    quantity: str
    relative: bool
    margin: float
    pilot: float  # standard deviation of the paired differences in the pilot; nan without one
    assumed: float  # in the calculation
    source: str  # why so much
    needed: int  # pairs, for a power of 90 %
    pairs: int  # that were run
    power: float  # of showing equivalence with these, if there is no difference
    detectable: float  # true difference that is told from zero with a power of 80 %
    found: float  # standard deviation of these pairs
    largest: float  # difference of a single one of them


@dataclass(frozen=True)
class PartingImpact:
    """The first impact of its kind at which two engines part; nan for what an engine does not have."""

    time: float  # s
    particle: int
    partner: int  # -1 but for pairs
    reference_speed: float  # of approach, m/s
    measured_speed: float
    duration: float  # of the impact in the model, s
    contact_times: tuple[float, float]  # over which reference and other engine resolved it, s
    neighbours: tuple[tuple[int, float], ...]  # other particles and the gaps to them in m, nearest first
    surface_gap: float  # m, of the nearer of a pair
    pad_gap: float  # m, likewise
    crowded: bool  # a neighbour, the surface or the pad that is no part of it touches at the same time
    nodes: tuple[int, int]  # of the surface, that reference and other engine lower; -1 where none is
    apart: float  # between the points of contact, m


@dataclass(frozen=True)
class KindMatch:
    """The impacts of one kind, matched."""

    kind: str  # surface | pair | pad
    impacts: tuple[int, int]  # recorded by the reference and by the other engine
    matched: int  # of the whole run
    before: int  # matched before the parting
    undecided: int  # before it, in one engine only, too near the speed from which impacts are recorded
    parting: PartingImpact | None


@dataclass(frozen=True)
class LedgerMatch:
    """The contact ledgers of two runs that start from the same arrays, matched impact by impact."""

    window: float  # s, within which two impacts may be the same
    explained: float  # m/s, difference of approach speed that late contacts explain
    touching: float  # m, gap that counts as contact
    kinds: tuple[KindMatch, ...]


@dataclass(frozen=True)
class Ensemble:
    """Two engines on samples that start from the same arrays: what part 3 of the report shows."""

    case: str
    variant: str
    engine: str
    form: str  # of the contacts with surface and pad: impulse | soft
    pairs: int
    curves: tuple[EnsembleCurve, ...]
    planning: tuple[Planning, ...]
    ledger: LedgerMatch | None = None
    remarks: tuple[str, ...] = ()


@dataclass
class Outcome:
    """What one task of the suite found: one variant of a case in every engine."""

    comparisons: list[Comparison] = field(default_factory=list)
    convergences: list[Convergence] = field(default_factory=list)
    traces: list[Trace] = field(default_factory=list)
    ensembles: list[Ensemble] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    seconds: float = 0.0
    lost: bool = False  # the process that ran it died


@dataclass(frozen=True)
class Illustration:
    """A picture for the page that is no plot of a comparison: one of the paper's figures, redrawn."""

    title: str
    caption: str
    png: str  # base64


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
    ensembles: list[Ensemble] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)  # findings about the case, shown with other engines
    charts: list[Chart] = field(default_factory=list)  # likewise
    lost: bool = False  # it was one task, and the process that ran it died


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
    illustrations: list[Illustration] = field(default_factory=list)
    studies: list[StudyResult] = field(default_factory=list)

    @property
    def comparisons(self) -> list[Comparison]:
        """Every row of every case, in order."""
        return [row for case in self.cases for row in case.comparisons]
