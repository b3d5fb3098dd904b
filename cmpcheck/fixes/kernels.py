"""How those functions of the fix are compiled that make no array: no references need be counted.

Those that make arrays, and pieces of either kind, are as `reference/compiled.py` has them.
"""

from __future__ import annotations

import numba
from numba.core.compiler import Compiler


class Apart(Compiler):
    """Compiles for arrays that never overlap, so that no loop has to find that out before it begins."""

    def define_pipelines(self) -> list:
        """Numba's own passes."""
        self.state.flags.noalias = True
        return super().define_pipelines()


uncounted = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True)
# Put in place where compiled code calls it: handing on an array takes seven words.
in_place = numba.njit(
    cache=True, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True, forceinline=True
)
# Of arrays that never overlap.
apart = numba.njit(
    cache=True, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True, pipeline_class=Apart
)
