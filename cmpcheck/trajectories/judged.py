"""The verdict on a trajectory from a file: one resolution, no refinement, so that its tolerance is a bound.

What may be off without the physics being wrong, each bounded by itself and carried to every quantity by what
it changes there: the digits of the file; velocities by differences; and that a contact takes time, in steps.
The last needs the code's time step and contact duration.  Where they are not stated, or nothing bounds what
softness does, a difference is a disagreement beyond the detection limit only, and `not_tested` between it and
the digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmpcheck.convergence import ROUNDING, Agreement, Extrapolation, agreement, exact
from cmpcheck.judges import Judge, Measured, judge_of
from cmpcheck.judges.protocol import Impact
from cmpcheck.results import Comparison, Trace
from cmpcheck.trajectories.starts import EPS, Evidence, Options, evidence
from reference.case import Case
from reference.recording import Run
from reference.state import Setup

ENGINE = "trajectory"
DISTANCE, MASS = "trajectory_distance", "removed_mass"
DIGITS, DIFFERENCES, CONTACT, FORCES = "digits", "differences", "contact", "forces"
REASONS = {
    DIGITS: ("half a unit in the last place of the file's numbers", "more digits"),
    DIFFERENCES: ("velocities by differences of the positions", "velocities in the file, or more outputs"),
    CONTACT: ("a contact that takes its stated duration in stated steps", "shorter contacts, finer steps"),
    FORCES: ("half a time step of the largest force", "finer steps"),
}
SMALL = 1e-3  # of an impulse, to see whether a quantity depends on it

Key = tuple[str, str]


class Pushes(NamedTuple):
    """Bounds on what an impact may have pushed too much or too little, N s."""

    along: float  # the normal
    across: float


@dataclass(frozen=True)
class Shift:
    """A change of a run that one uncertain number makes."""

    kind: str
    run: Run


def compare_file(
    case: Case, setup: Setup, path: Path, options: Options
) -> tuple[list[Comparison], list[Trace], list[str], Run]:
    """Rows, curves, notes and the run of one trajectory.

    Raises CaseError when the file cannot be used.
    """
    found = evidence(path, setup, options, judge_of(setup))
    judge = judge_of(found.setup)  # of the file's own end
    rows = [_row(case, quantity, verdict, kind) for quantity, verdict, kind in verdicts(judge, found)]
    return rows, judge.traces(found.setup, found.run, ENGINE), found.notes, found.run


def verdicts(judge: Judge, found: Evidence) -> Iterator[tuple[Measured, Agreement, str]]:
    """Every quantity that the trajectory tells, the verdict on it, and the kind of its tolerance."""
    central = judge.measure_trajectory(found.setup, found.run)
    bounds = {key_of(m): {DIGITS: ROUNDING * m.scale + m.rounding} for m in central}
    for shift in _shifts(judge, found):
        _carry(bounds, central, judge.measure_trajectory(found.setup, shift.run), shift.kind)
    for m in central:
        more = _path_bounds(judge, found) if m.quantity == DISTANCE else {}
        more = _mass_bounds(judge, found, m.scale) if m.quantity == MASS else more
        for kind, bound in more.items():
            bounds[key_of(m)][kind] = bounds[key_of(m)].get(kind, 0.0) + bound
    vague, mass_bound = _unbounded(judge, found, central), _depend_on_mass(judge, found, central)
    for m in central:
        parts = bounds[key_of(m)]
        if key_of(m) in mass_bound:
            value = float(m.values[0])
            reason = "the file has no masses, and this case changes them; narrowed by a column mass"
            yield m, Agreement(abs(value - m.expected), math.nan, "not_tested", reason), "precision"
            continue
        margin = m.limit * m.scale + (_unseen(judge, found) if m.quantity == DISTANCE else 0.0)
        yield m, _verdict(m, parts, vague.get(key_of(m), ""), margin), _kind(parts, key_of(m) in vague)


def key_of(m: Measured) -> Key:
    """Quantity and place."""
    return m.quantity, m.place


def contact_error(impact: Impact, restitution: float, step: float, duration: float, place: float) -> Pushes:
    """How far the change of momentum may be off along the normal and across it, N s.

    A dashpot acts for one step more or less, and is strongest where e is lost at once: of a spring and
    dashpot, 2 ln(1/e) steps/n of the approach, n steps in a contact.  Verlet and leap-frog conserve
    v^2/2 + w^2 x^2/2 but for terms of (w dt)^2, which at first touch make at most (w dt)^2/8 = pi^2/(8 n^2).
    While the contact lasts, and for the step by which it is noticed late, the normal turns with the slip, and
    with an error `place` of the positions.  That mixes the two parts, and adds slip to the approach.
    """
    along = abs(float(impact.change @ impact.normal))
    across = float(np.linalg.norm(_across(impact)))
    turned = turn(impact, step, duration, place)
    share = _speed(impact) / impact.approach * turned
    if duration > 0.0:
        steps = duration / step if step > 0.0 else math.inf
        loss = 2.0 * -math.log(restitution) / steps if restitution > 0.0 else math.inf
        share += (loss + math.pi**2 / 8.0 / steps**2) / (1.0 + restitution)
    return Pushes(along * share + across * turned, across * share + along * turned)


def turn(impact: Impact, step: float, duration: float, place: float) -> float:
    """Angle by which the normal may be off, see `contact_error`."""
    return impact.turning * (_speed(impact) * (duration + step) + 2.0 * place)


def _speed(impact: Impact) -> float:
    return float(np.linalg.norm(impact.slip))


def _across(impact: Impact) -> np.ndarray:
    return impact.change - (impact.change @ impact.normal) * impact.normal


def _shifts(judge: Judge, found: Evidence) -> Iterator[Shift]:
    """The runs that one number less certain than it looks would make."""
    run = found.run
    frames = sorted({0, (len(run.times) - 1) // 2, len(run.times) - 1})
    kind = DIFFERENCES if found.differences else DIGITS
    for index in np.ndindex(len(frames), *run.velocities.shape[1:]):
        at = (frames[index[0]], *index[1:])
        velocities = run.velocities.copy()
        velocities[at] += found.velocity_error[at]
        yield Shift(kind, replace(run, velocities=velocities))
    for p, bound in enumerate(found.mass_error):
        for frame in (0, -1):
            if bound > 0.0:
                masses = run.masses.copy()
                masses[frame, p] += bound
                yield Shift(DIGITS, replace(run, masses=masses))
    step, duration = found.time_step, found.contact_duration
    for impact in judge.impacts() or []:
        e, place = found.setup.model.restitution, found.position_error
        if step is not None and duration is not None:
            yield from _pushed(found, impact, CONTACT, *contact_error(impact, e, step, duration, place))
        else:
            yield from _pushed(found, impact, DIGITS, *contact_error(impact, e, 0.0, 0.0, place))
    if step is not None and judge.largest_force() > 0.0:
        bound = 0.5 * step * judge.largest_force()
        for p, axis in np.ndindex(run.velocities.shape[1:]):
            velocities = run.velocities.copy()
            velocities[1:, p, axis] += bound
            yield Shift(FORCES, replace(run, velocities=velocities))


def _pushed(found: Evidence, impact: Impact, kind: str, along: float, across: float) -> Iterator[Shift]:
    """The runs in which an impact has pushed otherwise, by `along` the normal or `across` it, N s."""
    for amount, direction in ((along, impact.normal), (across, impact.slip)):
        length = float(np.linalg.norm(direction))
        if amount == 0.0 or length == 0.0:
            continue
        velocities = found.run.velocities.copy()
        after = found.run.times > impact.time
        for sign, p in zip((1.0, -1.0), impact.particles, strict=False):
            velocities[after, p] += sign * amount / found.run.masses[-1, p] * direction / length
        yield Shift(kind, replace(found.run, velocities=velocities))


def _carry(
    bounds: dict[Key, dict[str, float]], central: list[Measured], other: list[Measured], kind: str
) -> None:
    """Add what a shift changes in each quantity to the bound of its kind; paths are bounded by themselves."""
    for m, shifted in zip(central, other, strict=True):
        if m.quantity == DISTANCE:
            continue
        parts, change = bounds[key_of(m)], float(np.abs(shifted.values - m.values).max())
        parts[kind] = parts.get(kind, 0.0) + (math.inf if math.isnan(change) else change)


def _path_bounds(judge: Judge, found: Evidence) -> dict[str, float]:
    """How far a right trajectory may be from the exact path, m.

    A soft contact turns the velocity over its duration instead of at once, and up to a step late: a particle
    is beside its path by at most the change of velocity times that time, and then drifts with what the
    velocity is off.  An error of the starting positions makes the contact early or late.
    """
    run, end, place = found.run, found.setup.end_time, found.position_error
    fastest = float(np.linalg.norm(run.velocities, axis=2).max())
    bounds = {DIGITS: math.sqrt(3.0) * place + fastest * (found.time_error + EPS * end)}
    step, duration = found.time_step, found.contact_duration
    e = found.setup.model.restitution
    for impact in judge.impacts() or []:
        mass, left = _lightest(found, impact), end - impact.time
        jump = float(np.linalg.norm(impact.change)) / mass
        drift = math.hypot(*contact_error(impact, e, 0.0, 0.0, place)) / mass * left
        bounds[DIGITS] += jump * 2.0 * place / impact.approach + drift
        if step is not None and duration is not None:
            drift = math.hypot(*contact_error(impact, e, step, duration, 0.0)) / mass * left
            bounds[CONTACT] = bounds.get(CONTACT, 0.0) + jump * (duration + step) + drift
    if step is not None and judge.largest_force() > 0.0:
        bounds[FORCES] = 0.5 * step * judge.largest_force() * end
    return bounds


def _mass_bounds(judge: Judge, found: Evidence, scale: float) -> dict[str, float]:
    """How far a right removed mass may be off, kg: a volume goes with P^2, and P with v^1.2 (Eqs 30-36)."""
    step, duration, bounds = found.time_step, found.contact_duration, {DIGITS: 0.0}
    for impact in judge.impacts() or []:
        share = 2.4 * _speed(impact) / impact.approach * scale
        bounds[DIGITS] += share * turn(impact, 0.0, 0.0, found.position_error)
        if step is not None and duration is not None:
            bounds[CONTACT] = bounds.get(CONTACT, 0.0) + share * turn(impact, step, duration, 0.0)
    return bounds


def _unseen(judge: Judge, found: Evidence) -> float:
    """How far from its path a contact may put a particle that lasts no longer than outputs can tell, m."""
    blind = 2.0 * float(np.diff(found.run.times).max())
    return sum(
        float(np.linalg.norm(impact.change)) / _lightest(found, impact) * blind
        for impact in judge.impacts() or []
    )


def _lightest(found: Evidence, impact: Impact) -> float:
    return float(found.setup.state.mass[list(impact.particles)].min())


def _unbounded(judge: Judge, found: Evidence, central: list[Measured]) -> dict[Key, str]:
    """Quantities whose error by softness or steps has no bound here, and what would give one."""
    impacts, step = judge.impacts(), found.time_step
    if impacts is None:
        why = (
            "what softness does to impacts in turn has no bound; run the code as an engine, at several steps"
        )
        return {key_of(m): why for m in central if m.quantity != "momentum"}
    why = "neither the file nor an option states time step and contact duration; narrowed by stating them"
    if judge.largest_force() > 0.0 and step is None:
        return {key_of(m): why for m in central}
    if not impacts or (step is not None and found.contact_duration is not None):
        return {}
    bounds: dict[Key, dict[str, float]] = {key_of(m): {} for m in central}
    for impact in impacts:
        size = SMALL * float(np.linalg.norm(impact.change))
        for shift in _pushed(found, impact, CONTACT, size, size):
            _carry(bounds, central, judge.measure_trajectory(found.setup, shift.run), CONTACT)
    turns = any(impact.turning * _speed(impact) > 0.0 for impact in impacts)
    return {
        key_of(m): why
        for m in central
        if sum(bounds[key_of(m)].values()) > ROUNDING * m.scale
        or m.quantity == DISTANCE
        or (m.quantity == MASS and turns)
    }


def _depend_on_mass(judge: Judge, found: Evidence, central: list[Measured]) -> set[Key]:
    """Quantities that change with the masses at the end, where those are not known."""
    if found.masses_known:
        return set()
    masses = found.run.masses.copy()
    masses[-1] *= 1.0 + SMALL
    heavier = judge.measure_trajectory(found.setup, replace(found.run, masses=masses))
    return {
        key_of(m)
        for m, h in zip(central, heavier, strict=True)
        if np.abs(h.values - m.values).max() > EPS * m.scale
    }


def _verdict(m: Measured, parts: dict[str, float], vague: str, margin: float) -> Agreement:
    """Agreement within the bounds; where one is missing, `vague` says which, and the margin decides."""
    value, tolerance = float(m.values[0]), sum(parts.values())
    if not math.isfinite(value):
        return Agreement(math.nan, math.nan, "error", "a value is not finite")
    widest = max(parts, key=lambda kind: parts[kind])
    reason, remedy = REASONS[widest]
    target = replace(exact(m.expected, m.scale), uncertainty=m.expected_error)
    verdict = agreement(target, Extrapolation(value, tolerance, None, True, reason, remedy), m.scale, m.limit)
    if verdict.status != "disagree" or not vague:
        return verdict
    limit, share = verdict.tolerance + margin, f"{100 * margin / m.scale:.2g} % of {m.scale:.3g}"
    if verdict.error <= limit:
        return Agreement(verdict.error, limit, "not_tested", f"off by less than {share}: {vague}")
    return Agreement(verdict.error, limit, "disagree", f"off by more than {share}; {vague}")


def _kind(parts: dict[str, float], vague: bool) -> str:
    widest = max(parts, key=lambda kind: parts[kind])
    return "discretisation" if vague or widest in (CONTACT, FORCES, DIFFERENCES) else "precision"


def _row(case: Case, m: Measured, verdict: Agreement, kind: str) -> Comparison:
    return Comparison(
        case=case.name,
        variant=", ".join(part for part in (case.variant, m.place) if part),
        engine=ENGINE,
        quantity=m.quantity,
        equations=m.equations,
        unit=m.unit,
        reference=m.expected,
        measured=float(m.values[0]),
        error=verdict.error,
        tolerance=verdict.tolerance,
        kind=kind,
        reason=verdict.reason,
        status=verdict.status,
    )
