"""LAMMPS as an engine: a setup and a deck become a run.

The deck defines box, styles and fixes; the atoms, the Python fix and the run are added here.  Finding a deck
and filling its variables is `lammps_setup.py`; what the fix does is `cmpcheck/fixes`.
"""

from __future__ import annotations

import math
import re
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.engines.lammps_library import EngineError, available, error_message, open_lammps, version
from cmpcheck.engines.lammps_setup import NO_QUIT, Deck, create_atoms, deck_path, execute, variables
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import FORMS, MICRO
from cmpcheck.fixes.slurry import DEFINE_STATE, SlurryFix
from cmpcheck.results import EngineInfo
from reference.heightfield import Heightfield
from reference.recording import Run, basic_provenance, history_row
from reference.state import Setup

OBSERVER = "cmpcheck_observer"  # ID of the fix in decks that need no fix
LOG_LINES = 3  # of LAMMPS's log, quoted when it fails
SAID_ALREADY = re.compile(rf"{NO_QUIT}|^Last input line|^\(src/")


class LammpsEngine:
    """Runs the deck of a case, or the user's own: `decks` maps names of cases to files."""

    name = "lammps"

    def __init__(self, decks: Mapping[str, Path] | None = None) -> None:
        self.decks = dict(decks or {})

    def info(self) -> EngineInfo:
        """Whether LAMMPS can be loaded, and which version."""
        found, reason = available()
        return EngineInfo(self.name, version() if found else "", found, reason)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.  Raises EngineError, with LAMMPS's own words, when that fails.

        The time step is the resolution's, made a little smaller where the output times are no multiple of it.
        """
        refuse_rules_it_lacks(setup)
        path = Path(self.decks.get(setup.case.name) or deck_path(setup.case.name))
        try:
            deck = Deck(path, path.read_text("utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise EngineError(f"{path}: {getattr(error, 'strerror', None) or 'not a text file'}") from None
        stride = output_stride(setup.output_times, resolution.time_step)
        time_step = float(setup.output_times[1]) / stride
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
            log = Path(folder) / "log"
            arguments = ["-log", str(log), "-screen", "none", "-var", "driver", "cmpcheck"]
            for key, value in variables(setup, resolution, time_step).items():
                arguments += ["-var", key, value if isinstance(value, str) else repr(float(value))]
            lmp = open_lammps(arguments)
            try:
                return _simulate(lmp, deck, setup, resolution, stride, time_step)
            except EngineError as error:
                raise EngineError(f"{_label(setup)}: {error}{_last_lines(log)}") from error
            except Exception as error:  # the lammps package raises Exception itself
                if type(error) is not Exception:
                    raise
                message = f"{deck.path}: {error_message(error)}"
                raise EngineError(f"{_label(setup)}: {message}{_last_lines(log)}") from error
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
        case=_label(setup),
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
    run = _recorded(setup, resolution, fix, surfaces, pad_heights, time_step)
    if native and setup.model.has_surface:
        lowest = (run.positions[:, :, 2] - setup.state.diameter / 2).min(axis=0)
        if lowest.min() < setup.state.heights.max():
            raise EngineError(f"{deck.path} has no surface, but particle {lowest.argmin()} has reached it")
    return run


def _recorded(
    setup: Setup,
    resolution: Resolution,
    fix: SlurryFix,
    surfaces: list[np.ndarray],
    pad_heights: list[float],
    time_step: float,
) -> Run:
    """What the fix has seen, as a run."""
    times, positions, velocities, masses = fix.trajectory()
    if len(times) != len(setup.output_times):
        raise EngineError(f"{len(times)} of {len(setup.output_times)} outputs were recorded")
    contacts, state, cost = fix.contacts(), setup.state, setup.case.cost
    removed = contacts[["time", "removed_volume", "removed_mass"]]
    history = []
    for k, time in enumerate(setup.output_times):
        so_far = removed[removed["time"] <= time].sum()
        now = replace(
            state, position=positions[k], velocity=velocities[k], mass=masses[k], heights=surfaces[k],
            pad_height=pad_heights[k],
        )  # fmt: skip
        volume, mass = float(so_far["removed_volume"]), float(so_far["removed_mass"])
        history.append(history_row(time, now, state.heights, volume, mass, cost))
    spacing, has_surface = setup.model.spacing, setup.model.has_surface
    return Run(
        case=setup.case,
        times=setup.output_times.copy(),
        positions=positions,
        velocities=velocities,
        masses=masses,
        contacts=contacts,
        history=pd.DataFrame(history),
        surface_initial=Heightfield(surfaces[0], spacing) if has_surface else None,
        surface=Heightfield(surfaces[-1], spacing) if has_surface else None,
        diameters=state.diameter.copy(),
        provenance={
            **basic_provenance(setup.case, "lammps"),
            "lammps": version(),
            "form": resolution.form,
            "contact_duration": resolution.contact_duration,
            "time_step": time_step,
            "steps": round(float(setup.output_times[-1]) / time_step),
            "copies": setup.copies,
            "notes": list(setup.notes),
            "complete": True,
        },
    )


def _label(setup: Setup) -> str:
    """Case and variant, for messages."""
    return " ".join(filter(None, (setup.case.name, setup.case.variant)))


def _last_lines(log: Path) -> str:
    """The end of LAMMPS's log, in one line."""
    try:
        lines = [line.strip() for line in log.read_text("utf-8", "replace").splitlines()]
    except OSError:
        return ""
    lines = [line for line in lines if line and not SAID_ALREADY.search(line)]
    return f" (log: {' | '.join(lines[-LOG_LINES:])})" if lines else ""
