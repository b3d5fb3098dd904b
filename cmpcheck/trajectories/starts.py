"""A trajectory and its case: units, the starting state, what is missing, and the run that it makes.

Raises CaseError where the file does not belong to the case.  How exact its numbers are goes along; what that
makes of a verdict is `judged.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from cmpcheck.judges.protocol import UNOBSERVED, Judge
from cmpcheck.phases import unwrapped
from cmpcheck.trajectories.dumps import read_dump
from cmpcheck.trajectories.frames import (
    FEWER,
    POSITION,
    VELOCITY,
    Columns,
    Frames,
    assemble,
    check_size,
    shown,
)
from cmpcheck.trajectories.meshes import read_series
from cmpcheck.trajectories.tables import read_csv, read_parquet
from cmpcheck.trajectories.units import ALLOWED, Units, duration, parse_units
from cmpcheck.trajectories.velocities import by_differences
from reference.heightfield import Heightfield
from reference.ledger import empty_ledger, ledger_frame
from reference.recording import Run, basic_provenance, history_row
from reference.state import Setup
from reference.toml_source import CaseError

EPS = float(np.finfo(float).eps)
UNIT_ROUNDING = 8 * EPS  # relative: a number is multiplied and divided by a unit a few times
END = 1e-6  # of the case's duration, by which a file may end early
LIGHTEST = 1e-6  # of a mass at the start: particles pick up and never lose, and impulses are divided by it
MOST_STEPS = 1e6  # of a code that does not state its time step, for what rounding adds up to
READERS: dict[str, Callable[[Path], Frames]] = {
    ".csv": read_csv, ".txt": read_csv, ".parquet": read_parquet, ".pq": read_parquet, ".pvd": read_series,
    ".series": read_series, ".dump": read_dump, ".lammpstrj": read_dump,
}  # fmt: skip


@dataclass(frozen=True)
class Options:
    """What the command line says of all files that do not say it themselves; "" for nothing."""

    units: str = ""
    time_step: str = ""
    contact_duration: str = ""


@dataclass
class Evidence:
    """A trajectory as a run of its case, SI, with bounds on the errors of its numbers."""

    setup: Setup  # with the output times of the file
    run: Run
    position_error: float  # m
    time_error: float  # s
    velocity_error: np.ndarray  # (T, N, 3), m/s
    mass_error: np.ndarray  # (N,), kg
    differences: bool  # the velocities come from the positions
    masses_known: bool
    time_step: float | None  # s, as the file or an option states it
    contact_duration: float | None
    notes: list[str]


def read(path: Path) -> Frames:
    """The frames of a file, by the ending of its name.  Raises CaseError."""
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise CaseError(f"{path}: unknown ending {shown(path.suffix)}; allowed: {', '.join(sorted(READERS))}")
    if not path.is_file():
        raise CaseError(f"{path}: no such file")
    try:
        check_size(path)
        return reader(path)
    except OSError as problem:
        raise CaseError(f"{path}: cannot be read: {problem.strerror or problem}") from None
    except MemoryError:
        raise CaseError(f"{path}: more than there is memory for; allowed: {FEWER}") from None


def evidence(path: Path, setup: Setup, options: Options, judge: Judge) -> Evidence:
    """The trajectory of a file as a run of `setup`; its judge knows when particles fly freely.

    Raises CaseError when the file does not hold the case from its start to its end.
    """
    read_frames = read(path)
    units, time_step, contact = _declared(read_frames, options)
    if read_frames.time_is_step:
        if time_step is None:
            raise CaseError(
                f"{path}: its times are numbers of steps; allowed: a dump with times (dump_modify ID time "
                "yes), or --time-step"
            )
        read_frames.times = read_frames.times * (time_step / units.time)
    columns = assemble(read_frames, len(setup.state.mass))
    times = columns.times * units.time
    _check_times(path, times, setup, time_step or 0.0)
    positions = _vectors(columns, POSITION, units)
    reach = float(np.abs(positions).max())
    position_error = _resolution(columns, POSITION, units) + UNIT_ROUNDING * reach
    setup = replace(setup, output_times=times, end_time=float(times[-1]))
    _check_start(path, "position", positions[0], setup, position_error)
    steps = times[-1] / time_step if time_step else MOST_STEPS
    position_error += 0.5 * EPS * steps * reach  # half a unit at each step of the code
    time_error = columns.resolution.get("time", 0.0) * units.time
    model = setup.model
    for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
        if period > 0.0:
            positions[:, :, axis] %= period
    masses, mass_error, masses_known = _masses(columns, setup, units)
    _check_diameters(columns, setup, units)
    run = _run(setup, times, positions, masses, path)
    notes = []
    differences = VELOCITY[0] not in columns.values
    if differences:
        if len(times) < 3:
            raise CaseError(f"{path}: no velocities, and only {len(times)} times; allowed: 3 or more")
        paths = unwrapped(run, setup)
        speed = float(np.abs(np.diff(paths, axis=0) / np.diff(times)[:, np.newaxis, np.newaxis]).max())
        late = speed * (time_error + EPS * float(times[-1]))
        velocities, errors = by_differences(
            times,
            paths,
            position_error + late,
            calm_times(judge, contact or 0.0, float(np.diff(times).max())),
        )
        notes.append(f"{path.name} has no velocities: they are differences of its positions.")
    else:
        velocities = _vectors(columns, VELOCITY, units)
        speed = float(np.abs(velocities).max())
        bound = _resolution(columns, VELOCITY, units) + UNIT_ROUNDING * speed
        errors = np.full_like(velocities, bound)
        _check_start(path, "velocity", velocities[0], setup, bound)
    if not masses_known:
        notes.append(
            f"{path.name} has no masses, which this case changes: what depends on them is not tested."
        )
    run.velocities[:] = velocities
    run.history = _history(run, setup)
    run.provenance["steps"] = steps
    return Evidence(
        setup, run, position_error, time_error, errors, mass_error, differences, masses_known, time_step,
        contact, notes,
    )  # fmt: skip


def calm_times(judge: Judge, contact: float, interval: float) -> tuple[float, float] | None:
    """Until when and from when on nothing acts on the particles; None where that is not known.

    Before the first exact impact; later than the last one by its duration and an output.
    """
    impacts = judge.impacts()
    if impacts is None or judge.largest_force() > 0.0:
        return None
    if not impacts:
        return np.inf, 0.0
    return impacts[0].time, impacts[-1].time + contact + interval


def trajectory_run(
    setup: Setup,
    engine: str,
    times: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray,
    masses: np.ndarray | None = None,
) -> Run:
    """A run of an engine that records a trajectory and no contacts; it is judged by the trajectory alone.

    Parameters: times (T,), s, those of `setup.output_times`; positions (T, N, 3), m, and velocities, m/s;
    masses (T, N), kg, by default those at the start.
    """
    period = np.array([setup.model.length_x, setup.model.length_y, setup.model.length_z])
    wrapped = np.array(positions, dtype=float)
    for axis in np.flatnonzero(period):
        wrapped[:, :, axis] %= period[axis]
    if masses is None:
        masses = np.tile(setup.state.mass, (len(times), 1))
    run = _run(setup, np.array(times, dtype=float), wrapped, np.array(masses, dtype=float), None)
    run.velocities[:] = velocities
    run.history = _history(run, setup)
    run.provenance |= {"engine": engine, "steps": MOST_STEPS}
    return run


def _declared(read: Frames, options: Options) -> tuple[Units, float | None, float | None]:
    """Units, time step and contact duration, of the file or of the options, which must not contradict it."""
    path, said = read.path, read.declared
    try:
        if not (said.get("units") or options.units):
            raise ValueError(f"units: neither the file nor --units says them; {ALLOWED}")
        units = parse_units(said.get("units") or options.units)
        if said.get("units") and options.units and parse_units(options.units) != units:
            raise ValueError(f"its units are {shown(said['units'])}, --units says {shown(options.units)}")
    except ValueError as problem:
        raise CaseError(f"{path}: {problem}") from None
    found: list[float | None] = []
    for key in ("time_step", "contact_duration"):
        text = said.get(key) or getattr(options, key)
        try:
            found.append(duration(text, units) if text else None)
        except ValueError as problem:
            raise CaseError(f"{path}: {key} = {shown(text)}: {problem}") from None
    return units, found[0], found[1]


def _vectors(columns: Columns, names: tuple[str, ...], units: Units) -> np.ndarray:
    return np.stack([columns.values[name] for name in names], axis=2) * units.of(names[0])


def _resolution(columns: Columns, names: tuple[str, ...], units: Units) -> float:
    return max(columns.resolution.get(name, 0.0) for name in names) * units.of(names[0])


def _check_times(path: Path, times: np.ndarray, setup: Setup, time_step: float) -> None:
    """The file must go from 0 to the case's end: a step more is allowed, for codes that take whole steps."""
    end, step = setup.end_time, time_step
    if abs(times[0]) > END * end:
        raise CaseError(f"{path}: begins at {times[0]:g} s; allowed: 0, with the case's starting state")
    if times[-1] < end - max(END * end, step):
        raise CaseError(
            f"{path}: ends at {times[-1]:g} s, but the case lasts {end:g} s; allowed: the whole case"
        )
    interval = float(times[-1] - times[-2]) if len(times) > 1 else 0.0
    beyond = min(max(step, END * end, interval), end)
    if times[-1] > end + beyond:
        raise CaseError(
            f"{path}: ends at {times[-1]:g} s, but the case lasts {end:g} s; allowed: an output more"
        )


