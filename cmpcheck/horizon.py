"""How long two runs of many particles can be compared contact by contact, and the comparison until then.

Collisions amplify every difference, so trajectories part after some time whatever the engine.  Runs that
ought to be the same (levels of one engine, and a twin that starts one unit in the last place away) measure
when; until then the engines must have the same contacts in the same order.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pandas as pd

from cmpcheck.engines.protocol import Engine
from cmpcheck.judges import Measured
from cmpcheck.parting import Parting, first_parting
from cmpcheck.phases import unwrapped
from cmpcheck.quantities import kinetic_energy
from cmpcheck.results import Comparison
from cmpcheck.study import Level, Study
from reference.case import Case

FEWEST_CONTACTS = 10  # fewer contacts before the horizon are no test of their order


def study_horizon(engine: Engine, study: Study) -> Parting:
    """The first parting among the levels of one engine and between its finest level and that one's twin."""
    finest = study.finest
    state = finest.setup.state
    nudged = state.position.copy()
    nudged[0] = np.nextafter(nudged[0], np.inf)
    twin = engine.run(replace(finest.setup, state=replace(state, position=nudged)), finest.resolution)
    others = [level.run for level in study.levels if level is not finest]
    return min((first_parting(finest.run, run) for run in [twin, *others]), key=lambda parting: parting.time)


def compare_ledgers(
    case: Case, reference: tuple[Study, Parting], other: tuple[Study, Parting]
) -> tuple[Comparison, str]:
    """The row on the order of contacts, and a sentence; both studies gain quantities up to the horizon.

    Added to every level: mean normal and friction impulse of the contacts before the horizon, and the
    distance to the reference's extrapolated positions at the last output before it.
    """
    (ours, our_horizon), (theirs, their_horizon) = reference, other
    end = float(ours.finest.run.times[-1]) - _lateness(ours) - _lateness(theirs)
    horizon = min(our_horizon.time, their_horizon.time, end)
    parting = first_parting(ours.finest.run, theirs.finest.run)
    contacts = ours.finest.run.contacts
    expected = int((contacts["time"] < horizon).sum())
    matched = int((contacts["time"] < min(horizon, parting.time)).sum())
    status, reason = "agree", "every particle meets the same partners in the same order before the horizon"
    if parting.time < horizon:
        status = "disagree"
        reason = (
            f"the engines part at {parting.time * 1e9:.1f} ns, at the contact of {parting.i} and {parting.j}"
        )
    elif expected < FEWEST_CONTACTS:
        status, reason = (
            "not_tested",
            f"only {expected} contacts before the horizon; a denser case would test it",
        )
    row = Comparison(
        case=case.name,
        variant=case.variant,
        engine=theirs.engine,
        quantity="contact_order",
        equations="2-19",
        unit="1",
        reference=float(expected),
        measured=float(matched),
        error=float(expected - matched),
        tolerance=0.5,
        kind="rounding",
        reason=f"a count; {reason}",
        status=status,
    )
    horizon = min(horizon, parting.time)
    _add_impulses([ours, theirs], horizon)
    _add_distances(ours, theirs, horizon)
    return row, _sentence(ours, our_horizon, theirs, their_horizon, end)


def _sentence(ours: Study, our_horizon: Parting, theirs: Study, their_horizon: Parting, end: float) -> str:
    def until(study: Study, parting: Parting) -> str:
        if parting.time >= end:
            return (
                f"{study.engine}'s own runs (levels, and a twin one unit in the last place away) never part"
            )
        where = f"the contact of {parting.i} and {parting.j}"
        return f"{study.engine}'s own runs part at {parting.time * 1e9:.1f} ns, at {where}"

    both = f"{until(ours, our_horizon)}; {until(theirs, their_horizon)}"
    return f"Horizon: {both}; the run ends at {end * 1e9:.0f} ns."


def _occurrences(contacts: pd.DataFrame, horizon: float) -> pd.DataFrame:
    """Contacts before the horizon by (i, j, how often they have met)."""
    rows = contacts[contacts["time"] < horizon].sort_values("time", kind="stable")
    met = rows.groupby(["i", "j"]).cumcount().rename("met")
    return rows.assign(met=met).set_index(["i", "j", "met"])


def _add_impulses(studies: list[Study], horizon: float) -> None:
    """Mean impulses of the contacts that every level of both studies has, isolated ones only."""
    levels = [level for study in studies for level in study.levels]
    tables = [_occurrences(level.run.contacts, horizon) for level in levels]
    shared = tables[0].index
    for table in tables:
        shared = shared.intersection(table.index[np.isfinite(table["normal_impulse"])])
    if len(shared) < FEWEST_CONTACTS:
        return
    shared = shared.sort_values()
    place = f"mean of {len(shared)} contacts"
    normal = float(tables[0].loc[shared, "normal_impulse"].mean())
    for level, table in zip(levels, tables, strict=True):
        for quantity, equations in (("normal_impulse", "9, 12"), ("friction_impulse", "14-18")):
            value = np.array([float(table.loc[shared, quantity].mean())])
            level.measured.append(Measured(quantity, place, equations, "N s", value, math.nan, normal))


def _add_distances(ours: Study, theirs: Study, horizon: float) -> None:
    """At the last output before the horizon, distance (rms) to the reference's limit, and energy lost."""
    times = ours.finest.run.times
    frame = int(np.searchsorted(times, horizon, side="left")) - 1
    if frame < 1:
        return

    def at(level: Level) -> np.ndarray:
        return unwrapped(level.run, level.setup)[frame]

    fine, middle, coarse = (at(level) for level in ours.series["time step"][:-4:-1])
    limit = 2.0 * fine - middle  # first order, halved steps
    path = _root_mean_square(fine - ours.finest.setup.state.position)
    error = _root_mean_square(limit - (2.0 * middle - coarse))  # between the last two limits
    place = f"at {times[frame] * 1e9:.0f} ns"
    for level in theirs.levels:
        value = np.array([_root_mean_square(at(level) - limit)])
        level.measured.append(
            Measured("trajectory_distance", place, "2, 37", "m", value, 0.0, path, expected_error=error)
        )
    start = float(kinetic_energy(ours.finest.run, 0, 1)[0])
    for level in [*ours.levels, *theirs.levels]:
        lost = kinetic_energy(level.run, 0, 1) - kinetic_energy(level.run, frame, 1)
        level.measured.append(Measured("energy_lost", place, "9-19", "J", lost, math.nan, start))


def _lateness(study: Study) -> float:
    """How much later than it should a contact may begin or end: the longest contact and step."""
    return max(level.resolution.contact_duration + level.resolution.time_step for level in study.levels)


def _root_mean_square(vectors: np.ndarray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))
