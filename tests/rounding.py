"""What the physics tests share: equality within round-off, and Hypothesis strategies of usual sizes."""

from __future__ import annotations

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

ROUND = 1e-12  # relative: some tens of operations on doubles, and cancellation of up to a factor 100
repeatable = settings(derandomize=True, deadline=None, max_examples=40)

unit = st.floats(0.0, 1.0)
masses = st.floats(1e-16, 1e-12)
speeds = st.floats(0.01, 10.0)
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))


def close(measured: ArrayLike, expected: ArrayLike, scale: float = 0.0, rtol: float = ROUND) -> None:
    """Assert equality within `rtol`, plus round-off of `scale`, the size of what cancels."""
    np.testing.assert_allclose(measured, expected, rtol=rtol, atol=ROUND * scale)
