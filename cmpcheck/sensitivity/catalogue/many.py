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
        "many: who meets in the surface", "who touches where the surface falls is not told of it",
        f"{FAST}/harvest.py:spread_removals", "again[mover] |= unite(parent, mover, i)",
        "again[mover] |= False",
    ),
    Mutant(
        "many: place in a window", "some positions are one node off in their piece's copy of the surface",
        f"{FAST}/window.py:nodes_to", "return nodes - first if", "return nodes - first - 1 if",
    ),
    Mutant(
        "many: rows that count", "the ledger rows of a first try stay", f"{FAST}/harvest.py:counts",
        "harvest.found_by[k] == harvest.piece", "harvest.found_by[k] <= harvest.piece",
    ),
    Mutant(
        "many: late look", "a particle is looked at one step after its time, at the beginning of a block",
        f"{FAST}/pieces.py:gather", "due = w.due[i]", "due = w.due[i] + 1",
    ),
    Mutant(
        "many: rim of a window", "a piece's copy of the surface ends at its particles' centres",
        f"{FAST}/window.py:margin_of", "return way + 0.5 * largest + max(look, told)", "return 0.0",
    ),
    Mutant(
        "many: what a block removes", "the surface falls in the pieces' copies of it alone",
        f"{FAST}/many.py:march_many", "row + begins[3 * k], row + begins[3 * k + 1])",
        "row + begins[3 * k], row + begins[3 * k])",
    ),
    Mutant(
        "many: pairs", "the last pairs of the list are left out", f"{FAST}/many.py:march_many",
        "pairs if model.has_pairs", "pairs[: pairs.shape[0] - 9] if model.has_pairs",
    ),
    Mutant(
        "many: ways", "pairs are listed for a block as if particles stayed where they are",
        f"{FAST}/ways.py:list_reachable", "s.radius[j] + way[i] + way[j]", "s.radius[j]",
    ),
    Mutant(
        "many: mass of a particle", "what a particle has picked up is lost at the end of a block",
        f"{FAST}/many.py:commit", "s.mass[i] = state[i, 6]", "s.mass[i] = s.mass[i]",
    ),
    Mutant(
        "many: ledger of a pair", "who is the first of a pair goes by places in memory",
        f"{FAST}/groups.py:pairs_of", "if order[i] > order[j]:", "if i > j:",
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
