"""The callback that LAMMPS calls each step, compiled to a C function (one rank only).

LAMMPS moves its per-atom arrays about when they get longer: the callback asks for them then, through the C
library whose address it finds in the context. What it does with them is `particles.py` and `pairs.py`; the
same from Python, for more ranks: `slurry.py`.
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
from cmpcheck.fixes.layout import (
    BY_TAG_COLUMNS,
    CONTEXT,
    GIVEN_COLUMNS,
    MICRO,
    NO_ERROR,
    OPEN_COLUMNS,
    STATE_COLUMNS,
)
from cmpcheck.fixes.local import Local
from cmpcheck.fixes.near import MOST_SQUARES, Near
from cmpcheck.fixes.pairs import observe_pairs
from cmpcheck.fixes.particles import add_all, advance_particles, remove_in_order
from cmpcheck.fixes.samples import collect_by_tag, is_sampled, store_sample
from reference.compiled import kernel, part
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
def find_arrays(c, step):
    """Ask for the addresses of LAMMPS's per-atom arrays, where they may have moved.

    They move only when LAMMPS makes them longer; all look-ups by name cost as much as some ten particles.
    """
    allocated = carray(pointer_to(c.allocated_at), (1,), dtype=types.int32)[0]
    if allocated == c.allocated and step != c.last_step:
        return
    c.allocated = allocated
    c.radius_at = call(c.extract_atom_at, c.lammps, c.name_radius_at)
    c.rmass_at = call(c.extract_atom_at, c.lammps, c.name_rmass_at)
    c.x_at, c.v_at = first_row(c, c.name_x_at), first_row(c, c.name_v_at)
    c.f_at, c.state_at = first_row(c, c.name_f_at), first_row(c, c.name_state_at)
    c.given_at = first_row(c, c.name_given_at)


@kernel
def first_row(c, name_at):
    """Address of the first row of a per-atom array with several columns."""
    return carray(pointer_to(call(c.extract_atom_at, c.lammps, name_at)), (1,), dtype=types.int64)[0]


@kernel
def floats(address, rows, columns):
    """The array at an address, (rows, columns)."""
    return carray(pointer_to(address), (rows, columns), dtype=types.float64)


@kernel
def numbers(address, count):
    """The array at an address, (count,)."""
    return carray(pointer_to(address), (count,), dtype=types.float64)


@part
def take_step(c, step, adds, n, tags, x):
    """Advance the particles of the one rank, and take off what they remove."""
    c.time_step = carray(pointer_to(c.dt_at), (1,), dtype=types.float64)[0] * MICRO
    if c.error != NO_ERROR:
        return
    find_arrays(c, step)
    v, f, given = numbers(c.v_at, 3 * n), numbers(c.f_at, 3 * n), numbers(c.given_at, GIVEN_COLUMNS * n)
    state = floats(c.state_at, n, STATE_COLUMNS)
    radius, mass = numbers(c.radius_at, n), numbers(c.rmass_at, n)
    modulus = carray(pointer_to(c.modulus_at), (c.particles,), dtype=types.float64)
    heights = floats(c.heights_at, c.nodes_x, c.nodes_y)
    local = Local(
        carray(pointer_to(c.tag_at), (c.particles,), dtype=types.int32), numbers(c.travel_at, c.particles),
        numbers(c.since_at, c.particles), carray(pointer_to(c.due_at), (c.particles,), dtype=types.uint32),
        numbers(c.push_at, c.particles), numbers(c.rising_at, c.particles), floats(c.seen_at, c.particles, 4),
    )  # fmt: skip
    near = Near(
        floats(c.place_at, c.particles, 4),
        carray(pointer_to(c.fallen_at), (c.particles,), dtype=types.int64),
        carray(pointer_to(c.number_at), (c.particles,), dtype=types.int32),
        carray(pointer_to(c.sides_at), (c.particles, MOST_SQUARES), dtype=types.int32),
        carray(pointer_to(c.corners_at), (c.particles, MOST_SQUARES, 8), dtype=types.float64),
    )
    rows = floats(c.rows_at, c.max_rows, LEDGER_COLUMNS)
    first = c.rows
    lower_pad(c, step)
    advance_particles(
        c, step, adds, tags, x, v, f, radius, mass, state, given, modulus, heights, rows, local, near
    )  # fmt: skip
    remove_in_order(c, heights, rows, first, c.rows)


@kernel
def observe_step(c, step):
    """Follow the contacts between particles, and store a sample of the trajectory when it is due."""
    n = c.local
    tags = carray(pointer_to(call(c.extract_atom_at, c.lammps, c.name_id_at)), (n,), dtype=types.int32)
    x, v, f = floats(c.x_at, n, 3), floats(c.v_at, n, 3), floats(c.f_at, n, 3)
    radius, mass = numbers(c.radius_at, n), numbers(c.rmass_at, n)
    given = floats(c.given_at, n, GIVEN_COLUMNS)
    by_tag = floats(c.by_tag_at, c.particles, BY_TAG_COLUMNS)
    collect_by_tag(c, tags, x, v, f, radius, mass, given, by_tag)
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


def _callback(pointer, step, n, tags_at, x_at, _):
    c = carray(pointer, (1,), dtype=CONTEXT)[0]
    if n > 0:
        adds = not (c.observe_pairs or is_sampled(c, step))
        take_step(c, step, adds, n, carray(tags_at, (n,)), carray(x_at[0], (3 * n,)))
        pairs = c.observe_pairs and (c.pushed > 0 or c.open > 0)  # what overlaps and approaches is pushed
        if step != c.last_step and c.error == NO_ERROR and (pairs or is_sampled(c, step)):
            c.local = n
            call(c.observe_at, c.address, step)
        if not adds and c.error == NO_ERROR:
            add_all(numbers(c.f_at, 3 * n), numbers(c.given_at, GIVEN_COLUMNS * n))
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
