"""What a judge of a case provides: what to measure in a run, and what it has to be.

A judge knows the physics of one kind of case (a pair, a wall, drag, ...).  How levels of resolution become
one value with an uncertainty, and two values a verdict, is `compare.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cmpcheck.results import Trace
from reference.recording import Run
from reference.state import Setup

REMOVED_VOLUME_LIMIT = 0.03  # a wider tolerance than this part of the quantity is no test
LIMIT = 0.01


@dataclass(frozen=True)
class Measured:
    """One quantity of one run: a value for each copy, and what it is compared with."""

    quantity: str
    place: str  # which particle or impact, "" if there is one
    equations: str
    unit: str
    values: np.ndarray  # (copies,)
    expected: float  # exact value; nan if there is none
    scale: float  # magnitude by which a tolerance is judged, > 0
    limit: float = LIMIT
    against_exact: bool = False  # engines, too, are judged against the exact value
    rounding: float = 0.0  # > 0: no discretisation enters; the bound of its rounding error


class Judge(Protocol):
    """The physics of one kind of case."""

    copies: int  # phases of the time step that each level is sampled at
    has_surface_contact: bool  # runs in the `soft` and `impulse` forms of the fix
    refines_contact: bool  # a soft engine's contact duration matters

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Every quantity of a run of the (tiled) setup."""
        ...

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Curves to be drawn, of the first copy; engine "exact" has its own."""
        ...


def per_copy(values: np.ndarray, copies: int) -> np.ndarray:
    """Total of an extensive quantity (N,) over the particles of each copy."""
    return values.reshape(copies, -1).sum(axis=1)