def _check_start(path: Path, what: str, values: np.ndarray, setup: Setup, bound: float) -> None:
    """The first time must hold the case's starting state, particle by particle, within the digits."""
    ours = setup.state.position if what == "position" else setup.state.velocity
    apart, model = values - ours, setup.model
    if what == "position":
        for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
            if period > 0.0:
                apart[:, axis] -= period * np.round(apart[:, axis] / period)
    allowed = bound + UNIT_ROUNDING * float(np.abs(ours).max())
    if (np.abs(apart) > allowed).any():
        p, axis = (int(k) for k in np.unravel_index(np.abs(apart).argmax(), apart.shape))
        name = (POSITION if what == "position" else VELOCITY)[axis]
        raise CaseError(
            f"{path}: particle {p} starts with {name} = {values[p, axis]:.6g}, the case with "
            f"{ours[p, axis]:.6g} (SI; the file's digits allow {allowed:.2g}): another starting state, other "
            "units, or another order"
        )


def _masses(columns: Columns, setup: Setup, units: Units) -> tuple[np.ndarray, np.ndarray, bool]:
    """Masses (T, N), bounds on their errors (N,), and whether they are known at all times."""
    start = setup.state.mass
    if "mass" not in columns.values:
        return np.tile(start, (len(columns.times), 1)), np.zeros(len(start)), not setup.model.mass_pickup
    masses = columns.values["mass"] * units.mass
    bound = columns.resolution.get("mass", 0.0) * units.mass + UNIT_ROUNDING * float(masses.max())
    wrong = np.abs(masses[0] - start) > bound + UNIT_ROUNDING * start
    if wrong.any():
        p = int(wrong.argmax())
        raise CaseError(
            f"{columns.path}: particle {p} has the mass {masses[0, p]:.6g} kg, the case {start[p]:.6g} kg"
        )
    light = ~(masses >= LIGHTEST * start)
    if light.any():
        frame, p = np.argwhere(light)[0]
        raise CaseError(
            f"{columns.path}: particle {p} has the mass {masses[frame, p]:.6g} kg at output {frame}; "
            f"allowed: from {LIGHTEST:g} of its {start[p]:.6g} kg at the start on"
        )
    return masses, np.full(len(start), bound), True


