"""From the levels of two studies to comparisons: value, uncertainty, error, tolerance, status, reason.

Extrapolation and its uncertainty are `convergence.py`; what is measured and expected, the judges.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cmpcheck.convergence import Extrapolation, add_corrections, agreement, exact, extrapolate
from cmpcheck.judges import Measured
from cmpcheck.results import Comparison, Convergence
from cmpcheck.study import Level, Study
from reference.case import Case

FORMAL_ORDER = 1.0  # of implicit Euler, and of contacts noticed up to one step late (Section 3.1)
ROUNDING_SHARE = 1e-9  # of the scale: a tolerance below it is called rounding

Key = tuple[str, str]


def measured_by_key(level: Level) -> dict[Key, Measured]:
    """What was measured on a level, by quantity and place."""
    return {(m.quantity, m.place): m for m in level.measured}


def limits(study: Study) -> dict[Key, Extrapolation]:
    """What every quantity tends to, as far as all levels have it; a second series adds its correction."""
    tables = {name: [measured_by_key(level) for level in levels] for name, levels in study.series.items()}
    shared = [
        key
        for key in measured_by_key(study.finest)
        if all(key in t for rows in tables.values() for t in rows)
    ]
    found = {key: _limit(study, tables, key) for key in shared}
    return {key: limit for key, limit in found.items() if limit is not None}


def _limit(study: Study, tables: dict[str, list[dict[Key, Measured]]], key: Key) -> Extrapolation | None:
    if not all(np.isfinite(t[key].values).all() for rows in tables.values() for t in rows):
        return None
    parts = [_extrapolate(name, study.series[name], [t[key] for t in rows]) for name, rows in tables.items()]
    return parts[0] if len(parts) == 1 else add_corrections(parts[0], parts[1])


def _extrapolate(parameter: str, levels: list[Level], measured: list[Measured]) -> Extrapolation:
    return extrapolate(
        [_size(parameter, level) for level in levels],
        [float(m.values.mean()) for m in measured],
        FORMAL_ORDER,
        [_half_range(m) for m in measured],
        phases=len(measured[0].values),
        scale=measured[0].scale,
    )


def _size(parameter: str, level: Level) -> float:
    resolution = level.resolution
    return resolution.contact_duration if parameter == "contact duration" else resolution.time_step


def _half_range(m: Measured) -> float:
    return float(np.ptp(m.values)) / 2.0 if len(m.values) > 1 else 0.0


def convergences(case: Case, study: Study, found: dict[Key, Extrapolation]) -> list[Convergence]:
    """The levels behind every limit that had something to converge, for the plots."""
    parameter, levels = next(iter(study.series.items()))
    records = []
    for key, limit in found.items():
        measured = [measured_by_key(level)[key] for level in levels]
        if measured[0].rounding > 0.0 or limit.uncertainty <= ROUNDING_SHARE * measured[0].scale:
            continue
        records.append(
            Convergence(
                case=case.name,
                variant=_label(case.variant, study.form, key[1]),
                engine=study.engine,
                quantity=key[0],
                unit=measured[0].unit,
                parameter=parameter,
                levels=tuple(_size(parameter, level) for level in levels),
                values=tuple(float(m.values.mean()) for m in measured),
                spreads=tuple(_half_range(m) for m in measured),
                extrapolated=limit.value,
                uncertainty=limit.uncertainty,
                order=limit.order,
                target=measured[0].expected,
            )
        )
    return records


def compare_study(case: Case, study: Study, reference: dict[Key, Extrapolation] | None) -> list[Comparison]:
    """The rows of one study: the reference's against exact values, others' against its limits."""
    found = limits(study)
    rows = []
    for key, finest in measured_by_key(study.finest).items():
        if reference is None and math.isnan(finest.expected):
            continue  # no exact value: only the other engines are judged, against the reference
        blank = Comparison(
            case=case.name,
            variant=_label(case.variant, study.form, finest.place),
            engine=study.engine,
            quantity=finest.quantity,
            equations=finest.equations,
            unit=finest.unit,
            reference=finest.expected,
            measured=float(finest.values.mean()),
            error=math.nan,
            tolerance=math.nan,
            kind="discretisation",
            reason="",
            status="error",
        )
        if finest.rounding > 0.0:
            rows.append(_judge_rounding(blank, study, key))
        elif key in found:
            target = exact(finest.expected, finest.scale)
            if finest.expected_error > 0.0:
                reason = "uncertainty of the value to compare with"
                target = replace(
                    target, uncertainty=target.uncertainty + finest.expected_error, reason=reason
                )
            if reference is not None and not finest.against_exact and key in reference:
                target = reference[key]
            rows.append(_judge(blank, finest, target, found[key]))
        else:
            finite = all(np.isfinite(m.values).all() for m in found_on(study, key))
            why = "not every level of refinement has this impact" if finite else "a value is not finite"
            rows.append(replace(blank, reason=why))
    return rows


def found_on(study: Study, key: Key) -> list[Measured]:
    """One quantity on every level that has it."""
    return [m for level in study.levels for m in level.measured if (m.quantity, m.place) == key]


def _judge_rounding(blank: Comparison, study: Study, key: Key) -> Comparison:
    """A quantity that no step size enters: the worst copy of all levels must be within rounding."""
    worst = max(found_on(study, key), key=lambda m: float(_deviation(m).max()) / m.rounding)
    value = float(worst.values[_deviation(worst).argmax()])
    error = abs(value - worst.expected)
    counted = worst.quantity in ("impacts", "removals")
    reason = (
        "a count, equal in every copy and on every level"
        if counted
        else "bound of the rounding error of the run"
    )
    status = "agree" if error <= worst.rounding else "disagree"
    return replace(
        blank,
        measured=value,
        error=error,
        tolerance=worst.rounding,
        kind="rounding",
        reason=reason,
        status=status,
    )


def _deviation(m: Measured) -> np.ndarray:
    """Distance of each copy from the expected value; what is not a number is infinitely far."""
    return np.nan_to_num(np.abs(m.values - m.expected), nan=np.inf)


def _judge(blank: Comparison, finest: Measured, target: Extrapolation, found: Extrapolation) -> Comparison:
    verdict = agreement(target, found, finest.scale, finest.limit)
    kind = "rounding" if verdict.tolerance <= ROUNDING_SHARE * finest.scale else "discretisation"
    return replace(
        blank,
        reference=target.value,
        measured=found.value,
        error=verdict.error,
        tolerance=verdict.tolerance,
        kind=kind,
        reason=verdict.reason,
        status=verdict.status,
        order=found.order,
    )


def _label(*parts: str) -> str:
    return ", ".join(part for part in parts if part)
