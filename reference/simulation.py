"""From a case to a run: the loop over output times, what it records, and going on from a checkpoint."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np
import pandas as pd

from reference.balances import close_books, removing_of_model
from reference.case import Case
from reference.checkpoint import Checkpoint, Saved, finished_run
from reference.heightfield import Heightfield
from reference.ledger import empty_ledger, ledger_frame
from reference.process import build_setup
from reference.recording import HISTORY, SUMS, Run, basic_provenance, history_row, timing
from reference.schemes import Numerics
from reference.state import Setup
from reference.timestep import (
    DONE,
    LEDGER_FULL,
    NOT_CONVERGED,
    NOT_FINITE,
    STEP_VANISHED,
    P,
    advance,
)

LEDGER_ROWS = 16_384  # of the buffer that the kernel fills
PARTICLE_STEPS = 10_000_000  # of a call of the kernel, at most: about a second, in which nothing is saved
CHECKPOINT_INTERVAL = 10.0  # s of wall-clock time
EVOLVING = ("position", "velocity", "mass", "heights")  # arrays of the state
COLUMNS = [*HISTORY, *SUMS]
FRAME = ("times", "positions", "velocities", "masses")
REASONS = {
    NOT_FINITE: "the state is not finite",
    NOT_CONVERGED: "the drag did not converge in 100 iterations",
    STEP_VANISHED: "the adaptive step fell below 1e-9 of the largest step",
}


class Stop(NamedTuple):
    """Where the kernel returns."""

    time: float  # s
    output: bool  # the state is recorded


class SimulationError(RuntimeError):
    """A run that had to stop; `run` holds what was recorded until then."""

    def __init__(self, message: str, run: Run):
        super().__init__(message)
        self.run = run


def simulate(
    case: Case,
    out: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
    resume: bool = False,
    checkpoint_interval: float = CHECKPOINT_INTERVAL,
) -> Run:
    """Run one case (one of its `variants()`) and return what was recorded.

    Parameters: `out` a folder to write the run to; `progress` is called with the fraction done; `resume`
    goes on from the last checkpoint in `out`, to the same arrays, and returns a run that is complete
    already; `checkpoint_interval`, wall-clock time between two checkpoints, s.
    Raises CaseError for a case that cannot be set up and for what another case or version left in `out`, and
    SimulationError, naming particle and time, when the state stops being finite, or a balance when it does
    not close; what was recorded is kept in `out` and in the error's `run`.
    """
    if resume and out is not None:
        finished = finished_run(Path(out), case)
        if finished is not None:
            return finished
    return simulate_setup(build_setup(case), out, progress, resume, checkpoint_interval)


def simulate_setup(
    setup: Setup,
    out: str | os.PathLike[str] | None = None,
    progress: Callable[[float], None] | None = None,
    resume: bool = False,
    checkpoint_interval: float = CHECKPOINT_INTERVAL,
) -> Run:
    """Run a setup, such as several copies of a case side by side; see `simulate`."""
    recorder = _Recorder(setup)
    checkpoint = None if out is None else Checkpoint(Path(out), setup)
    saved = checkpoint.load() if checkpoint is not None and resume else None
    if saved is not None:
        recorder.restore(saved)
    else:
        if checkpoint is not None:
            checkpoint.start()
        recorder.record()
    try:
        last = recorder.start_clock()
        for stop in _stops(setup)[recorder.stops :]:
            if progress is not None:
                progress(recorder.state.time / setup.end_time)
            _advance_to(recorder, stop.time)
            if stop.output:
                recorder.record()
            recorder.stops += 1
            if checkpoint is not None and perf_counter() - last >= checkpoint_interval:
                checkpoint.add(*recorder.news())
                last = perf_counter()
        recorder.complete = True
    finally:
        run = recorder.run()
        problem = close_books(run, removing_of_model(setup.model))
        if out is not None:
            run.provenance["timing"] = timing(
                recorder.wall_time, run.provenance["steps"], len(run.diameters), recorder.sessions
            )
            run.save(Path(out))
    if checkpoint is not None:
        checkpoint.remove()
    if problem:
        raise SimulationError(f"{setup.case.name}: {problem}", run)
    if progress is not None:
        progress(1.0)
    return run


def _stops(setup: Setup) -> list[Stop]:
    """The ends of the kernel's calls: output times, and times between them where a call would take long.

    They depend on the setup alone, never on the clock, because each call starts with a new list of neighbors.
    """
    stops = []
    for begin, end in pairwise(map(float, setup.output_times)):
        steps = (end - begin) / setup.time_step
        calls = max(1, math.ceil(steps * len(setup.state.mass) / PARTICLE_STEPS))
        times = np.linspace(begin, end, calls + 1)[1:]
        stops += [Stop(float(time), time == end) for time in times]
    return stops


def _advance_to(recorder: _Recorder, t_end: float) -> None:
    """Call the kernel until `t_end`, emptying its ledger whenever it is full."""
    setup, state, scalars = recorder.setup, recorder.state, recorder.scalars
    steps = max(1, int(np.ceil((t_end - scalars[P.time]) / setup.time_step - 1e-9)))
    first = scalars[P.steps]
    while True:
        left = int(first + steps - scalars[P.steps])
        before = scalars[P.steps]
        status = advance(
            setup.model,
            recorder.numerics,
            scalars,
            t_end,
            left,
            state.particles,
            state.heights,
            recorder.rows,
        )
        stuck = status == LEDGER_FULL and scalars[P.steps] == before
        recorder.collect()
        if stuck:
            recorder.rows = empty_ledger(2 * len(recorder.rows))
        if status == DONE:
            return
        if status != LEDGER_FULL:
            recorder.record()
            message = f"{REASONS[status]}: particle {int(scalars[P.culprit])} at t = {scalars[P.time]:.6g} s"
            raise SimulationError(f"{setup.case.name}: {message}", recorder.run())


class _Recorder:
    """The state of a run in progress and what has been recorded of it."""

    def __init__(self, setup: Setup):
        self.setup = setup
        part = setup.case.numerics
        self.state = replace(
            setup.state,
            **{name: getattr(setup.state, name).copy() for name in EVOLVING},
        )
        self.numerics = Numerics(
            time_step=setup.time_step,
            fixed_point=part.scheme == "fixed_point",
            tolerance=part.tolerance,
            iterations=part.iterations,
            printed_norm=part.norm == "printed",
            iterated_contacts=part.contacts == "iterated",
            ledger_speed=part.ledger_speed,
        )
        self.scalars = np.zeros(len(P))
        self.scalars[P.step], self.scalars[P.pad_height] = setup.time_step, setup.state.pad_height
        self.rows = empty_ledger(LEDGER_ROWS)
        self.chunks: list[np.ndarray] = []
        self.frames: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
        self.history: list[dict[str, float]] = []
        self.complete = False
        self.stops = 0  # passed
        self.saved = (0, 0)  # frames and chunks that are in the checkpoint
        self.begin, self.earlier, self.sessions = perf_counter(), 0.0, 1

    def start_clock(self) -> float:
        """Begin to count wall-clock time, s, when the kernel is compiled: no step is enough for that."""
        now = self.scalars[P.time]
        advance(
            self.setup.model, self.numerics, self.scalars, now, 0,
            self.state.particles, self.state.heights, self.rows,
        )  # fmt: skip
        self.begin = perf_counter()
        return self.begin

    def collect(self) -> None:
        """Move the kernel's ledger rows out of its buffer."""
        used = int(self.scalars[P.rows])
        self.chunks.append(self.rows[:used].copy())
        self.scalars[P.rows] = 0
        self.state.time, self.state.pad_height = self.scalars[P.time], self.scalars[P.pad_height]

    def record(self) -> None:
        """Record the present state."""
        state = self.state
        self.frames.append((state.time, state.position.copy(), state.velocity.copy(), state.mass.copy()))
        volume, mass = self.scalars[P.removed_volume], self.scalars[P.removed_mass]
        row = history_row(state.time, state, self.setup.state.heights, volume, mass, self.setup.case.cost)
        self.history.append(row | {name: float(self.scalars[getattr(P, name)]) for name in SUMS})

    @property
    def wall_time(self) -> float:
        """Of all sessions, s."""
        return self.earlier + perf_counter() - self.begin

    def news(self) -> Saved:
        """What was recorded since it was last asked for, and the present state, for a checkpoint."""
        frames, chunks = self.saved
        self.saved = len(self.frames), len(self.chunks)
        new = self.frames[frames:]  # none where the kernel stopped between output times
        rows = {
            name: np.array([frame[k] for frame in new]).reshape(len(new), *np.shape(self.frames[0][k]))
            for k, name in enumerate(FRAME)
        }
        rows["history"] = pd.DataFrame(self.history[frames:], columns=COLUMNS).to_numpy(dtype=float)
        rows["ledger"] = np.concatenate([*self.chunks[chunks:], self.rows[:0]])
        state = {name: getattr(self.state, name) for name in EVOLVING} | {
            "progress": self.scalars,
            "counts": np.array([self.stops, self.sessions, len(self.rows)]),
            "wall_time": np.array(self.wall_time),
        }
        return Saved(rows, state)

    def restore(self, saved: Saved) -> None:
        """Be as at a checkpoint; a ledger buffer of the same length stops the kernel at the same steps."""
        rows, state = saved
        for name in EVOLVING:
            getattr(self.state, name)[...] = state[name]
        self.scalars[:] = state["progress"]
        self.state.time, self.state.pad_height = self.scalars[P.time], self.scalars[P.pad_height]
        self.stops, sessions, buffer = map(int, state["counts"])
        self.rows = empty_ledger(buffer)
        self.frames = list(zip(*(rows[name] for name in FRAME), strict=True))
        self.history = [dict(zip(COLUMNS, row, strict=True)) for row in rows["history"].tolist()]
        self.chunks = [rows["ledger"]]
        self.saved = len(self.frames), len(self.chunks)
        self.earlier, self.sessions = float(state["wall_time"]), sessions + 1

    def run(self) -> Run:
        """What has been recorded, as a run."""
        times, positions, velocities, masses = (np.array(column) for column in zip(*self.frames, strict=True))
        surfaces = {}
        if self.setup.model.has_surface:
            spacing = self.setup.model.spacing
            surfaces = {
                "surface_initial": Heightfield(self.setup.state.heights, spacing),
                "surface": Heightfield(self.state.heights, spacing),
            }
        provenance = basic_provenance(self.setup.case, "reference") | {
            "complete": self.complete,
            "steps": int(self.scalars[P.steps]),
            "rejected_steps": int(self.scalars[P.rejected]),
            "largest_duration_over_step": float(self.scalars[P.largest_ratio]),
            "notes": list(self.setup.notes),
        }
        return Run(
            case=self.setup.case,
            times=times,
            positions=positions,
            velocities=velocities,
            masses=masses,
            contacts=ledger_frame(np.concatenate([*self.chunks, self.rows[:0]])),
            history=pd.DataFrame(self.history, columns=COLUMNS),
            diameters=self.state.diameter.copy(),
            provenance=provenance,
            **surfaces,
        )
