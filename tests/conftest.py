"""Settings that all tests share: reproducible examples, no deadline while Numba compiles, one thread each."""

import os

from hypothesis import settings

os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # before Numba is imported: tests run side by side already

settings.register_profile("cmpcheck", deadline=None, derandomize=True, database=None)
settings.load_profile("cmpcheck")
