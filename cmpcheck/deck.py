"""`cmpcheck deck`: run a LAMMPS deck as `lmp` would, with the Python fix attached to it.

The deck is read in two parts; `SlurryFix` is attached after its line `fix ID group external pf/callback`.
Comparing a deck with the reference is `engines/lammps.py`.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from cmpcheck.engines.lammps_library import EngineError, open_lammps
from cmpcheck.engines.lammps_setup import Deck, execute
from cmpcheck.fixes.layout import MICRO
from cmpcheck.fixes.slurry import SlurryFix
from reference.case import Case, CaseError, load_case
from reference.heightfield import flatness
from reference.process import build_setup
from reference.state import Setup
from reference.toml_source import nearest, one_line

DRIVER = "cmpcheck_deck"
SUCCESSFUL_QUIT = re.compile(r'(?m)(^[ \t]*|")quit([ \t]+0)?([ \t]*(?:#.*)?$|")')
SHOWN = 10  # contacts
SMALLEST, LARGEST = Decimal(sys.float_info.min), Decimal(sys.float_info.max)  # with all digits
COLUMNS = [
    "time", "i", "approach_speed", "normal_impulse", "load", "yield_radius", "removed_volume", "removed_mass",
]  # fmt: skip


def run_deck(arguments: Sequence[str], comm: Any = None) -> int:
    """Run a deck with the flags that `lmp` takes; 0 when it has simulated something.

    The deck's variables `case` (name or .toml file; default the NAME of `in.NAME`), `variant` (default the
    first), `form` (soft | impulse) and `contact_duration` (us, of a soft contact) say what the fix does.
    Raises CaseError (bad input) and EngineError (the run has failed), one line naming the file.
    """
    path, flags = _input_file(arguments)
    try:
        deck = Deck(path, path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise CaseError(f"{path}: {getattr(error, 'strerror', None) or 'not a text file'}") from None
    _require_known_variables(deck, flags)
    _require_readable_numbers(deck, flags)
    try:
        lmp = open_lammps([*flags, "-var", "driver", DRIVER] if deck.external_fix else flags, comm)
    except EngineError:
        raise
    except RuntimeError:  # LAMMPS has printed why
        raise CaseError(f"{path}: LAMMPS refuses the flags {' '.join(flags)}") from None
    try:
        _run(lmp, deck)
        if lmp.extract_global("ntimestep") == 0:
            raise EngineError(f"{path}: nothing was simulated: no run command was reached, or it had 0 steps")
    except (EngineError, CaseError):
        if lmp.extract_setting("world_rank") > 0:
            return 1  # rank 0 has the same error, and says it
        raise
    finally:
        lmp.close()
    return 0


def _input_file(arguments: Sequence[str]) -> tuple[Path, list[str]]:
    """The deck, and the other flags."""
    flags = list(arguments)
    for flag in ("-in", "-i"):
        if flag in flags[:-1]:
            at = flags.index(flag)
            path = Path(flags[at + 1])
            del flags[at : at + 2]
            return path, flags
    raise CaseError("cmpcheck deck: no input file; allowed: cmpcheck deck FILE [LAMMPS flags], or -in FILE")


def _require_known_variables(deck: Deck, flags: list[str]) -> None:
    """A variable that the deck never reads is a mistake, which LAMMPS would not notice."""
    declared = set(re.findall(r"(?m)^[ \t]*variable[ \t]+(\w+)", deck.text))
    for flag, name in pairwise(flags):
        if flag in ("-var", "-v") and name not in declared:
            known = nearest(name, sorted(declared))
            raise CaseError(f"{deck.path}: -var {one_line(name)}: unknown variable; {known}")


def _require_readable_numbers(deck: Deck, flags: list[str]) -> None:
    """A number beyond those of the machine ends LAMMPS, and its process, with an exception of C++."""
    for flag, name, value in zip(flags, flags[1:], flags[2:], strict=False):
        if flag not in ("-var", "-v"):
            continue
        with suppress(InvalidOperation):
            size = abs(Decimal(value))
            if size.is_finite() and size and not SMALLEST <= size <= LARGEST:
                raise CaseError(
                    f"{deck.path}: -var {one_line(name)} {one_line(value)}: allowed: 0, and sizes from "
                    f"{SMALLEST:.1e} to {LARGEST:.1e}"
                )


def _run(lmp: Any, deck: Deck) -> None:
    """The first part, the fix, the second part, and what the fix has seen."""
    before, after = (_return_to_caller(part) for part in deck.around_fix())
    execute(lmp, before, deck.path)
    if deck.external_fix is None:
        return
    setup = build_setup(_case(lmp, deck))
    fix = _attach(lmp, deck, setup)
    try:
        execute(lmp, after, deck.path)
    finally:
        fix.check()  # an error in the callback is the cause of what the deck then says
    contacts = fix.contacts()
    lines = [*_removed(contacts, fix, setup), f"cmpcheck: {len(contacts)} contacts; SI units"]
    if len(contacts):
        table = contacts.loc[: SHOWN - 1, COLUMNS]
        lines += table.to_string(index=False, float_format="{:.6g}".format).splitlines()
    for line in lines:
        lmp.command(f'print "{line}"')  # to screen and log, as the flags say


def _return_to_caller(part: str) -> str:
    """The part with a successful `quit` turned into the end of the input, for the checks that follow."""
    return SUCCESSFUL_QUIT.sub(r"\1jump /dev/null\3", part)


def _removed(contacts: pd.DataFrame, fix: SlurryFix, setup: Setup) -> list[str]:
    """What has become of the surface, in lines; none without removal, no Pi where it is undefined (Eq 44)."""
    if setup.case.removal is None:
        return []
    total = contacts[["removed_volume", "removed_mass"]].sum()
    lines = [
        f"cmpcheck: {(contacts.removed_volume > 0.0).sum()} removals, {total.removed_volume:.6g} m3, "
        f"{total.removed_mass:.6g} kg"
    ]
    cost = setup.case.cost
    with suppress(ValueError):
        pi = flatness(fix.heights, setup.state.heights, cost.target_height, cost.exponent)
        lines.append(f"cmpcheck: Pi 1 -> {pi:.6f}")
    return lines


def _attach(lmp: Any, deck: Deck, setup: Setup) -> SlurryFix:
    """The fix, with the constants of the deck's case."""
    case = setup.case
    atoms, modulus = int(lmp.get_natoms()), setup.state.modulus
    if atoms != len(modulus):
        if np.ptp(modulus) > 0.0:
            raise EngineError(
                f"{deck.path}: {atoms} atoms, but the case {case.name} has {len(modulus)} particles, of "
                "several materials"
            )
        modulus = np.full(atoms, modulus[0])
    try:
        fix = SlurryFix(
            lmp,
            deck.external_fix or "",
            setup.model,
            modulus,
            setup.state.heights,
            pad_height=setup.state.pad_height,
            form=_variable(lmp, "form") or "soft",
            contact_duration=float(_variable(lmp, "contact_duration") or 0.0) * MICRO,
            ledger_speed=case.numerics.ledger_speed,
            observe_pairs=setup.model.has_pairs and atoms > 1,
            case=str(deck.path),
        )
        fix.attach()
    except EngineError as error:
        raise EngineError(f"{deck.path}: {error}") from None
    return fix


def _case(lmp: Any, deck: Deck) -> Case:
    """The variant of the case that the deck's variables name."""
    case = load_case(_variable(lmp, "case") or deck.path.name.removeprefix("in."))
    name, variants = _variable(lmp, "variant"), case.variants()
    for variant in variants:
        if name in ("", variant.variant):
            return variant
    names = [variant.variant for variant in variants]
    raise CaseError(f"{deck.path}: variant = {name}: {nearest(name, names)}")


def _variable(lmp: Any, name: str) -> str:
    """Value of a variable of the deck, "" when it defines none."""
    return str(lmp.extract_variable(name)) if lmp.has_id("variable", name) else ""
