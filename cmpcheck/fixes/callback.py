"""The callback that LAMMPS calls each step, compiled to a C function (one rank only).

LAMMPS moves its per-atom arrays about, so the callback asks for them each step, through the C library whose
address it finds in the context.  What it does with them is `particles.py` and `pairs.py`; the same from
Python, for more ranks: `slurry.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from cmpcheck.fixes.contacts import lower_pad
from cmpcheck.fixes.layout import BY_TAG_COLUMNS, CONTEXT, MICRO, NO_ERROR, OPEN_COLUMNS, STATE_COLUMNS
from cmpcheck.fixes.pairs import observe_pairs
from cmpcheck.fixes.particles import advance_particles, remove_in_order
from cmpcheck.fixes.samples import collect_by_tag, is_sampled, store_sample
from reference.compiled import kernel
from reference.ledger import COLUMNS

LEDGER_COLUMNS = len(COLUMNS)


@intrinsic
def pointer_to(typingctx: Any, address: Any) -> tuple[Any, Callable[..., Any]]:
    """An address as a pointer that `carray` takes."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.voidptr(types.int64), codegen


@intrinsic
def call(typingctx: Any, function: Any, first: Any, second: Any) -> tuple[Any, Callable[..., Any]]:
    """Call a C function at an address with two pointers or integers; return a pointer as an integer.

    A function that takes one argument or returns nothing may be called so too, in the calling conventions
    of x86-64 and AArch64.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        i64 = ir.IntType(64)
        address = builder.inttoptr(args[0], ir.FunctionType(i64, [i64, i64]).as_pointer())
        return builder.call(address, [args[1], args[2]])

    return types.int64(types.int64, types.int64, types.int64), codegen


@kernel
def per_atom_vector(c, name_at, n):
    """A per-atom array of LAMMPS with one column, (n,)."""
    return carray(pointer_to(call(c.extract_atom_at, c.lammps, name_at)), (n,), dtype=types.float64)


@kernel
def per_atom_array(c, name_at, n, columns):
    """A per-atom array of LAMMPS with several columns, (n, columns), from the pointer to its first row."""
    rows = carray(pointer_to(call(c.extract_atom_at, c.lammps, name_at)), (1,), dtype=types.int64)
    return carray(pointer_to(rows[0]), (n, columns), dtype=types.float64)


@kernel
def state_array(c, step, n):
    """The per-atom state of the fix, (n, STATE_COLUMNS).

    Its look-up by name costs as much as a particle; it moves only when LAMMPS makes its arrays longer.
    """
    allocated = carray(pointer_to(c.allocated_at), (1,), dtype=types.int32)[0]
    if allocated != c.allocated or step == c.last_step:
        c.allocated = allocated
        found = pointer_to(call(c.extract_atom_at, c.lammps, c.name_state_at))
        c.state_at = carray(found, (1,), dtype=types.int64)[0]
    return carray(pointer_to(c.state_at), (n, STATE_COLUMNS), dtype=types.float64)


@kernel
def floats(address, rows, columns):
    """An array of this fix, (rows, columns)."""
    return carray(pointer_to(address), (rows, columns), dtype=types.float64)


@kernel
def take_step(c, step, n, tags, x, force):
    """Advance the particles of the one rank, take off what they remove, then let pairs be observed."""
    c.time_step = carray(pointer_to(c.dt_at), (1,), dtype=types.float64)[0] * MICRO
    if c.error != NO_ERROR:
        force[:] = 0.0
        return
    v, f = per_atom_array(c, c.name_v_at, n, 3), per_atom_array(c, c.name_f_at, n, 3)
    radius, mass = per_atom_vector(c, c.name_radius_at, n), per_atom_vector(c, c.name_rmass_at, n)
    state = state_array(c, step, n)
    modulus = carray(pointer_to(c.modulus_at), (c.particles,), dtype=types.float64)
    heights = floats(c.heights_at, c.nodes_x, c.nodes_y)
    rows = floats(c.rows_at, c.max_rows, LEDGER_COLUMNS)
    first = c.rows
    lower_pad(c, step)
    advance_particles(c, step, tags, x, v, f, radius, mass, state, force, modulus, heights, rows)
    remove_in_order(c, heights, rows, first, c.rows)


@kernel
def observe_step(c, step):
    """Follow the contacts between particles, and store a sample of the trajectory when it is due."""
    n = c.local
    tags = carray(pointer_to(call(c.extract_atom_at, c.lammps, c.name_id_at)), (n,), dtype=types.int32)
    x, v = per_atom_array(c, c.name_x_at, n, 3), per_atom_array(c, c.name_v_at, n, 3)
    f, state = per_atom_array(c, c.name_f_at, n, 3), state_array(c, step, n)
    radius, mass = per_atom_vector(c, c.name_radius_at, n), per_atom_vector(c, c.name_rmass_at, n)
    by_tag = floats(c.by_tag_at, c.particles, BY_TAG_COLUMNS)
    collect_by_tag(c, tags, x, v, f, radius, mass, state, by_tag)
    if c.observe_pairs:
        modulus = carray(pointer_to(c.modulus_at), (c.particles,), dtype=types.float64)
        pairs = carray(pointer_to(c.pairs_at), (c.max_pairs, 2), dtype=types.int64)
        position, listed = floats(c.position_at, c.particles, 3), floats(c.listed_at, c.particles, 3)
        open_pairs = floats(c.open_at, c.max_open, OPEN_COLUMNS)
        rows = floats(c.rows_at, c.max_rows, LEDGER_COLUMNS)
        observe_pairs(c, step, by_tag, modulus, position, pairs, listed, open_pairs, rows)
    if is_sampled(c, step) and c.error == NO_ERROR:
        store_sample(c, step, by_tag, floats(c.samples_at, c.max_samples, 1 + 7 * c.particles))


def _observe(address, step):
    observe_step(carray(pointer_to(address), (1,), dtype=CONTEXT)[0], step)
    return 0


def _callback(pointer, step, n, tags_at, x_at, force_at):
    c = carray(pointer, (1,), dtype=CONTEXT)[0]
    if n > 0:
        take_step(c, step, n, carray(tags_at, (n,)), carray(x_at[0], (n, 3)), carray(force_at[0], (n, 3)))
        pairs = c.observe_pairs and (c.pushed > 0 or c.open > 0)  # what overlaps and approaches is pushed
        if step != c.last_step and c.error == NO_ERROR and (pairs or is_sampled(c, step)):
            c.local = n
            call(c.observe_at, c.address, step)
    c.last_step = step
    if c.error != NO_ERROR:
        call(c.force_timeout_at, c.lammps, 0)


@cache
def compiled_callback() -> Any:
    """The compiled callback (a Numba CFunc: keep it alive while LAMMPS may call its `.address`)."""
    row_pointers = types.CPointer(types.CPointer(types.float64))
    signature = types.void(
        types.voidptr, types.int64, types.int32, types.CPointer(types.int32), row_pointers, row_pointers
    )
    return numba.cfunc(signature, cache=True)(_callback)


@cache
def compiled_observer() -> Any:
    """What the callback calls, by address, when pairs or the trajectory are to be observed.

    A function of its own, so that it is compiled only where it is needed, and apart from the callback.
    """
    return numba.cfunc(types.int64(types.int64, types.int64), cache=True)(_observe)
