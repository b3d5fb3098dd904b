"""LAMMPS as an engine: a setup and a deck become a run, computed in a child process.

In a child, so that a crash, or a run without end, is an error of that run alone.  What happens there is
`lammps_run.py`; finding a deck and filling its variables is `lammps_setup.py`; what the fix does is
`cmpcheck/fixes`.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cmpcheck.engines.child import ChildError, ChildLost, shared_child
from cmpcheck.engines.lammps_library import INSTALL, EngineError, probe
from cmpcheck.engines.lammps_run import simulate
from cmpcheck.engines.lammps_setup import NO_QUIT, Deck, deck_path, last_words
from cmpcheck.engines.observed import Observed, label, observed_run
from cmpcheck.engines.protocol import Resolution, timeout_of
from cmpcheck.judges.protocol import UNOBSERVED
from cmpcheck.results import EngineInfo
from reference.case import Case
from reference.recording import Run
from reference.state import Setup

ANSWERS_WITHIN = 120.0  # s, until it is known whether LAMMPS can be loaded
DEEPEST = 0.1  # of a radius: an overlap that no contact with a wall has
SAID_ALREADY = re.compile(rf"{NO_QUIT}|^Last input line|^\(src/|^Total wall time")


class LammpsEngine:
    """Runs the deck of a case, or the user's own: `decks` maps names of cases to files.

    `in_process`: here instead of in the child, for those who guard this process themselves.
    """

    name = "lammps"
    surface_forms: tuple[str, ...] = ("soft", "impulse")

    def __init__(self, decks: Mapping[str, Path] | None = None, in_process: bool = False) -> None:
        self.decks, self.in_process = dict(decks or {}), in_process

    def forms_of(self, case: Case) -> tuple[str, ...]:
        """The forms of surface contact that the deck of a case can be run in: of the fix, or its own."""
        return self.surface_forms if self._deck(case.name).external_fix else ("native",)

    def _deck(self, case: str) -> Deck:
        """The deck of a case.  Raises EngineError."""
        return Deck.read(Path(self.decks.get(case) or deck_path(case)))

    def info(self) -> EngineInfo:
        """Whether LAMMPS can be loaded, and which version; asked in the child, for its MPI may abort."""
        found, reason = probe() if self.in_process else _asked()
        return EngineInfo(self.name, found, bool(found), reason)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.  Raises EngineError, with LAMMPS's own words, when that fails.

        The time step is the resolution's, made a little smaller where the output times are no multiple of it.
        """
        refuse_rules_it_lacks(setup)
        deck = self._deck(setup.case.name)
        stride = output_stride(setup.output_times, resolution.time_step)
        time_step = float(setup.output_times[1]) / stride
        limit = timeout_of(setup.case, self.name)
        try:
            seen = self._observe(limit, (deck, setup, resolution, stride, time_step))
            run = observed_run(setup, resolution, seen, time_step, self.name, self.info().version)
            run.provenance["deck_digest"] = deck.digest
            if deck.external_fix is None and setup.model.has_surface:
                _require_no_surface_struck(deck, setup, run)
        except (EngineError, ValueError) as error:
            raise EngineError(f"{label(setup)}: {error}") from error
        return run

    def _observe(self, limit: float, asked: tuple[Deck, Setup, Resolution, int, float]) -> Observed:
        """What a run shows, made in the child or here; its failures end with the last lines of the log."""
        if not self.in_process:
            seen: Observed = ask_child(simulate, *asked, timeout=limit)
            return seen
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
            log = Path(folder) / "log"
            try:
                return simulate(*asked, log)
            except EngineError as error:
                raise EngineError(f"{error}{last_words(log, SAID_ALREADY)}") from error


@cache
def _asked() -> tuple[str, str]:
    """What `probe` finds in the child; where that dies, why."""
    try:
        found: tuple[str, str] = ask_child(probe, timeout=ANSWERS_WITHIN)
    except EngineError as error:
        return "", f"{error}; {INSTALL}"
    return found


def ask_child(function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
    """The value of function(*arguments) in this process's child for LAMMPS.

    Raises EngineError, with the last that LAMMPS said, when the child dies, is late or raises.
    """
    child = shared_child("lammps")
    try:
        return child.call(function, *arguments, timeout=timeout)
    except ChildError as error:
        name = "LAMMPS: " if isinstance(error, ChildLost) else ""
        raise EngineError(f"{name}{error}{last_words(child.output, SAID_ALREADY)}") from None


def output_stride(times: np.ndarray, time_step: float) -> int:
    """Steps between two outputs, with steps of at most `time_step`.

    Raises EngineError when the output times are not equally spaced.

    >>> output_stride(np.linspace(0.0, 1.0, 11), 0.03)
    4
    """
    if len(times) < 2 or not np.allclose(np.diff(times), times[1], rtol=1e-9, atol=0.0):
        raise EngineError("the output times must be equally spaced, the first at 0")
    return max(1, math.ceil(float(times[1]) / time_step - 1e-6))


def refuse_rules_it_lacks(setup: Setup) -> None:
    """Raise EngineError where the case asks for what the fix does not do."""
    if setup.model.new_contacts_only:
        raise EngineError(
            "removal.new_contacts_only is true; allowed with LAMMPS: false, for its fix has no such rule"
        )


def _require_no_surface_struck(deck: Deck, setup: Setup, run: Run) -> None:
    """Raise EngineError where a particle reached a surface that a deck without the fix has not."""
    radii = setup.state.diameter / 2
    sunk = (setup.state.heights.max() - (run.positions[:, :, 2] - radii).min(axis=0)) / radii
    if sunk.max() > DEEPEST:
        raise EngineError(
            f"{deck.path} has no surface, but particle {sunk.argmax()} has reached it, and sunk in"
        )
    # A wall of LAMMPS's own may have been struck.  Nothing observes its contacts, as fixes/pairs.py does
    # those of particles: the trajectory is judged.
    run.provenance["contacts"] = UNOBSERVED
