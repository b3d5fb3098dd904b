"""How the model's functions are compiled: `formula` for one equation, `kernel` for a loop.

A `formula` is ordinary Python for its callers (arrays broadcast) and is compiled into the kernels that use
it.  A `kernel` is compiled at its first call and kept on disk.  The others are pieces of kernels.

Numba does not notice when a function that a cached kernel calls has changed, so the cache folder is named
after the digest of the sources.  No physics here.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
from pathlib import Path

import numba
import numpy as np
from numba.extending import register_jitable
from platformdirs import user_cache_path

KEPT = 8  # caches of the latest versions of the sources


def _source_digest() -> str:
    """Digest of every module whose functions may be compiled into a cached kernel."""
    here = Path(__file__).parent
    packages = [here, here / "fast", here.parent / "cmpcheck" / "fixes"]
    digest = hashlib.sha256()
    for path in sorted(path for package in packages for path in package.glob("*.py")):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> str:
    """A writable folder for compiled kernels: the user's cache, or a temporary one where there is none."""
    folder = user_cache_path("cmpcheck") / f"numba-{_source_digest()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        if os.access(folder, os.W_OK):
            for old in sorted(folder.parent.glob("numba-*"), key=os.path.getmtime)[:-KEPT]:
                shutil.rmtree(old, ignore_errors=True)
            return str(folder)
    except OSError:
        pass
    return tempfile.mkdtemp(prefix="cmpcheck-numba-")


if not os.environ.get("NUMBA_CACHE_DIR"):
    numba.config.CACHE_DIR = _cache_folder()

# Called from Python: kept on disk.
kernel = numba.njit(cache=True, error_model="numpy", nogil=True, no_cfunc_wrapper=True)
# What compiled code alone calls: Numba makes no ways in from Python and C, a fifth of its work, and for
# Python these functions are Python.  A `part` of a loop LLVM puts in place, since a call would copy the
# model's constants each time.
formula = register_jitable(error_model="numpy", no_cfunc_wrapper=True)
inner = register_jitable(error_model="numpy", no_cfunc_wrapper=True, forceinline=False)
part = register_jitable(error_model="numpy", no_cfunc_wrapper=True, forceinline=True)
# Large loops of kernels of different kinds, threaded or not: compiled once, which the above are for each
# kind.  Python has no way in and must not call them.  No array is made in what is `uncounted`, so that no
# references to those it is given need be counted.
shared = numba.njit(error_model="numpy", nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True)
uncounted = numba.njit(
    error_model="numpy", nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True, _nrt=False
)
# a part that Numba puts in place: takes longer to compile, and is a few percent faster
inlined = numba.njit(error_model="numpy", nogil=True, inline="always", no_cfunc_wrapper=True)
# without the JIT a formula is plain Python, which numba.vectorize cannot compile
broadcast = np.vectorize if numba.config.DISABLE_JIT else numba.vectorize(cache=True)
