"""One run of LAMMPS: from a deck and a setup to what was observed, in whatever process this is called.

The deck defines box, styles and fixes; the atoms, the Python fix and the run are added here.  Which process
that is, how long it may take and what becomes of a failure is `lammps.py`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cmpcheck.engines.child import write_lines_at_once
from cmpcheck.engines.lammps_library import EngineError, error_message, open_lammps
from cmpcheck.engines.lammps_setup import Deck, create_atoms, execute, input_flags, variables
from cmpcheck.engines.observed import Observed
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import FORMS, MICRO
from cmpcheck.fixes.slurry import DEFINE_STATE, SlurryFix
from reference.state import Setup

OBSERVER = "cmpcheck_observer"  # ID of the fix in decks that need no fix
TO_SCREEN = ("-log", "none", "-echo", "screen")


def simulate(
    deck: Deck, setup: Setup, resolution: Resolution, stride: int, time_step: float, log: Path | None = None
) -> Observed:
    """Run the deck in this process.

    Parameters: stride, steps between outputs; time_step in s; the file for LAMMPS's log, without one all goes
    to the standard output, line by line, so that it is there when the process dies.
    Raises EngineError, in LAMMPS's own words, for a deck or a run that fails.
    """
    with opened(deck, variables(setup, resolution, time_step), log) as lmp:
        return _simulate(lmp, deck, setup, resolution, stride, time_step)


@contextmanager
def opened(deck: Deck, values: Mapping[str, float | str], log: Path | None = None) -> Iterator[Any]:
    """A LAMMPS instance for a deck, closed at the end.

    Parameters: values of the deck's variables; the file for the log, see `simulate`.
    Raises EngineError for what LAMMPS raises within.
    """
    if log is None:
        write_lines_at_once(True)
    said = TO_SCREEN if log is None else ("-log", str(log), "-screen", "none")
    lmp = open_lammps([*said, "-var", "driver", "cmpcheck", *input_flags(values)])
    try:
        yield lmp
    except EngineError:
        raise
    except Exception as error:  # the lammps package raises Exception itself
        if type(error) is not Exception:
            raise
        raise EngineError(f"{deck.path}: {error_message(error)}") from error
    finally:
        lmp.close()


def _simulate(
    lmp: Any, deck: Deck, setup: Setup, resolution: Resolution, stride: int, time_step: float
) -> Observed:
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
    return Observed(*fix.trajectory(), fix.contacts(), surfaces, pad_heights)
