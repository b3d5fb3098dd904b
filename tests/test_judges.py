"""What the judges notice: engines that are the reference with one small error, and what gives each away.

The engines are judged as any other is: refined, extrapolated, and compared with the reference's limits.  The
swarm's judge needs the ledger's order as well and is tested in `test_horizon.py`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import pytest

from cmpcheck.compare import Key, compare_study, limits
from cmpcheck.convergence import Extrapolation
from cmpcheck.engines.protocol import Resolution
from cmpcheck.engines.reference import ReferenceEngine
from cmpcheck.judges import Judge, judge_of
from cmpcheck.results import Comparison
from cmpcheck.study import align_outputs, engine_study, reference_study
from cmpcheck.suite_cases import is_ensemble
from reference.case import available_cases, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.state import Setup

Change = Callable[[Setup], Setup]
Spoil = Callable[[Run], Run]
Name = tuple[str, str]  # case and variant

# The fakes' contacts take no time: the steps need not resolve them, only be about as fine as the reference's.
COARSE = {"lammps": {"contact_duration": 4e-9, "steps_per_contact": 16}}
STRUCK = 3  # the number of the row or particle in faults that strike only once


class Fault(NamedTuple):
    """An error, in what the engine is given or in the run that it returns, and what disagrees for it."""

    case: Name
    label: str
    quantities: set[str]
    change: Change = lambda setup: setup
    spoil: Spoil = lambda run: run


@dataclass(frozen=True)
class Fake:
    """The reference under another engine's name, with a fault."""

    change: Change = lambda setup: setup
    spoil: Spoil = lambda run: run
    softness: float = 0.0  # relative error of the restitution, per second of contact duration
    name = "lammps"

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        wrong = self.change(setup)
        e = wrong.model.restitution * (1.0 + self.softness * resolution.contact_duration)
        wrong = replace(wrong, model=wrong.model._replace(restitution=e))
        return self.spoil(ReferenceEngine().run(wrong, resolution))


@functools.cache
def known(case: Name) -> tuple[Setup, Judge, dict[Key, Extrapolation], list[Comparison]]:
    """Setup and judge of a case, the reference's limits, and its rows against the exact values."""
    variant = next(variant for variant in load_case(case[0]).variants() if variant.variant == case[1])
    setup = align_outputs(build_setup(variant))
    judge = judge_of(setup)
    if judge.refines_contact:
        setup = replace(setup, case=variant.model_copy(update={"engine": COARSE}))
    study = reference_study(ReferenceEngine(), judge, setup, "quick")
    return setup, judge, limits(study), compare_study(variant, study, None)


def rows_of(case: Name, engine: Fake, form: str = "impulse") -> list[Comparison]:
    """The rows of an engine; in the `impulse` form only its time step is refined."""
    setup, judge, reference, _ = known(case)
    return compare_study(setup.case, engine_study(engine, judge, setup, "quick", form), reference)


def disagreeing(rows: list[Comparison]) -> set[str]:
    assert not [row for row in rows if row.status == "error"]
    return {row.quantity for row in rows if row.status == "disagree"}


def times(factor: float) -> Callable:
    return lambda value: factor * value


def model(**changes) -> Change:
    """Constants of the model that the engine gets wrong: a new value, or a function of the right one."""

    def change(setup: Setup) -> Setup:
        right = setup.model._asdict()
        wrong = {name: new(right[name]) if callable(new) else new for name, new in changes.items()}
        return replace(setup, model=setup.model._replace(**wrong))

    return change


def state(**changes: Callable) -> Change:
    """Arrays of the initial state that the engine gets wrong."""

    def change(setup: Setup) -> Setup:
        wrong = {name: new(getattr(setup.state, name).copy()) for name, new in changes.items()}
        return replace(setup, state=replace(setup.state, **wrong))

    return change


