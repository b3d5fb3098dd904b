"""What a run in progress has recorded: the latest rows in memory, the others in parts of its checkpoint.

So the memory that a run takes does not grow with its ledger and its trajectory: there are never more than
`SPILL_BYTES` of rows in it, and one frame or one full buffer of the kernel.  The history stays in memory, 26
numbers for each output.  Files of a run are `recording.py`, those of a checkpoint `checkpoint.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import numpy as np
import pandas as pd

from reference.checkpoint import Arrays, Checkpoint, read_rows
from reference.ledger import KIND, KINDS, I, J, empty_ledger, ledger_frame
from reference.recording import HISTORY, SUMS, TRAJECTORY

SPILL_BYTES = 4 << 20  # of rows in memory, from which on they are written
COLUMNS = [*HISTORY, *SUMS]


class Spool:
    """The rows of a run; without a checkpoint, all of them are in memory."""

    def __init__(self, checkpoint: Checkpoint | None, particles: int) -> None:
        self._checkpoint, self._particles, self._row = checkpoint, particles, empty_ledger(0).shape[1:]
        self._none = {  # of each kind, no row
            "positions": np.empty((0, particles, 3)), "velocities": np.empty((0, particles, 3)),
            "masses": np.empty((0, particles)),
        }  # fmt: skip
        self.times: list[float] = []
        self._history: list[list[float]] = []
        self.ends = self._none  # first and last frame
        self._frames: list[Arrays] = []  # not on the disk yet, as is the rest below
        self._ledger: list[np.ndarray] = []
        self._bytes = self._first = 0  # of rows; number of the first frame

    @property
    def on_disk(self) -> bool:
        """Whether rows are on the disk alone."""
        return self._checkpoint is not None and bool(self._checkpoint.parts)

    def add_frame(self, time: float, frame: Arrays, row: dict[str, float]) -> None:
        """Record a state, arrays of `TRAJECTORY`, which are copied, and its row of the history."""
        frame = {name: frame[name].copy()[np.newaxis] for name in TRAJECTORY}
        self.times.append(time)
        self._history.append([row[name] for name in COLUMNS])
        self._frames.append(frame)
        self._see(frame)
        self._hold(sum(array.nbytes for array in frame.values()))

    def add_contacts(self, rows: np.ndarray) -> None:
        """Record rows of the ledger, which are copied."""
        if len(rows):
            self._ledger.append(rows.copy())
            self._hold(rows.nbytes)

    def take(self) -> Arrays:
        """The rows that are not on the disk yet; the caller puts them there."""
        rows = self._frames_in_memory() | {
            "times": np.array(self.times[self._first :], dtype=float),
            "history": np.array(self._history[self._first :], dtype=float).reshape(-1, len(COLUMNS)),
            "ledger": self._ledger_in_memory(),
        }
        self._frames, self._ledger, self._bytes, self._first = [], [], 0, len(self.times)
        return rows

    def restore(self) -> None:
        """Be as at the checkpoint, which was loaded.  Raises ValueError for rows of no run like this."""
        assert self._checkpoint is not None
        for rows in read_rows(self._checkpoint.files, ("times", "history", "ledger", *TRAJECTORY)):
            self._check(rows)
            self.times += rows["times"].tolist()
            self._history += rows["history"].tolist()
            if len(rows["times"]):
                self._see(rows)
        self._first = len(self.times)

    def history(self) -> pd.DataFrame:
        """A row for each frame."""
        return pd.DataFrame(np.array(self._history).reshape(-1, len(COLUMNS)), columns=COLUMNS)

    def trajectory(self) -> Iterator[Arrays]:
        """Arrays of `TRAJECTORY`, piece by piece, each along time."""
        files = () if self._checkpoint is None else self._checkpoint.files
        return chain(read_rows(files, TRAJECTORY), [self._frames_in_memory()])

    def contacts(self) -> Iterator[pd.DataFrame]:
        """The ledger, piece by piece."""
        files = () if self._checkpoint is None else self._checkpoint.files
        ledger = (rows["ledger"] for rows in read_rows(files, ("ledger",)))
        return map(ledger_frame, chain(ledger, [self._ledger_in_memory()]))

    def _check(self, rows: Arrays) -> None:
        frames, contacts = len(rows["times"]), len(rows["ledger"])
        shapes = {name: (frames, *none.shape[1:]) for name, none in self._none.items()}
        shapes |= {"times": (frames,), "history": (frames, len(COLUMNS)), "ledger": (contacts, *self._row)}
        for name, shape in shapes.items():
            if rows[name].shape != shape or rows[name].dtype != float:
                raise ValueError(f"{name} is {rows[name].dtype} of shape {rows[name].shape}")
        who = rows["ledger"][:, [KIND, I, J]]
        if not ((who >= [0, 0, -1]) & (who < [len(KINDS), self._particles, self._particles])).all():
            raise ValueError("a contact is of no kind or of no particle")

    def _frames_in_memory(self) -> Arrays:
        return {
            name: np.concatenate([self._none[name], *(frame[name] for frame in self._frames)])
            for name in TRAJECTORY
        }

    def _ledger_in_memory(self) -> np.ndarray:
        return np.concatenate([empty_ledger(0), *self._ledger])

    def _see(self, frames: Arrays) -> None:
        """Keep the first and the last frame, which the balances of a run need."""
        first = self.ends if len(self.ends["masses"]) else frames
        self.ends = {name: np.concatenate([first[name][:1], frames[name][-1:]]) for name in TRAJECTORY}

    def _hold(self, size: int) -> None:
        self._bytes += size
        if self._checkpoint is not None and self._bytes > SPILL_BYTES:
            self._checkpoint.spill(self.take())
