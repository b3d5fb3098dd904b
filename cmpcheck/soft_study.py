"""What soft contacts make of polishing: ensembles in the fix's `soft` form, against contact durations.

Where every impact is a single one, t_c -> 0 has to lead to the reference; where a particle has several
contacts at once it need not, and `cmpcheck/three_bodies.py` shows why.  The `impulse` form is judged in
`ensembles.py`.  Every level has the same samples as the reference, which runs at a step that is converged.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.observables import margins
from cmpcheck.results import Comparison, Convergence
from cmpcheck.statistics import Equivalence, control_family, paired_difference, relative_differences
from cmpcheck.study import contact_settings
from reference.case import Case
from reference.ensemble import sample_case
from reference.process import build_setup
from reference.recording import Run

FORM = "soft"
PAIRS = {"quick": 9, "full": 24}
REFERENCE_STEP = 1e-9  # s; polish_pair is converged in the time step below about 2 ns


class Observable(NamedTuple):
    """One number of a run."""

    quantity: str
    equations: str
    unit: str


OBSERVABLES = (
    Observable("flattening", "44", "1"),  # 1 - Pi(T)
    Observable("removals", "32-36", "1"),
    Observable("depth_sum", "35", "m"),
    Observable("removed_volume", "36", "m3"),
)


class Durations(NamedTuple):
    """Contact durations of one level, s."""

    surface: float  # and pad
    pairs: float

    @property
    def label(self) -> str:
        """In words, for rows and tables."""
        surface = f"t_c = {self.surface * 1e9:.3g} ns"
        return surface if self.pairs == self.surface else f"{surface}, of pairs {self.pairs * 1e9:.3g} ns"


@dataclass(frozen=True)
class SoftEnsemble:
    """The same samples in the reference and at several contact durations of another engine."""

    case: Case
    engine: str
    levels: tuple[Durations, ...]
    reference: np.ndarray  # (n, observables)
    measured: np.ndarray  # (levels, n, observables)

    def differences(self, level: int, k: int) -> np.ndarray:
        """Relative differences (n,) of observable k, sample by sample, in units of the reference's mean."""
        return relative_differences(self.measured[level, :, k], self.reference[:, k])

    def table(self) -> pd.DataFrame:
        """Relative difference from the reference and its standard error, by level and observable."""
        rows = []
        for j, level in enumerate(self.levels):
            row = {"surface_duration": level.surface, "pair_duration": level.pairs}
            row |= {"ratio": level.surface / level.pairs, "n": self.reference.shape[0]}
            for k, observable in enumerate(OBSERVABLES):
                mean, error = _mean(self.differences(j, k))
                row |= {observable.quantity: mean, f"{observable.quantity}_standard_error": error}
            rows.append(row)
        return pd.DataFrame(rows)

    @property
    def equal(self) -> list[int]:
        """The levels at which both durations are equal, coarsest first."""
        found = [j for j, level in enumerate(self.levels) if level.pairs == level.surface]
        return sorted(found, key=lambda j: -self.levels[j].surface)


def durations(case: Case, engine: str, profile: str) -> tuple[Durations, ...]:
    """The levels of a case: three of t_c, and where particles collide two ratios of surface to pairs.

    Single impacts begin at the case's own t_c, which is halved twice; simultaneous ones end in it, and the
    quick profile has the coarsest of them only.
    """
    own, _ = contact_settings(case, engine)
    if not case.contact.pairs:
        return tuple(Durations(t, t) for t in (own, own / 2, own / 4))
    if profile == "quick":
        return (Durations(4 * own, 4 * own),)
    return (
        *(Durations(t, t) for t in (4 * own, 2 * own, own)),
        Durations(4 * own, own),
        Durations(own, 4 * own),
    )


