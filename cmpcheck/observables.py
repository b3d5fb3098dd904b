"""What is observed of a polishing run over time, and its mean over samples that are paired by seed.

Verdicts on it are `ensembles.py`, the statistics `statistics/`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cmpcheck.results import EnsembleCurve, MeanCurve
from cmpcheck.statistics import Band, difference_band, mean_band, relative_differences
from reference.case import Case
from reference.recording import Run

FLATNESS_MARGIN = 0.02  # of Pi, unless the case sets [engine.NAME] margin_flatness
RELATIVE_MARGIN = 0.05  # of counts and volumes, unless the case sets margin_relative
TIMES = 5  # at which flatness is judged, equally spaced; the other quantities at the end


class Observable(NamedTuple):
    """A quantity that every polishing run has at every output time."""

    quantity: str
    equations: str
    unit: str
    relative: bool  # its margin is a share of the reference's mean at the end
    column: str  # of the contact ledger, summed over removals; "" for their number


FLATNESS = Observable("flatness", "44", "1", False, "")
OBSERVABLES = (
    FLATNESS,
    Observable("removals", "32-36", "1", True, ""),
    Observable("depth_sum", "32-36", "m", True, "depth"),
    Observable("removed_volume", "32-36", "m3", True, "removed_volume"),
)


def judged_frames(outputs: int) -> list[int]:
    """Indices of the output times at which flatness is judged, equally spaced up to the end."""
    return [round(k * (outputs - 1) / TIMES) for k in range(1, TIMES + 1)]


def over_time(run: Run, observable: Observable) -> np.ndarray:
    """The quantity at the run's output times, (T,): flatness, or what removals have added up to.

    Removals count from the time of their row in the contact ledger.
    """
    if observable is FLATNESS:
        return run.history["flatness"].to_numpy(float)
    hits = run.contacts[run.contacts["removed_volume"] > 0.0].sort_values("time", kind="stable")
    amounts = hits[observable.column].to_numpy(float) if observable.column else np.ones(len(hits))
    # a hit that begins at an output time acts in the step after it
    done_by = np.searchsorted(hits["time"].to_numpy(), run.times, side="left")
    done_by[-1] = len(hits)
    return np.concatenate([[0.0], np.cumsum(amounts)])[done_by]


@dataclass(frozen=True)
class Pairs:
    """One observable of the samples of two engines, row k of both from the same initial state."""

    observable: Observable
    margin: float  # absolute, or a share of the reference's mean at the end
    times: np.ndarray  # (T,), s
    reference: np.ndarray  # (n, T)
    measured: np.ndarray  # (n, T)

    @property
    def scale(self) -> float:
        """What turns the margin into the unit."""
        return abs(float(self.reference[:, -1].mean())) if self.observable.relative else 1.0

    @property
    def frames(self) -> list[int]:
        """Indices of the output times at which the quantity is judged."""
        outputs = len(self.times)
        return [outputs - 1] if self.observable.relative else judged_frames(outputs)

    def differences(self, frame: int) -> np.ndarray:
        """Differences sample by sample, (n,), in the margin's measure."""
        a, b = self.measured[:, frame], self.reference[:, frame]
        return relative_differences(a, b) if self.observable.relative else a - b

    @property
    def spread(self) -> float:
        """Standard deviation of the differences, the largest of the times at which they are judged."""
        return max(float(self.differences(frame).std(ddof=1)) for frame in self.frames)

    def curve(self) -> EnsembleCurve:
        """Mean and 95 % band of each engine, and the paired difference with its 90 % band."""
        share = f"{100 * self.margin:g} % of the reference's mean at the end"
        return EnsembleCurve(
            quantity=self.observable.quantity,
            unit=self.observable.unit,
            times=tuple(map(float, self.times)),
            reference=_record(mean_band(self.reference)),
            measured=_record(mean_band(self.measured)),
            difference=_record(difference_band(self.measured, self.reference)),
            margin=self.margin * self.scale,
            margin_rule=share if self.observable.relative else f"{self.margin:g}, absolute",
        )


def margins(case: Case, engine: str, share: float = 1.0) -> dict[str, float]:
    """A `share` of the margins of `[engine.NAME]`, by quantity: of flatness absolute, of others relative.

    Raises CaseError for an entry that is no positive number.
    """
    table, sizes = case.engine.get(engine, {}), []
    for key, default in (("margin_flatness", FLATNESS_MARGIN), ("margin_relative", RELATIVE_MARGIN)):
        path = f"engine.{engine}.{key}"
        sizes.append(share * case.quantity(table.get(key, default), "", path))
        if not sizes[-1] > 0.0:
            raise case.error(path, table[key], "allowed: > 0")
    flat, relative = sizes
    return {o.quantity: relative if o.relative else flat for o in OBSERVABLES}


def pair_up(limits: dict[str, float], ours: list[Run], theirs: list[Run]) -> list[Pairs]:
    """Every observable of the samples of two engines, with its margin."""
    return [
        Pairs(
            o,
            limits[o.quantity],
            ours[0].times,
            *(np.array([over_time(run, o) for run in runs]) for runs in (ours, theirs)),
        )
        for o in OBSERVABLES
    ]


def _record(band: Band) -> MeanCurve:
    return MeanCurve(*(tuple(map(float, values)) for values in (band.mean, band.lower, band.upper)))
