"""What is timed, a `Way`, and what was measured of it over one surface at one size, a `Cell`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from statistics import median
from typing import NamedTuple

from benchmarks.outcome import Outcome, Timed
from reference.state import Setup


@dataclass(frozen=True)
class Way:
    """One way to run the shear, and how it is called in the results."""

    key: str  # the same for all numbers of ranks
    label: str
    run: Callable[[Setup], Timed]
    ranks: int = 1
    surfaces: tuple[str, ...] = ("flat", "asperities")
    missing: str = ""  # why it cannot be run here


def digits(value: float, count: int) -> str:
    """A number with so many significant digits, without an exponent where it is not very small.

    >>> digits(162.4, 2), digits(0.04823, 3)
    ('160', '0.0482')
    """
    return f"{float(f'{value:.{count}g}'):g}"


class Measurement(NamedTuple):
    """One run."""

    speed: float  # particle-steps per second
    step: float  # wall-clock time of one step of all particles, s
    pace: float  # simulated over wall-clock time
    outcome: Outcome
    busy: float  # cores that were busy just before it


@dataclass
class Cell:
    """All runs of one way over one surface at one size."""

    way: Way
    surface: str
    count: int  # particles
    triangles: int  # of the surface
    runs: list[Measurement] = field(default_factory=list)
    failure: str = ""

    def add(self, timed: Timed, end: Outcome, busy: float) -> None:
        """One run more."""
        step = timed.seconds / timed.steps
        self.runs.append(Measurement(self.count / step, step, timed.time_step / step, end, busy))

    @property
    def problem(self) -> str:
        """Why it has no speed although it could be run, "" if it has one."""
        return self.failure or next((run.outcome.problem for run in self.runs if run.outcome.problem), "")

    @property
    def measured(self) -> bool:
        """Whether it has a speed that may be believed."""
        return bool(self.runs) and not self.problem

    def middle(self, name: str) -> float:
        """Median over the runs of `speed`, `step` or `pace`."""
        return median(getattr(run, name) for run in self.runs)

    def extremes(self) -> tuple[float, float]:
        """Lowest and highest speed of all runs."""
        speeds = [run.speed for run in self.runs]
        return min(speeds), max(speeds)

    def __str__(self) -> str:
        what = f"{self.way.label}, {self.way.ranks} ranks, {self.surface}, N = {self.count}"
        if self.problem or not self.runs:
            return f"{what}: {self.problem or 'nothing yet'}"
        last = self.runs[-1]
        return f"{what}: {last.speed / 1e6:.3g} M particle-steps/s, {last.busy:.1f} cores busy before"
