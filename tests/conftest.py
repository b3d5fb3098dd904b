"""Settings that all tests share: reproducible examples, and no deadline while Numba compiles."""

from hypothesis import settings

settings.register_profile("cmpcheck", deadline=None, derandomize=True, database=None)
settings.load_profile("cmpcheck")