def run_soft(
    case: Case, engines: tuple[Engine, Engine], levels: Sequence[Durations], samples: int
) -> SoftEnsemble:
    """Run the samples in the reference, the first engine, and at every level in the other one, softly.

    Raises RuntimeError (EngineError) when a run fails.
    """
    steps = contact_settings(case, engines[1].name)[1]
    reference, measured = [], []
    for k in range(samples):
        setup = build_setup(sample_case(case, k))
        reference.append(_observe(engines[0].run(setup, Resolution(min(REFERENCE_STEP, setup.time_step)))))
        row = []
        for level in levels:
            step = min(level) / steps
            resolution = Resolution(step, level.surface, FORM, level.pairs / level.surface)
            row.append(_observe(engines[1].run(setup, resolution)))
        measured.append(row)
    numbers = np.array(measured).transpose(1, 0, 2)
    return SoftEnsemble(case, engines[1].name, tuple(levels), np.array(reference), numbers)


def _observe(run: Run) -> list[float]:
    """The observables of one run, in their order."""
    removing = run.contacts[run.contacts["removed_volume"] > 0.0]
    flattening = 1.0 - float(run.history["flatness"].iloc[-1])
    return [
        flattening,
        float(len(removing)),
        float(removing["depth"].sum()),
        float(removing["removed_volume"].sum()),
    ]


def compare_soft(
    case: Case, engines: tuple[Engine, Engine], profile: str
) -> tuple[list[Comparison], list[Convergence], list[str]]:
    """Judge soft contacts in a polishing case: rows, what they rest on, and a sentence.

    Single impacts are extrapolated to t_c = 0, sample by sample; simultaneous ones are judged at each level.
    """
    name = engines[1].name
    ensemble = run_soft(case, engines, durations(case, name, profile), PAIRS[profile])
    return judge_soft(ensemble)


def judge_soft(ensemble: SoftEnsemble) -> tuple[list[Comparison], list[Convergence], list[str]]:
    """Rows, convergences and a sentence of an ensemble that has been run."""
    levels = ensemble.levels
    if ensemble.case.contact.pairs:
        rows = [row for j in range(len(levels)) for row in _rows(ensemble, levels[j].label, _at(ensemble, j))]
    else:
        rows = _rows(ensemble, "t_c -> 0", _extrapolated(ensemble), _orders(ensemble))
    records = [_convergence(ensemble, k) for k in range(len(OBSERVABLES))] if len(ensemble.equal) > 1 else []
    return rows, records, [_sentence(ensemble)]


def _at(ensemble: SoftEnsemble, level: int) -> list[np.ndarray]:
    return [ensemble.differences(level, k) for k in range(len(OBSERVABLES))]


def _extrapolated(ensemble: SoftEnsemble) -> list[np.ndarray]:
    """Richardson's extrapolation at first order, the contacts' own, of each sample's difference."""
    *_, coarse, fine = ensemble.equal
    a, b = (ensemble.levels[j].surface for j in (coarse, fine))
    return [
        (a * y - b * x) / (a - b) for x, y in zip(_at(ensemble, coarse), _at(ensemble, fine), strict=True)
    ]


def observed_order(ensemble: SoftEnsemble, k: int) -> tuple[float, float]:
    """The p of mean differences that fall as t_c^p over three levels halved, and its standard error.

    From the paired changes between levels; the error leaves out one sample at a time (jackknife).  NaN where
    the changes have no such order.
    """
    coarse, middle, fine = (ensemble.differences(j, k) for j in ensemble.equal[-3:])
    first, second = middle - coarse, fine - middle
    n = len(first)

    def order(a: np.ndarray, b: np.ndarray) -> float:
        ratio = a.mean() / b.mean() if b.mean() else math.nan
        return math.log2(ratio) if ratio > 0.0 else math.nan

    left_out = np.array([order(np.delete(first, i), np.delete(second, i)) for i in range(n)])
    error = math.sqrt((n - 1) / n * ((left_out - left_out.mean()) ** 2).sum())
    return order(first, second), error


