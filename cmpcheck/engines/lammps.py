"""LAMMPS as an engine: a setup and a deck become a run.

The deck defines box, styles and fixes; the atoms, the Python fix and the run are added here.  Finding a deck
and filling its variables is `lammps_setup.py`; what the fix does is `cmpcheck/fixes`.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cmpcheck.engines.lammps_library import EngineError, available, error_message, open_lammps, version
from cmpcheck.engines.lammps_setup import (
    NO_QUIT,
    Deck,
    create_atoms,
    deck_path,
    execute,
    input_flags,
    last_words,
    variables,
)
from cmpcheck.engines.observed import Observed, label, observed_run
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import FORMS, MICRO
from cmpcheck.fixes.slurry import DEFINE_STATE, SlurryFix
from cmpcheck.judges.protocol import UNOBSERVED
from cmpcheck.results import EngineInfo
from reference.case import Case
from reference.recording import Run
from reference.state import Setup

OBSERVER = "cmpcheck_observer"  # ID of the fix in decks that need no fix
DEEPEST = 0.1  # of a radius: an overlap that no contact with a wall has
SAID_ALREADY = re.compile(rf"{NO_QUIT}|^Last input line|^\(src/")


class LammpsEngine:
    """Runs the deck of a case, or the user's own: `decks` maps names of cases to files."""

    name = "lammps"
    surface_forms: tuple[str, ...] = ("soft", "impulse")

    def __init__(self, decks: Mapping[str, Path] | None = None) -> None:
        self.decks = dict(decks or {})

    def forms_of(self, case: Case) -> tuple[str, ...]:
        """The forms of surface contact that the deck of a case can be run in: of the fix, or its own."""
        return self.surface_forms if self._deck(case.name).external_fix else ("native",)

    def _deck(self, case: str) -> Deck:
        """The deck of a case.  Raises EngineError."""
        return Deck.read(Path(self.decks.get(case) or deck_path(case)))

    def info(self) -> EngineInfo:
        """Whether LAMMPS can be loaded, and which version."""
        found, reason = available()
        return EngineInfo(self.name, version() if found else "", found, reason)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.  Raises EngineError, with LAMMPS's own words, when that fails.

        The time step is the resolution's, made a little smaller where the output times are no multiple of it.
        """
        refuse_rules_it_lacks(setup)
        deck = self._deck(setup.case.name)
        stride = output_stride(setup.output_times, resolution.time_step)
        time_step = float(setup.output_times[1]) / stride
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
            log = Path(folder) / "log"
            arguments = ["-log", str(log), "-screen", "none", "-var", "driver", "cmpcheck"]
            lmp = open_lammps(arguments + input_flags(variables(setup, resolution, time_step)))
            try:
                return _simulate(lmp, deck, setup, resolution, stride, time_step)
            except EngineError as error:
                raise EngineError(f"{label(setup)}: {error}{last_words(log, SAID_ALREADY)}") from error
            except Exception as error:  # the lammps package raises Exception itself
                if type(error) is not Exception:
                    raise
                message = f"{deck.path}: {error_message(error)}"
                raise EngineError(f"{label(setup)}: {message}{last_words(log, SAID_ALREADY)}") from error
            finally:
                lmp.close()


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


def _simulate(
    lmp: Any, deck: Deck, setup: Setup, resolution: Resolution, stride: int, time_step: float
) -> Run:
    """Read the definitions, create the atoms, attach the fix, run from output to output."""
    execute(lmp, deck.definitions(), deck.path)
    native = deck.external_fix is None
    if native:
        lmp.command(DEFINE_STATE)
    create_atoms(lmp, setup.state)
    lmp.command(deck.external_line or f"fix {OBSERVER} all external pf/callback 1 1")
    fix = SlurryFix(
        lmp,
        deck.external_fix or OBSERVER,
        setup.model,
        setup.state.modulus,
        setup.state.heights,
        pad_height=setup.state.pad_height,
        form="observe" if native else FORMS[0] if resolution.form == "native" else resolution.form,
        contact_duration=resolution.contact_duration,
        sample_every=stride,
        max_samples=len(setup.output_times),
        ledger_speed=setup.case.numerics.ledger_speed,
        observe_pairs=setup.model.has_pairs and len(setup.state.mass) > setup.copies,
        case=label(setup),
    )
    fix.attach()
    lmp.command(f"timestep {time_step / MICRO!r}")
    lmp.command("thermo 0")
    surfaces, pad_heights = [setup.state.heights], [setup.state.pad_height]
    for k in range(len(setup.output_times) - 1):
        lmp.command(f"run {stride} {'pre no ' if k else ''}post no")
        fix.check()
        surfaces.append(fix.heights.copy())
        pad_heights.append(fix.pad_height)
    seen = Observed(*fix.trajectory(), fix.contacts(), surfaces, pad_heights)
    try:
        run = observed_run(setup, resolution, seen, time_step, "lammps", version())
    except ValueError as error:
        raise EngineError(str(error)) from None
    if native and setup.model.has_surface:
        radii = setup.state.diameter / 2
        sunk = (setup.state.heights.max() - (run.positions[:, :, 2] - radii).min(axis=0)) / radii
        if sunk.max() > DEEPEST:
            raise EngineError(
                f"{deck.path} has no surface, but particle {sunk.argmax()} has reached it, and sunk in"
            )
        # A wall of LAMMPS's own may have been struck.  Nothing observes its contacts, as fixes/pairs.py does
        # those of particles: the trajectory is judged.
        run.provenance["contacts"] = UNOBSERVED
    return run
