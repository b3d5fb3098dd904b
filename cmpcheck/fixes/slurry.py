"""`SlurryFix`: surface, pad, drag and removal for a LAMMPS deck, through `fix external pf/callback`.

How a deck and a driver use it:

    units       micro                      # um, us, pg
    atom_style  sphere 1
    fix         cmpcheck_state all property/atom d2_cmpcheck 49 d2_cmpcheck_given 4   # DEFINE_STATE
    fix         slurry all external pf/callback 1 1                  # after the fixes that add forces

    fix = SlurryFix(lmp, "slurry", model, modulus, heights, form="soft", contact_duration=1e-9, ...)
    fix.attach()
    lmp.command("run 1000")
    fix.check()                            # after every run; raises EngineError if the callback gave up
    fix.contacts(), fix.trajectory(), fix.heights, fix.pad_height

Atom tags are 1 ... N and particle i of the ledger is tag i + 1.  With more than one rank, call all methods on
all ranks.  The physics is `particles.py` and `contacts.py` (compiled) and `plain.py` (to read);
pairs are `pairs.py`.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import pandas as pd

from cmpcheck.engines.lammps_library import (
    EngineError,
    fix_style_and_group,
    per_atom,
    per_atom_columns,
    set_external_callback,
)
from cmpcheck.fixes.layout import ERRORS, FORMS, GIVEN_COLUMNS, MICRO, NO_ERROR, STATE_COLUMNS
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.python_driver import PythonCallback
from reference.state import Model

DEFINE_STATE = (
    f"fix cmpcheck_state all property/atom d2_cmpcheck {STATE_COLUMNS} d2_cmpcheck_given {GIVEN_COLUMNS}"
)


def defines_state(lmp: Any) -> bool:
    """Whether the per-atom arrays of the fix are there, as `DEFINE_STATE` makes them."""
    return (per_atom_columns(lmp, "d2_cmpcheck"), per_atom_columns(lmp, "d2_cmpcheck_given")) == (
        STATE_COLUMNS,
        GIVEN_COLUMNS,
    )


class SlurryFix:
    """The part of a simulation that LAMMPS does not have, attached to one instance of it.

    Parameters: `lmp` an open LAMMPS instance; `fix_id` of its `fix external`; `model` the constants, SI;
    `modulus` (N,) E/(1-nu^2) of each particle in the order of tags, Pa; `heights` (nx, ny) in m, copied;
    `pad_height` H at the start, m, NaN without a pad;
    `form` "soft" (spring-dashpot), "impulse" (F = J/dt for one step) or "observe" (no force at all);
    `contact_duration` of a soft contact, and half the longest wait of an impulse, s; `sample_every` steps of
    the trajectory, 0 for none; `max_contacts`, `max_samples` size the memory (touched only as it fills);
    `ledger_speed` (m/s): slower contacts that remove nothing are not kept;
    `observe_pairs` follows LAMMPS's own contacts between particles; `compiled` False: plain Python;
    `comm` the mpi4py communicator, by default that of `lmp`; `case` the name to be used in errors.
    Raises EngineError when the model needs what this fix has not, or the deck does not fit.
    """

    def __init__(
        self,
        lmp: Any,
        fix_id: str,
        model: Model,
        modulus: np.ndarray,
        heights: np.ndarray,
        *,
        pad_height: float = math.nan,
        form: str = "soft",
        contact_duration: float = 0.0,
        sample_every: int = 0,
        max_contacts: int = 1_000_000,
        max_samples: int = 1_000,
        ledger_speed: float = 0.0,
        observe_pairs: bool = False,
        compiled: bool = True,
        comm: Any = None,
        case: str = "",
    ) -> None:
        if form not in FORMS:
            raise EngineError(f"form = {form!r}: must be one of {', '.join(FORMS)}")
        if model.has_pad and not math.isfinite(pad_height):
            raise EngineError(f"pad_height = {pad_height}: the model has a pad, its height must be given")
        if model.has_surface and min(np.shape(heights), default=0) == 0:
            raise EngineError("the model has a surface, but heights is empty")
        try:
            self.memory = Memory(
                model, modulus, heights, form, contact_duration, sample_every, max_contacts, max_samples,
                observe_pairs, pad_height, ledger_speed,
            )  # fmt: skip
        except ValueError as error:
            raise EngineError(str(error)) from None
        self.lmp, self.fix_id, self.model, self.case = lmp, fix_id, model, case
        self.compiled = compiled and not numba.config.DISABLE_JIT
        self.comm = comm if comm is not None else lmp.get_mpi_comm()
        if self.comm is not None and self.comm.size == 1:
            self.comm = None
        self._callback: Any = None

    @property
    def heights(self) -> np.ndarray:
        """Node heights (nx, ny) in m, as they are now; the same on every rank."""
        return self.memory.heights

    @property
    def pad_height(self) -> float:
        """Height H of the pad in m at the last step that was run, NaN without one; the same on every rank."""
        return float(self.memory.context.pad_height)

    def attach(self) -> None:
        """Hand the callback to LAMMPS; the atoms and both fixes must have been defined.

        It adds its forces to those of LAMMPS itself, so the `fix external` is defined again, in its place:
        what `fix_modify` has changed of it is lost.
        Raises EngineError when the deck does not define what the fix needs.
        """
        self._check_deck()
        self.memory.connect(self.lmp)
        self.memory.context.largest = self._largest_diameter()
        if self.compiled and self.comm is None:
            from cmpcheck.fixes.callback import compiled_callback, compiled_observer

            self._callback = compiled_callback()
            if self.memory.context.observe_pairs or self.memory.context.sample_every:
                self.memory.context.observe_at = compiled_observer().address
            address = self._callback.address
        else:
            self._callback = PythonCallback(self.lmp, self.memory, self.compiled, self.comm)
            address = self._callback.address
        set_external_callback(self.lmp, self.fix_id, address, self.memory.address)

    def _check_deck(self) -> None:
        lmp, n = self.lmp, len(self.memory.modulus)
        if lmp.extract_global("units") != "micro":
            raise EngineError(f"units = {lmp.extract_global('units')}: the deck must use `units micro`")
        if not (lmp.extract_setting("radius_flag") and lmp.extract_setting("rmass_flag")):
            raise EngineError("the deck must use `atom_style sphere 1`")
        if lmp.get_natoms() != n:
            raise EngineError(f"LAMMPS has {lmp.get_natoms():.0f} atoms, the case has {n} particles")
        nlocal = lmp.extract_setting("nlocal")
        last = int(lmp.numpy.extract_atom("id")[:nlocal].max()) if nlocal else 0
        if self.comm is not None:
            last = max(self.comm.allgather(last))
        if last != n:
            raise EngineError(f"atom tags must be 1 ... {n}, the largest is {last}")
        self._check_external()
        if not defines_state(lmp):
            raise EngineError(f"the deck must define the per-atom state of the fix: {DEFINE_STATE}")

    def _check_external(self) -> None:
        if not self.lmp.has_id("fix", self.fix_id):
            return  # `set_external_callback` says what is missing
        found = fix_style_and_group(self.lmp, self.fix_id)
        style, group = found if self.comm is None else self.comm.bcast(found)
        if (style, group) != ("external", "all"):
            raise EngineError(
                f"fix {self.fix_id} has the style {style} and the group {group}: the deck must use "
                f"`fix {self.fix_id} all external pf/callback 1 1`"
            )

    def _largest_diameter(self) -> float:
        nlocal = self.lmp.extract_setting("nlocal")
        largest = 2.0 * float(per_atom(self.lmp, "radius", nlocal, 1).max(initial=0.0)) * MICRO
        return largest if self.comm is None else max(self.comm.allgather(largest))

    def check(self) -> None:
        """Raise EngineError, naming case, step and particle, if the callback has given up."""
        c = self.memory.context
        failure = getattr(self._callback, "failure", None)
        mine = (int(c.error), int(c.error_step), int(c.error_tag), repr(failure) if failure else "")
        everyone = [mine] if self.comm is None else self.comm.allgather(mine)
        if any(code != NO_ERROR or message for code, _, _, message in everyone):
            self.lmp.command("timer timeout off")  # the callback ran it out to stop the run
        for code, step, tag, message in everyone:
            name = f"{self.case}: " if self.case else ""
            if code != NO_ERROR:
                raise EngineError(f"{name}step {step}, particle {tag - 1}: {ERRORS[code]}")
            if message:
                raise EngineError(f"{name}the fix failed: {message}") from failure

    def contacts(self) -> pd.DataFrame:
        """The ledger of all contacts that have ended, SI, sorted by time and particle.

        Impulse, friction and energy of a pair contact are NaN when another one of the same particles
        overlapped it in time: LAMMPS gives the sum of their forces only.
        """
        rows = self.memory.rows[: self.memory.context.rows]
        if self.comm is not None:
            rows = np.concatenate(self.comm.allgather(rows))
        return self.memory.contacts(rows)

    def trajectory(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times (T,), positions (T, N, 3) wrapped, full-step velocities (T, N, 3), masses (T, N); SI."""
        samples = self.memory.samples[: self.memory.context.samples]
        if self.comm is not None:
            samples = self.comm.bcast(samples)
        return self.memory.trajectory(samples)
