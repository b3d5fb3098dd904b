"""The readable, fast reference implementation of the paper's model: the answer key.

>>> import reference
>>> run = reference.simulate(reference.load_case("drag_relaxation"))
>>> run.velocities.shape[2]
3
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from reference.case import Case, CaseError, load_case

if TYPE_CHECKING:
    from reference.recording import Run
    from reference.simulation import simulate

__all__ = ["Case", "CaseError", "Run", "load_case", "simulate"]


def __getattr__(name: str) -> Any:
    """Load what needs Numba only when it is used, so that reading a case stays quick."""
    if name == "simulate":
        from reference.simulation import simulate

        return simulate
    if name == "Run":
        from reference.recording import Run

        return Run
    raise AttributeError(f"module 'reference' has no attribute {name!r}")
