"""What a judge of a case provides: what to measure in a run, and what it has to be.

A judge knows the physics of one kind of case (a pair, a wall, drag, ...).  How levels of resolution become
one value with an uncertainty, and two values a verdict, is `compare.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from cmpcheck import quantities as q
from cmpcheck.results import Trace
from reference.recording import Run
from reference.state import Setup

REMOVED_VOLUME_LIMIT = 0.03  # a wider tolerance than this part of the quantity is no test
LIMIT = 0.01
UNOBSERVED = "not observed"  # provenance["contacts"] of a run without a ledger


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
    expected_error: float = 0.0  # uncertainty of the expected value itself


@dataclass(frozen=True)
class Impact:
    """One impact as the closed form has it: where a contact that takes time can make a difference."""

    time: float  # s
    particles: tuple[int, ...]  # one that strikes the surface, or both of a pair
    normal: np.ndarray  # (3,), out of the surface, or from the first particle to the second
    change: np.ndarray  # (3,), of the momentum of the first particle, N s; a second one has the opposite
    approach: float  # m/s, along the normal before the impact, positive
    slip: np.ndarray  # (3,), m/s, velocity across it
    turning: float  # 1/m, by which the normal turns for each length of slip; 0 on a plane


class Findings(list[Measured]):
    """What a judge measures in one run."""

    def add(
        self,
        quantity: str,
        equations: str,
        unit: str,
        values: ArrayLike,
        expected: float,
        scale: float,
        place: str = "",
        *,
        limit: float = LIMIT,
        against_exact: bool = False,
        rounding: float = 0.0,
        expected_error: float = 0.0,
    ) -> None:
        """Add one quantity; see `Measured`."""
        array = np.atleast_1d(np.asarray(values, float))
        self.append(
            Measured(
                quantity, place, equations, unit, array, float(expected), float(scale), limit, against_exact,
                rounding, expected_error,
            )
        )  # fmt: skip

    def count_impacts(self, contacts: list[pd.DataFrame], expected: int, equations: str) -> bool:
        """Add the number of impacts; whether every copy has as many as it should."""
        counts = np.array([len(rows) for rows in contacts], float)
        self.add("impacts", equations, "1", counts, expected, 1.0, rounding=0.5)
        return bool((counts == expected).all())


def add_momentum(found: Findings, run: Run, copies: int) -> None:
    """Add the change of total momentum: only rounding, half a unit of the largest term at each step."""
    scale = q.momentum_scale(run, copies)
    rounding = run.provenance["steps"] * q.EPS * scale
    found.add("momentum", "3, 4, 12", "N s", q.momentum_change(run, copies), 0.0, scale, rounding=rounding)


def observes_contacts(run: Run) -> bool:
    """Whether the run has a ledger of contacts at all; without, only `measure_trajectory` can be asked."""
    return run.provenance.get("contacts") != UNOBSERVED


def add_mass_balance(found: Findings, run: Run, copies: int, density: float, scale: float) -> None:
    """Add mass gained less density times volume lost: only the rounding of both differences."""
    balance = q.mass_gained(run, copies) - density * q.volume_lost(run, copies)
    rounding = density * q.volume_rounding(run)
    rounding += q.EPS * float(run.masses.max()) * (2 + len(run.contacts) / copies)
    found.add("mass_balance", "36", "kg", balance, 0.0, scale, rounding=rounding)


def require_stokes(setup: Setup, slip: np.ndarray) -> None:
    """Raise ValueError where the largest slips (N,), in m/s, exceed Re = 1, the end of Stokes's drag."""
    model = setup.model
    reynolds = float((model.fluid_density * slip * setup.state.diameter / model.viscosity).max())
    if reynolds > 1.0:
        raise ValueError(f"the closed form holds for Re <= 1, and a particle has up to Re = {reynolds:.3g}")


class Judge(Protocol):
    """The physics of one kind of case."""

    copies: int  # phases of the time step that each level is sampled at
    has_surface_contact: bool  # runs in the `soft` and `impulse` forms of the fix
    refines_contact: bool  # a soft engine's contact duration matters

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Every quantity of a run of the (tiled) setup."""
        ...

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """The quantities that positions, velocities and masses tell: of a run whose ledger is empty."""
        ...

    def impacts(self) -> list[Impact] | None:
        """The impacts of the closed form; None where what softness does to them has no bound."""
        ...

    def largest_force(self) -> float:
        """Largest acceleration by other forces than contacts, m/s2."""
        ...

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Curves to be drawn, of the first copy; engine "exact" has its own."""
        ...
