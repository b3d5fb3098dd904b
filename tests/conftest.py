"""Settings that all tests share: reproducible examples, no deadline while Numba compiles, one thread each.

`make test` gives whole files to its processes, in the order made here, so that what tests of a file compile
and share is made once.  What takes longest begins first: by the time that other files need it, it is on disk.
"""

import os

import pytest
from hypothesis import settings

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # before Numba is imported: tests run side by side already

settings.register_profile("cmpcheck", deadline=None, derandomize=True, database=None)
settings.load_profile("cmpcheck")

# compile the reference's kernels, those of the fast stepper too, and the fix of LAMMPS: each most of a minute
FIRST = ("test_fast.py", "test_fix.py")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Sort files that are shared out: those of FIRST, those with slow tests, the others as they stand."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    slow = {item.path for item in items if any(item.iter_markers("slow"))}
    items.sort(key=lambda item: (item.path.name not in FIRST, item.path not in slow))
