"""The seeded errors, a module for each part of the model and for each side of the comparison.

Names say what is broken; sizes are those of the quick profile, chosen so that a person would call them small.
"""

from __future__ import annotations

from cmpcheck.sensitivity.catalogue import (
    analysis,
    contact,
    drag,
    lammps,
    removal,
    setup,
    stepping,
    surface,
)

CATALOGUE = (
    *contact.MUTANTS,
    *drag.MUTANTS,
    *removal.MUTANTS,
    *surface.MUTANTS,
    *stepping.MUTANTS,
    *setup.MUTANTS,
    *lammps.MUTANTS,
    *analysis.MUTANTS,
)
