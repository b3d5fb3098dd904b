"""LIGGGHTS as an engine: a setup and a deck become a run, computed in a child process.

In process, through its library, because the surface has to be lowered and read again in mid-run and contacts
are followed step by step; in a child, because any error of LIGGGHTS ends its process, and its Open MPI cannot
be in one process with LAMMPS's MPICH.  What happens in the child is `liggghts_run.py`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cmpcheck.engines.child import ChildError, shared_child
from cmpcheck.engines.lammps import output_stride, refuse_rules_it_lacks
from cmpcheck.engines.lammps_library import EngineError
from cmpcheck.engines.lammps_setup import Deck, deck_path, last_words
from cmpcheck.engines.liggghts_library import available, version
from cmpcheck.engines.liggghts_run import simulate
from cmpcheck.engines.observed import label, observed_run
from cmpcheck.engines.protocol import Resolution, timeout_of
from cmpcheck.results import EngineInfo
from reference.recording import Run
from reference.state import Setup

NOISE = re.compile(
    r"WARNING! (Style|VariantSelector) collision|whitelist|needs to be recompiled"
    r"|^\s*[\d.\s]*$|^Loop time|^\s*Step\s*$"
)


class LiggghtsEngine:
    """Runs the LIGGGHTS deck of a case, or the user's own: `decks` maps names of cases to files."""

    name = "liggghts"
    surface_forms: tuple[str, ...] = ("soft",)

    def __init__(self, decks: Mapping[str, Path] | None = None) -> None:
        self.decks = dict(decks or {})

    def info(self) -> EngineInfo:
        """Whether LIGGGHTS is installed, and which version."""
        found, reason = available()
        return EngineInfo(self.name, version(), found, reason)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.  Raises EngineError, with LIGGGHTS's own words, when that fails.

        The time step is the resolution's, made a little smaller where the output times are no multiple of it.
        """
        refuse_rules_it_lacks(setup)
        path = Path(self.decks.get(setup.case.name) or deck_path(setup.case.name, self.name))
        deck = Deck.read(path)
        stride = output_stride(setup.output_times, resolution.time_step)
        time_step = float(setup.output_times[1]) / stride
        limit = timeout_of(setup.case, self.name)
        try:
            seen = ask_child(simulate, deck, setup, resolution, stride, time_step, timeout=limit)
            run = observed_run(setup, resolution, seen, time_step, self.name, version())
        except EngineError as error:
            raise EngineError(f"{label(setup)}: {error}") from None
        except ValueError as error:
            raise EngineError(f"{label(setup)}: LIGGGHTS: {error}") from None
        run.provenance["deck_digest"] = deck.digest
        return run


def ask_child(function: Callable[..., Any], *arguments: Any, timeout: float) -> Any:
    """The value of function(*arguments), in this process's child, where LIGGGHTS may be opened.

    Raises EngineError, with the last that LIGGGHTS said, when the child dies, is late or raises.
    """
    child = shared_child("liggghts")
    try:
        return child.call(function, *arguments, timeout=timeout)
    except ChildError as error:
        raise EngineError(f"LIGGGHTS: {error}{last_words(child.output, NOISE)}") from None
