"""How the loops over many particles are shared out among threads.

The chunks of a loop are the same however many threads take them, and what they find is put together in
their order: the result does not depend on the number of threads.  No physics here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba

ENOUGH = 5_000  # particles for each thread: two are 1.2 to 1.5 times as fast as one with 1e4 and more

# The body of such a loop is one call: what it assigned by itself to an array of a named tuple
# would be lost.
# It is not kept on disk by itself, but in the kernel that calls it: Numba 0.68 forgets to start threads for a
# kernel that was compiled where such a loop came from disk, and then crashes.
threaded = numba.njit(error_model="numpy", nogil=True, parallel=True, no_cfunc_wrapper=True)


def most_threads() -> int:
    """How many threads there can be: those of the machine, or NUMBA_NUM_THREADS."""
    return int(numba.config.NUMBA_NUM_THREADS)


def use_threads(count: int) -> None:
    """Share out loops over many particles among `count` threads; ValueError if there are not as many."""
    if not 1 <= count <= most_threads():
        raise ValueError(f"{count} threads; allowed: 1 to {most_threads()}")
    numba.set_num_threads(count)
    _asked.append(count)


_asked: list[int] = []


@contextmanager
def as_many_as_help(particles: int) -> Iterator[None]:
    """A thread for each `ENOUGH` particles at most, unless `use_threads` was told how many."""
    before = numba.get_num_threads()
    if not _asked:
        numba.set_num_threads(max(1, min(before, particles // ENOUGH)))
    try:
        yield
    finally:
        numba.set_num_threads(before)
