"""The seeded errors, a module for each part of the model and for each side of the comparison.

Names say what is broken; sizes are those of the quick profile, chosen so that a person would call them small.
"""

from __future__ import annotations

from collections.abc import Iterable

from cmpcheck.sensitivity.catalogue import (
    analysis,
    contact,
    drag,
    fast,
    lammps,
    many,
    removal,
    setup,
    stepping,
    surface,
)
from cmpcheck.sensitivity.mutants import Mutant

CATALOGUE = (
    *contact.MUTANTS,
    *drag.MUTANTS,
    *removal.MUTANTS,
    *surface.MUTANTS,
    *stepping.MUTANTS,
    *setup.MUTANTS,
    *fast.MUTANTS,
    *many.MUTANTS,
    *lammps.MUTANTS,
    *analysis.MUTANTS,
)


def all_mutants() -> list[Mutant]:
    """Every seeded error, in the order of the model's files."""
    return check_names(CATALOGUE)


def check_names(mutants: Iterable[Mutant]) -> list[Mutant]:
    """The mutants; raises ValueError when two have one name."""
    found = list(mutants)
    names = [mutant.name for mutant in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ValueError(f"seeded errors with one name: {', '.join(sorted(twice))}")
    return found
