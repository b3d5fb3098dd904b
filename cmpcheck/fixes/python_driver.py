"""The callback as a Python function: for more than one MPI rank, and for the plain form.

Each rank advances its own atoms; the ranks then agree on errors and on what the surface has lost, which every
rank applies in the same order to its copy.  One reduction per step; more only when something has happened.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from cmpcheck.engines.lammps_library import CALLBACK, per_atom
from cmpcheck.fixes import particles, plain
from cmpcheck.fixes.contacts import lower_pad
from cmpcheck.fixes.layout import BY_TAG_COLUMNS, GIVEN_COLUMNS, MICRO, NO_ERROR, STATE_COLUMNS
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.pairs import observe_pairs
from cmpcheck.fixes.particles import remove_in_order
from cmpcheck.fixes.samples import collect_by_tag, is_sampled, store_sample


class PythonCallback:
    """A callback for `fix external`; `failure` is the exception that has stopped it."""

    def __init__(self, lmp: Any, memory: Memory, compiled: bool, comm: Any) -> None:
        self.lmp, self.memory, self.comm = lmp, memory, comm
        self.advance = particles.advance_particles if compiled else plain.advance_particles
        self.failure: BaseException | None = None
        self._function = CALLBACK(self._call)

    @property
    def address(self) -> int:
        """Address of the C form of this callback."""
        return ctypes.cast(self._function, ctypes.c_void_p).value or 0

    def _call(self, _: Any, step: int, n: int, tags_at: Any, x_at: Any, __: Any) -> None:
        tags = np.ctypeslib.as_array(tags_at, shape=(n,)) if n else np.empty(0, np.int32)
        x = np.ctypeslib.as_array(x_at[0], shape=(n, 3)) if n else np.empty((0, 3))
        try:
            self._step(step, tags, x)
        except BaseException as failure:  # LAMMPS would print it and go on
            self.failure = self.failure or failure
            self.lmp.force_timeout()

    def _step(self, step: int, tags: np.ndarray, x: np.ndarray) -> None:
        memory, c, n = self.memory, self.memory.context, len(tags)
        c.time_step = self.lmp.extract_global("dt") * MICRO
        v, f = per_atom(self.lmp, "v", n, 3), per_atom(self.lmp, "f", n, 3)
        radius, mass = per_atom(self.lmp, "radius", n, 1), per_atom(self.lmp, "rmass", n, 1)
        state = per_atom(self.lmp, "d2_cmpcheck", n, STATE_COLUMNS)
        given = per_atom(self.lmp, "d2_cmpcheck_given", n, GIVEN_COLUMNS)
        first, adds = int(c.rows), not (c.observe_pairs or is_sampled(c, step))
        if c.error == NO_ERROR and self.failure is None:
            try:
                lower_pad(c, step)
                self.advance(
                    c, step, adds, tags, x.ravel(), v.ravel(), f.ravel(), radius, mass, state, given.ravel(),
                    memory.modulus,
                    memory.heights, memory.rows, memory.local, memory.near,
                )  # fmt: skip
            except Exception as failure:
                self.failure = failure
        impacts, errors = self._sum(int(c.rows) - first, int(c.error != NO_ERROR or self.failure is not None))
        if errors:
            self.lmp.force_timeout()
            return
        if impacts:
            rows = self._gather_rows(memory.rows[first : c.rows])
            remove_in_order(c, memory.heights, rows, 0, len(rows))
        if step != c.last_step:
            self._observe(step, tags, x, v, f, radius, mass, given)
        if not adds:
            particles.add_all(f.ravel(), given.ravel())
        c.last_step = step

    def _observe(self, step: int, tags: np.ndarray, *arrays: np.ndarray) -> None:
        """Pairs and trajectory, on the first rank."""
        memory, c = self.memory, self.memory.context
        sampled = is_sampled(c, step)
        if not (sampled or c.observe_pairs):
            return
        collect_by_tag(c, tags, *arrays, memory.by_tag)
        if not self._reduce_by_tag():
            return
        if c.observe_pairs:
            observe_pairs(
                c, step, memory.by_tag, memory.modulus, memory.position, memory.pairs, memory.listed,
                memory.open_pairs, memory.rows,
            )  # fmt: skip
        if sampled and c.error == NO_ERROR:
            store_sample(c, step, memory.by_tag, memory.samples)

    def _sum(self, impacts: int, errors: int) -> tuple[int, int]:
        if self.comm is None:
            return impacts, errors
        totals = np.empty(2, dtype=np.int64)
        self.comm.Allreduce(np.array([impacts, errors], dtype=np.int64), totals)
        return int(totals[0]), int(totals[1])

    def _gather_rows(self, rows: np.ndarray) -> np.ndarray:
        if self.comm is None:
            return rows
        return np.concatenate(self.comm.allgather(rows))

    def _reduce_by_tag(self) -> bool:
        """Put all ranks' atoms together on the first rank (the others hold zeros); whether this is it."""
        if self.comm is None:
            return True
        total = np.zeros((len(self.memory.by_tag), BY_TAG_COLUMNS))
        self.comm.Reduce(self.memory.by_tag, total, root=0)
        self.memory.by_tag[:] = total
        return bool(self.comm.rank == 0)
