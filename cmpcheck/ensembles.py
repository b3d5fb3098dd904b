"""Whether two engines polish alike: samples that start from the same arrays, compared by paired statistics.

Trajectories of a polishing case part early, so only ensembles can be compared (Sections 4 and 4.1).  The
statistics are `statistics/`, the seeds of the samples `reference/ensemble.py`, what is observed
`observables.py`, how many samples there are `planning.py`, where one sample parts `parting.py`.
"""

from __future__ import annotations

import math
from pathlib import Path

from cmpcheck.display import quantity_text
from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.observables import Pairs, margins, pair_up
from cmpcheck.parting import compare_impacts
from cmpcheck.planning import fewest_sentence, pairs_to_run, pilot_spreads, plan
from cmpcheck.results import Comparison, Ensemble
from cmpcheck.statistics import Equivalence, control_family, paired_difference
from cmpcheck.study import contact_settings
from reference.case import Case
from reference.ensemble import sample_case
from reference.process import build_setup, pressed_speed
from reference.recording import Run
from reference.state import Setup

STEP_SAMPLES = 2  # times as many as the power calculation asks for: they are cheap, with rare large changes
STEP_SHARE = 0.5  # of the margins, within which the reference must not depend on its own step


def compare_ensembles(
    case: Case,
    engines: tuple[Engine, Engine],
    profile: str,
    form: str = "impulse",
    folder: Path | None = None,
    check_step: bool = True,
) -> tuple[list[Comparison], Ensemble]:
    """Run the samples in both engines, the reference first, and judge every observable.

    With `check_step` the reference runs them once more at twice its step: its own dependence on the step must
    lie within STEP_SHARE of the margins; and once at the step of an ordinary run of the case, to show what
    would have been mistaken for a departure of the other engine.  Of several forms of one case, one needs to
    ask for it.

    Parameters: form of the contacts with surface and pad in the other engine, impulse | soft; folder, to
    which every run is saved as soon as it is made.
    Returns rows of kind `statistical`, whose tolerance is the margin, and what the report shows beside them.
    Raises EngineError (a RuntimeError) when a run fails, CaseError for an entry of the case that makes no
    sense.
    """
    name = engines[1].name
    fine, coarse, soft = resolutions(case, name, form)
    ours, theirs, doubled, ordinary = [], [], [], []
    limits, step_limits = margins(case, name), margins(case, name, STEP_SHARE)
    pairs = pairs_to_run(case, name, profile, limits)
    step_pairs = STEP_SAMPLES * pairs_to_run(case, "reference", profile, step_limits) if check_step else 0
    for k in range(max(pairs, step_pairs)):
        setup = build_setup(sample_case(case, k))
        ours.append(_keep(engines[0].run(setup, fine), folder if k < pairs else None, "reference", k))
        if k < step_pairs:
            doubled.append(engines[0].run(setup, coarse))
            if not math.isclose(setup.time_step, fine.time_step):
                ordinary.append(engines[0].run(setup, Resolution(setup.time_step)))
        if k < pairs:
            theirs.append(_keep(engines[1].run(setup, soft), folder, f"{name}-{form}", k))
    compared = pair_up(limits, ours[: len(theirs)], theirs)
    steps = pair_up(step_limits, ours[: len(doubled)], doubled) if doubled else []
    step_label = f"time step {_ns(coarse.time_step)} against {_ns(fine.time_step)}"
    step_reason = f"what doubling the step changes; at first order, the error left at {_ns(fine.time_step)}"
    rows = [
        *_rows(case, name, form, "", compared),
        *_rows(case, "reference", step_label, f"{STEP_SHARE:g} of the margin; {step_reason}; ", steps),
    ]
    first = build_setup(sample_case(case, 0))
    remarks = [_about_steps(name, fine, soft, first), fewest_sentence()]
    if ordinary:
        flatness = pair_up(limits, ours[: len(ordinary)], ordinary)[0]
        remarks.insert(1, _about_ordinary(name, fine, first, flatness))
    ensemble = Ensemble(
        case=case.name,
        variant=case.variant,
        engine=name,
        form=form,
        pairs=len(theirs),
        curves=tuple(p.curve() for p in compared),
        planning=(*plan(case, name, compared), *plan(case, "reference", steps)),
        ledger=compare_impacts(ours[0], theirs[0], first, engines[0], (fine, soft)),
        remarks=tuple(remarks),
    )
    return rows, ensemble


