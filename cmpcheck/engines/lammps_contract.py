"""What a LAMMPS deck must do to be compared: the contract in words, and the check of a user's deck.

The engine that runs it is `lammps.py`, variables and atoms `lammps_setup.py`.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

from cmpcheck.engines.lammps_library import EngineError, open_lammps
from cmpcheck.engines.lammps_setup import Deck, create_atoms, execute, input_flags, variables
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import MICRO
from cmpcheck.fixes.slurry import DEFINE_STATE, defines_state
from cmpcheck.phases import tile
from reference.state import Setup
from reference.toml_source import CaseError

COPIES = 2  # side by side along x: shows whether the box follows its variable
TOO_EARLY = re.compile(r"(?m)^[ \t]*(create_atoms|read_data|read_restart|run|minimize)\b")
NO_MOTION = "No fixes with time integration"
CONTRACT = """\
# ---------------------------------------------------------------------------------------------------
# What cmpcheck compare --deck {case}=FILE does with this deck, and what it needs.
#
# It reads the deck down to the line that begins with  if "$(driver)  (with braces), sets the variables below,
# then creates the atoms itself and runs.  Everything after that line is yours, for runs of your own.
#
# Received: index variables, in micro units (um, us, pg; m/s), of which a deck declares those that it uses.
#   driver             the word cmpcheck
#   length_x length_y  periods of the box; copies of the problem lie side by side along x
#   z_low z_high boundary_z    extent along z; boundary_z is p or m
#   restitution friction       of the case; the comparison is about what comes out, not about these
#   contact_duration steps_per_contact time_step    t_c, its steps, and the step; each is refined
#   pair_ratio         t_c of two particles over that of the surface
#   effective_mass     m* of the pair whose contact lasts t_c
#   fluid_density viscosity flow_x flow_y flow_z wall_speed gap    of the fluid, where there is one
#
# Needed above that line:
#   units micro; atom_style sphere 1
#   a box of length_x by length_y, periodic in both, one atom type or more, no atoms yet
#   pair_style and pair_coeff for all types (pair_style zero where nothing touches)
#   a fix that integrates the motion of group all, without spin: fix ID all nve
{fix}#
# Not needed: groups (all is used), computes, dumps, thermo, the time step, a run, an output of any kind.
# Any contact or wall style may be used.  Pair contacts are observed.  Of a wall that is LAMMPS's own, as that
# of fix wall/gran, the trajectory is judged: restitution, velocities, energy, impulse and path.  Single
# contacts, loads and removed volumes are not compared: they need cmpcheck's fix.
# ---------------------------------------------------------------------------------------------------
"""
FIX = f"""\
#   for surface, drag and removal by cmpcheck's fix, as in this deck:
#     {DEFINE_STATE}
#   and, anywhere in the deck, the line  fix ID all external pf/callback 1 1
#   (without that line nothing is added to what LAMMPS computes)
"""


def contract(case: str, deck: Deck) -> str:
    """The deck with the contract above it, in comments."""
    return CONTRACT.format(case=case, fix=FIX if deck.external_fix else "") + deck.text


def check_deck(path: Path, setup: Setup, resolution: Resolution) -> None:
    """Whether a user's deck can be compared, before anything is run.

    Raises CaseError naming everything that it lacks; LAMMPS's own words where it refuses the deck.
    """
    try:
        deck = Deck.read(path)
        text = deck.definitions()
    except EngineError as error:
        raise CaseError(str(error)) from None
    early = TOO_EARLY.search(text)
    lacks = [f"a beginning without {early.group(1)}: atoms and runs are cmpcheck's"] if early else []
    if not lacks:
        tiled = tile(setup, COPIES, resolution.time_step)
        with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
            log = Path(folder) / "log"
            arguments = ["-log", str(log), "-screen", "none", "-var", "driver", "cmpcheck"]
            given = input_flags(variables(tiled, resolution, resolution.time_step))
            lmp = open_lammps(arguments + given)
            try:
                execute(lmp, text, path)
                lacks = _lacks(lmp, deck, tiled)
                if not lacks:
                    create_atoms(lmp, tiled.state)
                    execute(lmp, "run 0 post no\n", path)
                    if NO_MOTION in log.read_text("utf-8", "replace"):
                        lacks = ["a fix that integrates the motion: fix ID all nve"]
            except EngineError as error:
                raise CaseError(str(error)) from None
            finally:
                lmp.close()
    if lacks:
        raise CaseError(f"{path}: the deck lacks {'; '.join(lacks)}")


def _lacks(lmp: Any, deck: Deck, setup: Setup) -> list[str]:
    """What the definitions have left open."""
    lacks, model = [], setup.model
    if lmp.extract_global("units") != "micro":
        lacks.append(f"units micro (it has {lmp.extract_global('units')})")
    if not (lmp.extract_setting("radius_flag") and lmp.extract_setting("rmass_flag")):
        lacks.append("atom_style sphere 1")
    if not lmp.extract_setting("box_exist"):
        return [*lacks, "a box: region and create_box"]
    low, high, *_, periodic, _ = lmp.extract_box()
    for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
        name, length = "xyz"[axis], (high[axis] - low[axis]) * MICRO
        if period > 0.0 and not (periodic[axis] and abs(length - period) <= 1e-9 * period):
            lacks.append(
                f"a box periodic along {name} with the period length_{name}, {period / MICRO:g} um for "
                f"{COPIES} copies (it is {'' if periodic[axis] else 'not periodic, '}{length / MICRO:g} um)"
            )
    if lmp.get_natoms() > 0:
        lacks.append(f"an empty box (it has {lmp.get_natoms():.0f} atoms): cmpcheck creates them")
    if deck.external_fix is not None and not defines_state(lmp):
        lacks.append(f"the per-atom state of the fix: {DEFINE_STATE}")
    return lacks
