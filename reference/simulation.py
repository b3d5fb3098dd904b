"""From a case to a run: the loop over output times, and nothing else."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from reference.balances import close_books
from reference.case import Case
from reference.heightfield import Heightfield
from reference.ledger import empty_ledger, ledger_frame
from reference.process import build_setup
from reference.recording import HISTORY, SUMS, Run, basic_provenance, history_row
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
REASONS = {
    NOT_FINITE: "the state is not finite",
    NOT_CONVERGED: "the drag did not converge in 100 iterations",
    STEP_VANISHED: "the adaptive step fell below 1e-9 of the largest step",
}


class SimulationError(RuntimeError):
    """A run that had to stop; `run` holds what was recorded until then."""

    def __init__(self, message: str, run: Run):
        super().__init__(message)
        self.run = run


def simulate(
    case: Case, out: str | os.PathLike[str] | None = None, progress: Callable[[float], None] | None = None
) -> Run:
    """Run one case (one of its `variants()`) and return what was recorded.

    Parameters: `out` a folder to write the run to; `progress` is called with the fraction done.
    Raises CaseError for a case that cannot be set up, and SimulationError, naming particle and time, when
    the state stops being finite, or naming the balance when one does not close; what was recorded before is
    kept in `out` and in the error's `run`.
    """
    return simulate_setup(build_setup(case), out, progress)


def simulate_setup(
    setup: Setup, out: str | os.PathLike[str] | None = None, progress: Callable[[float], None] | None = None
) -> Run:
    """Run a setup, such as several copies of a case side by side; see `simulate`."""
    recorder = _Recorder(setup)
    try:
        recorder.record()
        for t_end in setup.output_times[1:]:
            _advance_to(recorder, float(t_end))
            recorder.record()
            if progress is not None:
                progress(float(t_end / setup.end_time))
        recorder.complete = True
    finally:
        run = recorder.run()
        problem = close_books(run)
        if out is not None:
            run.save(Path(out))
    if problem:
        raise SimulationError(f"{setup.case.name}: {problem}", run)
    return run


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
            **{
                name: getattr(setup.state, name).copy()
                for name in ("position", "velocity", "mass", "heights")
            },
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
            history=pd.DataFrame(self.history, columns=[*HISTORY, *SUMS]),
            diameters=self.state.diameter.copy(),
            provenance=provenance,
            **surfaces,
        )
