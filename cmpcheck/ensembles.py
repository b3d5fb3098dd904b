"""Whether two engines polish alike: samples that start from the same arrays, compared by paired statistics.

Trajectories of a polishing case part early, so only ensembles can be compared (Sections 4 and 4.1).  The
statistics are `statistics/`, the seeds of the samples `reference/ensemble.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.results import Comparison, Trace
from cmpcheck.statistics import (
    Equivalence,
    control_family,
    mean_band,
    paired_difference,
    relative_differences,
)
from cmpcheck.study import contact_settings
from reference.case import Case
from reference.ensemble import sample_case
from reference.process import build_setup
from reference.recording import Run

PAIRS = {"quick": 9, "full": 24}  # fewer than 9 can never call one quantity of this family different
TIMES = 5  # at which flatness is compared, equally spaced
FLATNESS_MARGIN = 0.02  # of Pi, unless the case sets [engine.NAME] margin_flatness
RELATIVE_MARGIN = 0.05  # of counts and volumes, unless the case sets margin_relative
FORM = "impulse"  # simultaneous soft contacts have no unique outcome


@dataclass(frozen=True)
class Observable:
    """One number per sample, in both engines."""

    quantity: str
    place: str
    equations: str
    unit: str
    margin: float  # in the unit, or in parts of the reference's mean if relative
    relative: bool
    reference: np.ndarray  # (n,)
    measured: np.ndarray  # (n,)

    @property
    def differences(self) -> np.ndarray:
        """Differences sample by sample, in the margin's measure."""
        if self.relative:
            return relative_differences(self.measured, self.reference)
        return self.measured - self.reference

    @property
    def scale(self) -> float:
        """What turns the margin's measure into the unit."""
        return float(self.reference.mean()) if self.relative else 1.0


def compare_ensembles(
    case: Case, engines: tuple[Engine, Engine], profile: str
) -> tuple[list[Comparison], list[Trace]]:
    """Run the samples in both engines, the reference first, and judge every observable.

    Returns rows of kind `statistical`, whose tolerance is the margin, and the mean curves of flatness with
    their 95 % bands.  Raises EngineError (a RuntimeError) when a run fails.
    """
    runs = [_sample(case, engines, k) for k in range(PAIRS[profile])]
    ours, theirs = [pair[0] for pair in runs], [pair[1] for pair in runs]
    name = engines[1].name
    observables = _observables(case, name, ours, theirs)
    verdicts = control_family([paired_difference(o.differences, o.margin) for o in observables])
    rows = [_row(case, name, o, v) for o, v in zip(observables, verdicts, strict=True)]
    return rows, [*_traces(case, "reference", ours), *_traces(case, name, theirs)]


def _sample(case: Case, engines: tuple[Engine, Engine], k: int) -> tuple[Run, Run]:
    setup = build_setup(sample_case(case, k))
    duration, steps = contact_settings(case, engines[1].name)
    fine = Resolution(duration / steps, duration, FORM)
    return engines[0].run(setup, Resolution(setup.time_step)), engines[1].run(setup, fine)


def _observables(case: Case, engine: str, ours: list[Run], theirs: list[Run]) -> list[Observable]:
    """Flatness at several times, removals, sum of depths and removed volume at the end."""
    table = case.engine[engine]
    flat, relative = (
        case.quantity(table.get(key, default), "", f"engine.{engine}.{key}")
        for key, default in (("margin_flatness", FLATNESS_MARGIN), ("margin_relative", RELATIVE_MARGIN))
    )
    curves = [np.array([run.history["flatness"] for run in runs]) for runs in (ours, theirs)]
    times = ours[0].history["time"].to_numpy()
    found = []
    for k in range(1, TIMES + 1):
        frame = round(k * (len(times) - 1) / TIMES)
        place, values = f"at {times[frame] * 1e6:.3g} us", [curve[:, frame] for curve in curves]
        found.append(Observable("flatness", place, "44", "1", flat, False, *values))
    for quantity, unit, column in (
        ("removals", "1", None),
        ("depth_sum", "m", "depth"),
        ("removed_volume", "m3", "removed_volume"),
    ):
        values = [np.array([_total(run, column) for run in runs]) for runs in (ours, theirs)]
        found.append(Observable(quantity, "", "32-36", unit, relative, True, *values))
    return found


def _total(run: Run, column: str | None) -> float:
    removing = run.contacts[run.contacts["removed_volume"] > 0.0]
    return float(removing[column].sum()) if column else float(len(removing))


def _row(case: Case, engine: str, o: Observable, verdict: Equivalence) -> Comparison:
    n, spread = len(o.reference), verdict.standard_error * o.scale
    label = ", ".join(part for part in (case.variant, FORM, o.place) if part)
    return Comparison(
        case=case.name,
        variant=label,
        engine=engine,
        quantity=o.quantity,
        equations=o.equations,
        unit=o.unit,
        reference=float(o.reference.mean()),
        measured=float(o.measured.mean()),
        error=abs(verdict.mean) * o.scale,
        tolerance=o.margin * o.scale,
        kind="statistical",
        reason=f"mean of {n} pairs, standard error {spread:.2g}; {verdict.reason}",
        status=verdict.status,
    )


def _traces(case: Case, engine: str, runs: list[Run]) -> list[Trace]:
    """Mean flatness over time and its confidence band."""
    times = tuple(runs[0].history["time"])
    band = mean_band(np.array([run.history["flatness"] for run in runs]))
    curves = (
        ("flatness, mean", band.mean),
        ("flatness, 95 % band below", band.lower),
        ("flatness, 95 % band above", band.upper),
    )
    return [
        Trace(case.name, case.variant, engine, label, "1", times, tuple(map(float, values)))
        for label, values in curves
    ]