def _orders(ensemble: SoftEnsemble) -> list[float | None]:
    found = [observed_order(ensemble, k)[0] for k in range(len(OBSERVABLES))]
    return [p if math.isfinite(p) else None for p in found]


def _margin(ensemble: SoftEnsemble, k: int) -> float:
    """The margin in parts of the reference's mean, fixed in the case; that of Pi is one of 1 - Pi too."""
    limits, quantity = margins(ensemble.case, ensemble.engine), OBSERVABLES[k].quantity
    if quantity == "flattening":
        return limits["flatness"] / float(ensemble.reference[:, k].mean())
    return limits[quantity]


def _rows(
    ensemble: SoftEnsemble,
    label: str,
    differences: list[np.ndarray],
    orders: Sequence[float | None] = (None,) * len(OBSERVABLES),
) -> list[Comparison]:
    margins = [_margin(ensemble, k) for k in range(len(OBSERVABLES))]
    verdicts = control_family([paired_difference(d, m) for d, m in zip(differences, margins, strict=True)])
    return [_row(ensemble, label, k, verdicts[k], orders[k]) for k in range(len(OBSERVABLES))]


def _row(ensemble: SoftEnsemble, label: str, k: int, verdict: Equivalence, order: float | None) -> Comparison:
    case, observable = ensemble.case, OBSERVABLES[k]
    scale = float(ensemble.reference[:, k].mean())
    reason = f"mean of {verdict.n} pairs, relative to the reference {verdict.mean:+.3g}, "
    reason += f"standard error {verdict.standard_error:.2g}; {verdict.reason}"
    return Comparison(
        case=case.name,
        variant=", ".join(part for part in (case.variant, FORM, label) if part),
        engine=ensemble.engine,
        quantity=observable.quantity,
        equations=observable.equations,
        unit=observable.unit,
        reference=scale,
        measured=scale * (1.0 + verdict.mean),
        error=abs(verdict.mean) * scale,
        tolerance=verdict.margin * scale,
        kind="statistical",
        reason=reason,
        status=verdict.status,
        order=order,
    )


def _convergence(ensemble: SoftEnsemble, k: int) -> Convergence:
    """The observable's mean on the levels of equal durations, with standard errors of paired differences."""
    levels, scale = ensemble.equal, float(ensemble.reference[:, k].mean())
    means, errors = zip(*(_mean(ensemble.differences(j, k)) for j in levels), strict=True)
    limit, uncertainty = _mean(_extrapolated(ensemble)[k])
    order = observed_order(ensemble, k)[0] if len(levels) > 2 else math.nan
    return Convergence(
        case=ensemble.case.name,
        variant=", ".join(part for part in (ensemble.case.variant, FORM) if part),
        engine=ensemble.engine,
        quantity=OBSERVABLES[k].quantity,
        unit=OBSERVABLES[k].unit,
        parameter="contact duration",
        levels=tuple(ensemble.levels[j].surface for j in levels),
        values=tuple(scale * (1.0 + mean) for mean in means),
        spreads=tuple(scale * error for error in errors),
        extrapolated=scale * (1.0 + limit),
        uncertainty=2.0 * scale * uncertainty,
        order=order if math.isfinite(order) else None,
        target=scale,
    )


def _mean(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard error."""
    return float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values)))


def _sentence(ensemble: SoftEnsemble) -> str:
    """What was found, with numbers."""
    n, parts = ensemble.reference.shape[0], []
    for j, level in enumerate(ensemble.levels):
        flattening, removals = (_mean(ensemble.differences(j, k)) for k in (0, 1))
        parts.append(
            f"{level.label}: 1 - Pi {100 * flattening[0]:+.1f} +- {100 * flattening[1]:.1f} %, "
            f"removals {100 * removals[0]:+.1f} +- {100 * removals[1]:.1f} %"
        )
    what = "at once" if ensemble.case.contact.pairs else "that are single"
    return f"Soft contacts {what}, relative to the reference, {n} samples: {'; '.join(parts)}."
