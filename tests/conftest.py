"""Settings that all tests share: reproducible examples, no deadline while Numba compiles, one thread each.

With `--dist loadgroup`, as in `make test`, the tests of a file run in one process, so that what they compile
and share is made once; a mark `xdist_group` puts tests of other files with them.  What takes longest begins
first: by then the other processes find it compiled on disk, and none is left alone with it at the end.
"""

import os

import pytest
from hypothesis import settings

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # before Numba is imported: tests run side by side already

settings.register_profile("cmpcheck", deadline=None, derandomize=True, database=None)
settings.load_profile("cmpcheck")

FIRST = ("many", "test_fast")  # groups that compile for a minute: the fast stepper's loops, each in a process


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Group tests by file, and sort the groups: FIRST, those with slow tests, the others as they stand.

    Where tests are not shared out they stay in the order in which they are asked for.
    """
    if not config.getoption("loadgroup", False):
        return
    for item in items:
        if not any(item.iter_markers("xdist_group")):
            item.add_marker(pytest.mark.xdist_group(item.path.stem))
    group = {item: next(item.iter_markers("xdist_group")).args[0] for item in items}
    slow = {group[item] for item in items if any(item.iter_markers("slow"))}
    ranks = dict.fromkeys(group.values(), len(FIRST) + 1) | dict.fromkeys(slow, len(FIRST))
    ranks |= {name: rank for rank, name in enumerate(FIRST)}
    items.sort(key=lambda item: ranks[group[item]])
