"""Which seeded error is on, and how large: two numbers that guarded sources read while they run.

Guarded sources (`patching.py`) hold every seeded error beside the right statement, and ask `seeded(k)` which
one to take.  So a tree is compiled once for all errors and all sizes.  Compiled code reads the numbers by the
name of a symbol, not by an address, so that it can be kept on disk.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Callable, Iterator
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

SYMBOL = "cmpcheck_seeded_error"
VARIABLE = "CMPCHECK_SEEDED"  # of the environment: number and size of the error that is on from the start
OFF = -1

_numbers = (ctypes.c_double * 2)(*map(float, os.environ.get(VARIABLE, f"{OFF} 0").split()))
llvmlite.binding.add_symbol(SYMBOL, ctypes.addressof(_numbers))


def seeded(number: int) -> bool:
    """Whether this seeded error is on."""
    return _numbers[0] == number


def seeded_size() -> float:
    """Size of the error that is on."""
    return _numbers[1]


@contextlib.contextmanager
def switched_on(number: int, size: float) -> Iterator[None]:
    """Seeded error `number` is on within; `OFF` turns one off that is on outside."""
    before = tuple(_numbers)
    _numbers[0], _numbers[1] = number, size
    try:
        yield
    finally:
        _numbers[0], _numbers[1] = before


@intrinsic
def _read(typingctx: Any, slot: Any) -> tuple[Any, Callable[..., Any]]:
    """One of the two numbers, in compiled code."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = ir.ArrayType(ir.DoubleType(), 2)
        known = builder.module.globals
        numbers = known.get(SYMBOL) or ir.GlobalVariable(builder.module, array, SYMBOL)
        return builder.load(builder.gep(numbers, [ir.IntType(64)(0), args[0]]))

    return types.float64(types.int64), codegen


@overload(seeded)
def _compiled_seeded(number):  # untyped: Numba compares the two signatures
    return lambda number: _read(0) == number


@overload(seeded_size)
def _compiled_seeded_size():
    return lambda: _read(1)
