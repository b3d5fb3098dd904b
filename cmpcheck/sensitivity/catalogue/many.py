"""Errors in the fast stepper's loop for many particles; the plain one, the answer key, does it right.

The rows that notice them are in the full profile of `cmpcheck compare`, and so are they: that loop is
compiled anew for each of them.
"""

from __future__ import annotations

from dataclasses import replace

from cmpcheck.sensitivity.mutants import Mutant

FAST = "reference/fast"

ERRORS = (
    Mutant(
        "many: second of a pair", "the second particle of a pair receives another impulse than the first",
        f"{FAST}/many.py:push_pairs", "s.jz[j] -= contact[2]", "s.jz[j] -= (1.0 + SIZE) * contact[2]",
        0.01, "%",
    ),
    Mutant(
        "many: piece of pairs", "the pairs of the last piece push nobody", f"{FAST}/many.py:push_pairs",
        "for piece in range(met.near.size):", "for piece in range(met.near.size - 1):",
    ),
    Mutant(
        "many: piece of particles", "the surface pushes nobody of the last piece",
        f"{FAST}/many.py:march_many",
        "for piece in range(found.hits.size):", "for piece in range(found.hits.size - 1):",
    ),
    Mutant(
        "many: late look", "a particle is looked at one step after its time",
        f"{FAST}/pieces.py:watch_piece", "due[i] <= step", "due[i] < step",
    ),
    Mutant(
        "many: no look when thrown", "one that a contact throws out of its bounds is not looked at again",
        f"{FAST}/pieces.py:move_piece", "w.due[i] = step + 1", "w.due[i] = w.due[i]",
    ),
    Mutant(
        "many: late list", "the list of pairs is kept for longer than it holds",
        f"{FAST}/many.py:march_many",
        "left -= 2.0 * dt * speed", "left -= (1.0 - SIZE) * 2.0 * dt * speed", 1.0, "% of the way",
    ),
    Mutant(
        "many: ledger of a pair", "who is the first of a pair goes by places in memory",
        f"{FAST}/many.py:push_pairs", "if order[i] > order[j]:", "if i > j:",
    ),
    Mutant(
        "many: particle of a row", "a ledger row names the place in memory, not the particle",
        f"{FAST}/many.py:march_many", "= order[int(rows[k, col.I])]", "= rows[k, col.I]",
    ),
    Mutant(
        "many: masses brought back", "masses go back to the places in memory, not to their particles",
        f"{FAST}/swarm.py:bring_back", "p.mass[k] = s.mass[i]", "p.mass[i] = s.mass[i]",
    ),
)  # fmt: skip

MUTANTS = tuple(replace(error, profile="full") for error in ERRORS)