def check_settings(case: Case, engine: str) -> None:
    """Raise CaseError, before anything is run, for an entry of `[engine.*]` that makes no sense."""
    resolutions(case, engine, "")
    margins(case, engine)
    for name in ("reference", engine):
        pilot_spreads(case, name)


def resolutions(case: Case, engine: str, form: str) -> tuple[Resolution, Resolution, Resolution]:
    """Of the reference, of the reference at twice its step, and of the other engine.

    The reference's step is that of `[engine.reference]`, without it that of every run of the case.
    Raises CaseError for a step that is not positive.
    """
    duration, steps = contact_settings(case, engine)
    table, path = case.engine.get("reference", {}), "engine.reference.time_step"
    if "time_step" in table:
        step = case.quantity(table["time_step"], "s", path)
        if not step > 0.0:
            raise case.error(path, table["time_step"], "allowed: > 0")
    else:
        step = build_setup(case).time_step
    return Resolution(step), Resolution(2.0 * step), Resolution(duration / steps, duration, form)


def _keep(run: Run, folder: Path | None, name: str, k: int) -> Run:
    if folder is not None:
        run.save(folder / name / str(k))
    return run


def _rows(case: Case, engine: str, label: str, reason: str, found: list[Pairs]) -> list[Comparison]:
    """One row for each quantity and time, judged as one family."""
    places = [(p, frame) for p in found for frame in p.frames]
    verdicts = control_family([paired_difference(p.differences(frame), p.margin) for p, frame in places])
    return [
        _row(case, engine, label, reason, p, frame, verdict)
        for (p, frame), verdict in zip(places, verdicts, strict=True)
    ]


def _row(
    case: Case, engine: str, label: str, reason: str, p: Pairs, frame: int, verdict: Equivalence
) -> Comparison:
    place = "" if p.observable.relative else f"at {p.times[frame] * 1e6:.3g} us"
    error = f"mean of {verdict.n} pairs, standard error {verdict.standard_error * p.scale:.2g}"
    return Comparison(
        case=case.name,
        variant=", ".join(part for part in (case.variant, label, place) if part),
        engine=engine,
        quantity=p.observable.quantity,
        equations=p.observable.equations,
        unit=p.observable.unit,
        reference=float(p.reference[:, frame].mean()),
        measured=float(p.measured[:, frame].mean()),
        error=abs(verdict.mean) * p.scale,
        tolerance=p.margin * p.scale,
        kind="statistical",
        reason=f"{reason}{error}; {verdict.reason}",
        status=verdict.status,
    )


def _about_steps(engine: str, fine: Resolution, soft: Resolution, setup: Setup) -> str:
    """Which steps the two engines take, and why."""
    part = soft.contact_duration / fine.time_step
    text = (
        f"The reference takes steps of {_ns(fine.time_step)}, 1/{part:.3g} of the "
        f"{_ns(soft.contact_duration)} that a contact between particles lasts in {engine}, whose steps are "
        f"{_ns(soft.time_step)}"
    )
    threshold = setup.model.threshold_velocity
    if 0.0 < threshold < pressed_speed(setup, setup.time_step):
        longest = _ns(threshold / pressed_speed(setup, 1.0))
        text += f"; above v_th tau/(2 U) = {longest} a particle pressed on the surface wears it at every step"
    return f"{text}."


def _about_ordinary(engine: str, fine: Resolution, setup: Setup, flatness: Pairs) -> str:
    """What the reference at the step of an ordinary run would have been mistaken for."""
    parts = []
    for frame in flatness.frames:
        change = flatness.differences(frame)
        error = float(change.std(ddof=1)) / math.sqrt(len(change))
        parts.append(f"{change.mean():+.4f} ± {error:.4f} at {flatness.times[frame] * 1e6:.3g} µs")
    return (
        f"At the {_ns(setup.time_step)} of an ordinary run the reference's own Π differs from that at "
        f"{_ns(fine.time_step)} by {', '.join(parts)} ({len(flatness.reference)} samples): compared at that "
        f"step, {engine} would seem to depart by as much, with the other sign."
    )


def _ns(seconds: float) -> str:
    return quantity_text(seconds, "s", like=1e-9, digits=3)
