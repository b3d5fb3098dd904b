"""The runs that one comparison needs: levels of time step and contact duration, and who simulates them.

A study runs one variant of a case in one engine at several resolutions and measures each run.  What the
levels tend to, and the verdict, is `compare.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from cmpcheck.engines import is_plugin
from cmpcheck.engines.protocol import Engine, Resolution
from cmpcheck.judges import Judge, Measured
from cmpcheck.judges.protocol import observes_contacts
from cmpcheck.phases import tile
from reference.case import Case
from reference.recording import Run
from reference.state import Setup
from reference.toml_source import MISSING

LEVELS = {"quick": 3, "full": 4}  # of an engine; each level halves the one before
REFERENCE_LEVELS = {"quick": 5, "full": 6}
MOST_OUTPUTS = 100


@dataclass
class Level:
    """One run and what was measured in it."""

    setup: Setup
    resolution: Resolution
    run: Run
    measured: list[Measured]


@dataclass
class Study:
    """All runs of one variant in one engine; each series is refined in one parameter, coarsest first."""

    engine: str
    form: str
    series: dict[str, list[Level]] = field(default_factory=dict)

    @property
    def finest(self) -> Level:
        """The level that all series end in."""
        return next(iter(self.series.values()))[-1]

    @property
    def levels(self) -> list[Level]:
        """Every run once."""
        return list({id(level): level for levels in self.series.values() for level in levels}.values())


def align_outputs(setup: Setup) -> Setup:
    """The setup with output times that are whole multiples of its time step, which may become smaller."""
    steps = max(1, math.ceil(setup.end_time / setup.time_step - 1e-9))
    stride = math.ceil(steps / MOST_OUTPUTS)
    outputs = math.ceil(steps / stride)
    times = np.linspace(0.0, setup.end_time, outputs + 1)
    return replace(setup, output_times=times, time_step=setup.end_time / (outputs * stride))


def reference_study(engine: Engine, judge: Judge, setup: Setup, profile: str) -> Study:
    """The reference at successively halved time steps."""
    steps = [setup.time_step / 2**k for k in range(REFERENCE_LEVELS[profile])]
    levels = [_level(engine, judge, setup, Resolution(step)) for step in steps]
    return Study(engine.name, "", {"time step": levels})


def engine_study(engine: Engine, judge: Judge, setup: Setup, profile: str, form: str) -> Study:
    """Another engine: contact durations where contacts are soft, and time steps at the shortest one."""
    duration, steps_per_contact = contact_settings(setup.case, engine.name)
    halvings = 2 ** (LEVELS[profile] - 1)
    interval = float(setup.output_times[1])
    soft = judge.refines_contact and form != "impulse"
    shortest = duration / halvings if judge.refines_contact else duration
    coarse = interval / math.ceil(interval * steps_per_contact / shortest)
    by_step = [Resolution(coarse / 2**k, shortest, form) for k in range(LEVELS[profile])]
    by_duration = [
        Resolution(by_step[-1].time_step * 2**k, shortest * 2**k, form)
        for k in reversed(range(LEVELS[profile]))
    ]
    runs: dict[Resolution, Level] = {}
    for resolution in [*by_step, *(by_duration if soft else [])]:
        if resolution not in runs:
            runs[resolution] = _level(engine, judge, setup, resolution)
    study = Study(engine.name, form if judge.has_surface_contact else "")
    if soft:
        study.series["contact duration"] = [runs[resolution] for resolution in by_duration]
    study.series["time step"] = [runs[resolution] for resolution in by_step]
    return study


def contact_forms(engine: Engine, judge: Judge, case: Case) -> tuple[str, ...]:
    """The forms of surface contact that an engine is run in; one that names none has its own only."""
    if not judge.has_surface_contact:
        return ("native",)
    forms_of = getattr(engine, "forms_of", None)
    return tuple(forms_of(case) if forms_of else getattr(engine, "surface_forms", ("native",)))


def unobserved(study: Study, reference: Study) -> list[str]:
    """What is not compared, in a sentence, where a run has no ledger of contacts."""
    if observes_contacts(study.finest.run):
        return []
    told = {m.quantity for m in study.finest.measured}
    untold = sorted({m.quantity for m in reference.finest.measured} - told)
    return (
        [f"{study.engine} records no contacts here, and does not tell {', '.join(untold)}."] if untold else []
    )


def has_settings(case: Case, engine: str) -> bool:
    """Whether the case says how an engine resolves it; see `settings_table`."""
    return settings_table(case, engine) in case.engine


def settings_table(case: Case, engine: str) -> str:
    """Name of the `[engine.NAME]` table that holds for an engine: its own, else for a plugin LAMMPS's.

    How long the contact of two soft spheres may last, and in how many steps, is no matter of the code.
    """
    return "lammps" if engine not in case.engine and is_plugin(engine) else engine


def contact_settings(case: Case, engine: str) -> tuple[float, float]:
    """The coarsest contact duration (s) and the steps that resolve it, from `[engine.NAME]`.

    Raises CaseError where they are missing or not positive.
    """
    name = settings_table(case, engine)
    table = case.engine.get(name, {})
    values = []
    for key, unit in (("contact_duration", "s"), ("steps_per_contact", "")):
        path = f"engine.{name}.{key}"
        if key not in table:
            raise case.error(path, MISSING, f"required to compare with {engine}, but missing")
        value = case.quantity(table[key], unit, path)
        if not value > 0.0:
            raise case.error(path, table[key], "allowed: > 0")
        values.append(value)
    return values[0], values[1]


def _level(engine: Engine, judge: Judge, setup: Setup, resolution: Resolution) -> Level:
    tiled = tile(setup, judge.copies, resolution.time_step) if judge.copies > 1 else setup
    run = engine.run(tiled, resolution)
    measure = judge.measure if observes_contacts(run) else judge.measure_trajectory
    return Level(tiled, resolution, run, measure(tiled, run))
