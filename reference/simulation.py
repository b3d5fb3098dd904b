"""From a case to a run: the loop over output times, what it records, and going on from a checkpoint."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from reference.balances import close_books, removing_of_model
from reference.case import Case
from reference.checkpoint import DAMAGE, Arrays, Checkpoint, Saved, finished_run
from reference.fast.stepper import BOOKED, advance_fast
from reference.fast.swarm import MANY
from reference.heightfield import Heightfield
from reference.ledger import empty_ledger, ledger_frame
from reference.process import build_setup
from reference.recording import SUMS, TRAJECTORY, Run, basic_provenance, history_row, timing
from reference.schemes import Numerics
from reference.spool import Spool
from reference.state import Setup
from reference.timestep import (
    DONE,
    LEDGER_FULL,
    NOT_CONVERGED,
    NOT_FINITE,
    STEP_VANISHED,
    P,
    advance,
    new_progress,
)

LEDGER_ROWS = 16_384  # of the buffer that the kernel fills
MOST_LEDGER_ROWS = 1 << 27  # of a buffer in a checkpoint that is believed, 24 GB
PARTICLE_STEPS = 10_000_000  # of a call of the kernel, at most: about a second, in which nothing is saved
LEAST_STEPS = 256  # of a call, even so: each begins with new lists, and with a look at every particle
CHECKPOINT_INTERVAL = 10.0  # s of wall-clock time
EVOLVING = ("position", "velocity", "mass", "heights")  # arrays of the state
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
    With `out`, the memory taken does not grow with the ledger and the trajectory (see `spool.py`): those of a
    long run are on the disk, and read from there when they are first asked for.
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
    checkpoint = None if out is None else Checkpoint(Path(out), setup)
    recorder = _Recorder(setup, checkpoint)
    saved = checkpoint.load() if checkpoint is not None and resume else None
    if checkpoint is not None and saved is not None:
        try:
            recorder.restore(saved)
        except DAMAGE as damage:
            raise checkpoint.damaged(damage) from None
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
        ends = recorder.ends()
        problem = close_books(ends, removing_of_model(setup.model))
        run = recorder.run(ends.provenance)
        if out is not None:
            run.provenance["timing"] = timing(
                recorder.wall_time, run.provenance["steps"], len(run.diameters), recorder.sessions
            )
            run.save_pieces(Path(out), recorder.spool.trajectory(), recorder.spool.contacts())
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
        calls = max(1, math.ceil(steps * min(len(setup.state.mass) / PARTICLE_STEPS, 1.0 / LEAST_STEPS)))
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
        status = recorder.advance(
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


def ledger_room(count: int) -> int:
    """Rows of the buffer that the kernel fills at first: of many particles for some hundred steps."""
    return LEDGER_ROWS if count < MANY else max(4 * LEDGER_ROWS, count)


class _Recorder:
    """The state of a run in progress and what has been recorded of it."""

    def __init__(self, setup: Setup, checkpoint: Checkpoint | None = None):
        self.setup, self.checkpoint = setup, checkpoint
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
        self.advance = advance_fast if part.stepper == "fast" else advance
        self.scalars = new_progress()
        self.scalars[P.step], self.scalars[P.pad_height] = setup.time_step, setup.state.pad_height
        self.rows = empty_ledger(ledger_room(len(setup.state.mass)))
        self.spool = Spool(checkpoint, len(setup.state.mass))
        self.complete = False
        self.stops = 0  # passed
        self.begin, self.earlier, self.sessions = perf_counter(), 0.0, 1

    def start_clock(self) -> float:
        """Begin to count wall-clock time, s, when the kernel is compiled: no step is enough for that."""
        now = self.scalars[P.time]
        self.advance(
            self.setup.model, self.numerics, self.scalars, now, 0,
            self.state.particles, self.state.heights, self.rows,
        )  # fmt: skip
        self.begin = perf_counter()
        return self.begin

    def collect(self) -> None:
        """Move the kernel's ledger rows out of its buffer."""
        self.spool.add_contacts(self.rows[: int(self.scalars[P.rows])])
        self.scalars[P.rows] = 0
        self.state.time, self.state.pad_height = self.scalars[P.time], self.scalars[P.pad_height]

    def record(self) -> None:
        """Record the present state."""
        state = self.state
        volume, mass = self.scalars[P.removed_volume], self.scalars[P.removed_mass]
        row = history_row(state.time, state, self.setup.state.heights, volume, mass, self.setup.case.cost)
        row |= dict.fromkeys(SUMS, math.nan)
        booked = SUMS if self.advance is advance else BOOKED
        row |= {name: float(self.scalars[getattr(P, name)]) for name in booked}
        frame = dict(zip(TRAJECTORY, (state.position, state.velocity, state.mass), strict=True))
        self.spool.add_frame(state.time, frame, row)

    @property
    def wall_time(self) -> float:
        """Of all sessions, s."""
        return self.earlier + perf_counter() - self.begin

    def news(self) -> tuple[Arrays, Arrays]:
        """The rows that are not on the disk yet, and the present state, for a checkpoint."""
        state = {name: getattr(self.state, name) for name in EVOLVING} | {
            "progress": self.scalars,
            "counts": np.array([self.stops, self.sessions, len(self.rows)]),
            "wall_time": np.array(self.wall_time),
        }
        return self.spool.take(), state

    def restore(self, saved: Saved) -> None:
        """Be as at a checkpoint; a ledger buffer of the same length stops the kernel at the same steps."""
        state = saved.state
        for name in EVOLVING:
            getattr(self.state, name)[...] = state[name]
        self.scalars[:] = state["progress"]
        self.state.time, self.state.pad_height = self.scalars[P.time], self.scalars[P.pad_height]
        self.stops, sessions, buffer = map(int, state["counts"])
        now, step = self.scalars[P.time], self.scalars[P.step]
        if not (
            0 <= self.stops <= len(_stops(self.setup))
            and 0 < buffer <= MOST_LEDGER_ROWS
            and 0.0 <= now <= self.setup.end_time
            and 0.0 < step <= self.setup.time_step
            and 0.0 <= self.scalars[P.steps] < 1e18
        ):
            raise ValueError(f"stop {self.stops}, a buffer of {buffer} rows, time {now:g} s, step {step:g} s")
        self.rows = empty_ledger(buffer)
        self.spool.restore()
        self.earlier, self.sessions = float(state["wall_time"]), sessions + 1

    def run(self, provenance: dict[str, Any] | None = None) -> Run:
        """What has been recorded, as a run; from the disk what is there already, when it is asked for."""
        known = self._known(provenance)
        if self.spool.on_disk:
            assert self.checkpoint is not None
            return Run.open(self.checkpoint.folder.parent, **known)
        (trajectory,), (contacts,) = self.spool.trajectory(), self.spool.contacts()
        return Run(**(known | trajectory), contacts=contacts)

    def ends(self) -> Run:
        """The run without its ledger, and of its trajectory only the first and the last frame."""
        return Run(**(self._known(None) | self.spool.ends), contacts=ledger_frame(empty_ledger(0)))

    def _known(self, provenance: dict[str, Any] | None) -> dict[str, Any]:
        """The fields of a run without trajectory and ledger."""
        surfaces: dict[str, Heightfield | None] = {"surface_initial": None, "surface": None}
        if self.setup.model.has_surface:
            spacing = self.setup.model.spacing
            surfaces = {
                "surface_initial": Heightfield(self.setup.state.heights, spacing),
                "surface": Heightfield(self.state.heights, spacing),
            }
        return {
            "case": self.setup.case,
            "times": np.array(self.spool.times),
            "history": self.spool.history(),
            "diameters": self.state.diameter.copy(),
            "provenance": self._provenance() if provenance is None else provenance,
            **surfaces,
        }

    def _provenance(self) -> dict[str, Any]:
        return basic_provenance(self.setup.case, "reference") | {
            "complete": self.complete,
            "steps": int(self.scalars[P.steps]),
            "rejected_steps": int(self.scalars[P.rejected]),
            "largest_duration_over_step": float(self.scalars[P.largest_ratio]),
            "notes": list(self.setup.notes),
        }