def ledger(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Spoil:
    """A wrong ledger."""
    return lambda run: replace(run, contacts=change(run.contacts))


def final_velocity(change: Callable[[Run, np.ndarray], np.ndarray]) -> Spoil:
    """Wrong velocities at the end."""

    def spoil(run: Run) -> Run:
        velocities = run.velocities.copy()
        velocities[-1] = change(run, velocities[-1])
        return replace(run, velocities=velocities)

    return spoil


def shrunk(diameter: np.ndarray) -> np.ndarray:
    """One particle is too small to be met."""
    diameter[STRUCK] *= 0.1
    return diameter


def gain(run: Run, velocity: np.ndarray) -> np.ndarray:
    """One particle of one copy gains momentum, 1e-11 of its own."""
    velocity[STRUCK] *= 1.0 + 1e-11
    return velocity


def cool(run: Run, velocity: np.ndarray) -> np.ndarray:
    """Pairs lose 1e-9 of their relative velocity, at equal momentum."""
    mass, pairs = run.masses[-1].reshape(-1, 2, 1), velocity.reshape(-1, 2, 3)
    centre = (mass * pairs).sum(axis=1, keepdims=True) / mass.sum(axis=1, keepdims=True)
    return (centre + (pairs - centre) * (1.0 - 1e-9)).reshape(-1, 3)


def undiluted(run: Run, velocity: np.ndarray) -> np.ndarray:
    """The tangential velocity is kept, not the tangential momentum."""
    return velocity * np.where([True, True, False], (run.masses[-1] / run.masses[0])[:, np.newaxis], 1.0)


def exchanged(mass: np.ndarray) -> np.ndarray:
    return mass.reshape(-1, 2)[:, ::-1].ravel()


def once_more(rows: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([rows, rows.iloc[[STRUCK]]], ignore_index=True)


def once_less(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.drop(index=rows.index[STRUCK])


def unsigned(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(friction_impulse=rows["friction_impulse"].abs())


def one_higher(position: np.ndarray) -> np.ndarray:
    """One copy starts too high to reach the wall before the end."""
    position[STRUCK, 2] += 1e-7
    return position


FRICTION = ("static_friction", "dynamic_friction")
NO_DRAG = ledger(lambda rows: rows.assign(external_force=0.0))

JUDGED = [name for name in available_cases() if not is_ensemble(load_case(name))]
ALL = [(name, variant.variant) for name in JUDGED for variant in load_case(name).variants()]
SINGLE = [case for case in ALL if case[0] != "swarm"]
HEAD_ON, SLIP, STICK = ("pair_head_on", "e0.5"), ("pair_slip", ""), ("pair_stick", "")
BOUNCE, CLEAN, OBLIQUE = ("wall_bounce", "pickup"), ("wall_bounce", "no_pickup"), ("wall_oblique", "30deg")
EDGE, FLANK = ("asperity_bounce", "edge"), ("asperity_bounce", "flank")
STOKES, REGIMES, COUETTE = ("drag_relaxation", ""), ("drag_regimes", ""), ("couette_drift", "")
TRAIN, RESTING = ("bounce_train", ""), ("resting_struck", "")
PAD, DRAGGED, DEPTH = ("pad_strike", ""), ("pair_drag", ""), ("asperity_bounce", "node_depth")

PATH = {"trajectory_distance"}
VELOCITY = {"velocity_x", "velocity_y", "velocity_z"}
BALANCE = {"mass_balance"}
RUBBED = {"energy_lost", *VELOCITY}
AFTER = {"restitution", *RUBBED}
CAP = {"yield_radius", "indentation_depth", "removed_volume", "surface_shape"}
GAIN = {"removed_mass", "velocity_z", "energy_lost"}  # the mass picked up slows the particle
REBOUND = {"normal_impulse", "load", "restitution", *CAP, *GAIN}
TURNED = {"approach_speed", "velocity_x", "flatness", *REBOUND, *PATH}
CUT = {"removed_volume", "removed_mass"}
SHARED = {"velocity_z", "normal_impulse", "removed_volume"}
STRUCK_PAD = {"approach_speed", "normal_impulse", "velocity_z"}
AFTER_DRAG = {"normal_impulse", "restitution", *VELOCITY}
DRAG = {"approach_speed", "friction_impulse"}
DEEPER = {"removed_volume", "surface_shape"}
SHAPE = {"flatness", *DEEPER}
TRAINED = {"approach_speed", "normal_impulse", "load", *CUT}

FAULTS = [
    Fault(HEAD_ON, "restitution + 0.5 %", {"normal_impulse", *AFTER}, model(restitution=times(1.005))),
    Fault(HEAD_ON, "masses exchanged", VELOCITY | PATH, state(mass=exchanged)),
    Fault(HEAD_ON, "one copy misses its impact", {"impacts"}, state(diameter=shrunk)),
    Fault(HEAD_ON, "an impact too many", {"impacts"}, spoil=ledger(once_more)),
    Fault(HEAD_ON, "an impact forgotten", {"impacts"}, spoil=ledger(once_less)),
    Fault(HEAD_ON, "momentum leaks by 1e-11", {"momentum"}, spoil=final_velocity(gain)),
    Fault(HEAD_ON, "energy leaks by 1e-9", AFTER, spoil=final_velocity(cool)),
    Fault(SLIP, "friction + 1 %", {"friction_impulse", *RUBBED}, model(dynamic_friction=times(1.01))),
    Fault(SLIP, "friction drives", RUBBED | PATH, model(dynamic_friction=times(-1.0)), ledger(unsigned)),
    Fault(STICK, "no friction", {"friction_impulse", *RUBBED, *PATH}, model(**dict.fromkeys(FRICTION, 0.0))),
    Fault(BOUNCE, "restitution + 0.5 %", REBOUND, model(restitution=times(1.005))),
    Fault(BOUNCE, "modulus + 1 %", {"load", *CAP, *GAIN}, state(modulus=times(1.01))),
    Fault(BOUNCE, "cap volume + 5 %", CAP | GAIN, model(yield_stress=times(1.05**-0.5))),  # V ~ 1/sigma_y^2
    Fault(BOUNCE, "no root of 3 in Eq 34", CAP | GAIN, model(yield_stress=times(3**0.5))),
    Fault(BOUNCE, "density of the wall + 1 %", GAIN | BALANCE, model(surface_density=times(1.01))),
    Fault(BOUNCE, "mass not picked up", GAIN | BALANCE, model(mass_pickup=False)),
    Fault(BOUNCE, "5 % more taken off the wall", BALANCE | DEEPER, model(acceleration=1.05)),
    Fault(BOUNCE, "one copy misses its impact", {"impacts"}, state(position=one_higher)),
    Fault(BOUNCE, "an impact too many", {"impacts"}, spoil=ledger(once_more)),
    Fault(CLEAN, "mass picked up", GAIN, model(mass_pickup=True)),
    Fault(CLEAN, "5 % more taken off the wall", DEEPER, model(acceleration=1.05)),
    Fault(OBLIQUE, "tangential velocity kept", RUBBED - {"velocity_z"}, spoil=final_velocity(undiluted)),
    Fault(FLANK, "normal turned by 0.03 degrees", TURNED, state(heights=times(1.001))),
    Fault(EDGE, "edge out of place by 1 nm", TURNED, state(position=lambda r: r - [1e-9, 0.0, 0.0])),
    Fault(TRAIN, "restitution + 0.5 %", TRAINED | {"impact_time"}, model(restitution=times(1.005))),
    Fault(TRAIN, "flow + 0.5 %", TRAINED | {"impact_time"}, model(flow_z=times(1.005))),
    Fault(TRAIN, "viscosity + 1 %", {"impact_time"}, model(viscosity=times(1.01))),
    Fault(TRAIN, "cap volume + 5 %", CUT, model(yield_stress=times(1.05**-0.5))),
    Fault(TRAIN, "third impact below the threshold", {*CUT, "removals"}, model(threshold_velocity=0.1)),
    Fault(
        TRAIN,
        "fourth impact above the threshold",
        {"removals", "removed_mass"},
        model(threshold_velocity=0.0),
    ),
    Fault(TRAIN, "drag left out of Eq 30", {"normal_impulse"}, spoil=NO_DRAG),
    Fault(TRAIN, "mass not picked up", {"removed_mass", *BALANCE}, model(mass_pickup=False)),
    Fault(TRAIN, "5 % more taken off the wall", BALANCE, model(acceleration=1.05)),
    Fault(TRAIN, "an impact forgotten", {"impacts"}, spoil=ledger(once_less)),
    Fault(RESTING, "restitution + 0.5 %", SHARED, model(restitution=times(1.005))),
    Fault(RESTING, "cap volume + 5 %", {"removed_volume"}, model(yield_stress=times(1.05**-0.5))),
    Fault(RESTING, "no pair impulse", {*SHARED, "removals"}, model(has_pairs=False)),
    Fault(RESTING, "second impact in vain", {"removals", "removed_volume"}, model(threshold_velocity=0.1)),
    Fault(STOKES, "viscosity + 1 %", VELOCITY | PATH, model(viscosity=times(1.01))),
    Fault(STOKES, "viscosity + 0.1 %", PATH, model(viscosity=times(1.001))),
    Fault(STOKES, "flow + 0.1 %", {"velocity_x", *PATH}, model(flow_x=times(1.001))),
    Fault(REGIMES, "viscosity + 1 %", VELOCITY | PATH, model(viscosity=times(1.01))),
    Fault(REGIMES, "fluid density + 1 %", VELOCITY | PATH, model(fluid_density=times(1.01))),
    Fault(COUETTE, "viscosity + 1 %", VELOCITY | PATH, model(viscosity=times(1.01))),
    Fault(COUETTE, "shear rate + 0.1 %", {"velocity_x", *PATH}, model(wall_speed=times(1.001))),
    Fault(COUETTE, "gap - 0.1 %", {"velocity_x", *PATH}, model(gap=times(0.999))),
    Fault(
        PAD,
        "restitution of the pad + 0.5 %",
        {"impact_time", *STRUCK_PAD},
        model(pad_restitution=times(1.005)),
    ),
    Fault(PAD, "pad descends 0.5 % faster", {"pad_height", *STRUCK_PAD}, model(pad_descent=times(1.005))),
    Fault(PAD, "pad stops 1 nm higher", {"pad_height"}, model(pad_minimum=lambda h: h + 1e-9)),
    Fault(PAD, "restitution of the wall + 0.5 %", STRUCK_PAD, model(restitution=times(1.005))),
    Fault(DRAGGED, "restitution + 5 %", AFTER_DRAG, model(restitution=times(1.05))),
    Fault(DRAGGED, "viscosity + 5 %", AFTER_DRAG | DRAG, model(viscosity=times(1.05))),
    Fault(DEPTH, "5 % deeper", SHAPE, model(acceleration=1.05)),
    Fault(DEPTH, "a volume for a depth", SHAPE, model(deposit=1)),
]
IRRELEVANT = [  # constants that do not enter: an equal outcome is no fault
    Fault(STICK, "friction that is not exhausted", set(), model(**dict.fromkeys(FRICTION, times(1.01)))),
    Fault(STOKES, "fluid density at Re < 1", set(), model(fluid_density=times(1.01))),
]


def label(fault: Fault) -> str:
    return f"{' '.join(filter(None, fault.case))}: {fault.label}"


@pytest.mark.parametrize("case", SINGLE, ids=" ".join)
def test_the_reference_agrees_with_the_closed_forms_and_as_an_engine_with_itself(case):
    assert {row.status for row in known(case)[3]} == {"agree"}
    assert {row.status for row in rows_of(case, Fake())} == {"agree"}


@pytest.mark.parametrize("fault", FAULTS + IRRELEVANT, ids=label)
def test_a_fault_is_noticed_by_what_it_touches_and_by_nothing_else(fault):
    assert disagreeing(rows_of(fault.case, Fake(fault.change, fault.spoil))) == fault.quantities


SOFT = 2.5e6  # per second: the restitution is off by 1 % at the longest contact, and right at t_c -> 0


@pytest.mark.parametrize("case", [HEAD_ON, BOUNCE, TRAIN], ids=" ".join)
def test_an_error_that_vanishes_with_the_contact_duration_is_none(case):
    assert disagreeing(rows_of(case, Fake(softness=SOFT), "soft")) == set()


@pytest.mark.parametrize(
    "case, quantities",
    [(HEAD_ON, {"normal_impulse", *AFTER}), (BOUNCE, REBOUND), (TRAIN, {"normal_impulse"})],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_half_a_percent_of_restitution_is_noticed_beside_it(case, quantities):
    engine = Fake(model(restitution=times(1.005)), softness=SOFT)
    assert disagreeing(rows_of(case, engine, "soft")) >= quantities