def _check_diameters(columns: Columns, setup: Setup, units: Units) -> None:
    if "diameter" not in columns.values:
        return
    ours, found = setup.state.diameter, columns.values["diameter"][0] * units.length
    bound = 2.0 * columns.resolution.get("diameter", 0.0) * units.length + UNIT_ROUNDING * ours
    if (np.abs(found - ours) > bound).any():
        p = int(np.abs(found - ours).argmax())
        raise CaseError(
            f"{columns.path}: particle {p} has the diameter {found[p]:.6g} m, the case {ours[p]:.6g} m"
        )


def _run(
    setup: Setup, times: np.ndarray, positions: np.ndarray, masses: np.ndarray, path: Path | None
) -> Run:
    """The run, still without velocities."""
    surface = Heightfield(setup.state.heights, setup.model.spacing) if setup.model.has_surface else None
    return Run(
        case=setup.case,
        times=times,
        positions=positions,
        velocities=np.zeros_like(positions),
        masses=masses,
        contacts=ledger_frame(empty_ledger(0)),
        history=pd.DataFrame(),
        surface_initial=surface,
        surface=surface,
        diameters=setup.state.diameter.copy(),
        provenance={
            **basic_provenance(setup.case, "trajectory"),
            "contacts": UNOBSERVED,
            "copies": setup.copies,
            "complete": True,
        }
        | ({"file": path.name} if path else {}),
    )


def _history(run: Run, setup: Setup) -> pd.DataFrame:
    rows = []
    for k, time in enumerate(run.times):
        state = replace(
            setup.state, position=run.positions[k], velocity=run.velocities[k], mass=run.masses[k]
        )
        rows.append(history_row(float(time), state, setup.state.heights, 0.0, 0.0, setup.case.cost))
    return pd.DataFrame(rows)
