"""Many particles that collide in a periodic box: balances, and the ledger up to the horizon (Eqs 9-19)."""

from __future__ import annotations

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Findings, Impact, Measured, add_momentum
from cmpcheck.results import Trace
from reference.recording import Run
from reference.state import Setup


class SwarmJudge:
    """Judges a swarm by conservation; its contacts are compared one by one by `compare.py`."""

    copies = 1
    has_surface_contact = False
    refines_contact = True

    def __init__(self, setup: Setup):
        self.setup = setup

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Momentum, energy against the ledger's account of it, and what changes between contacts."""
        found = Findings()
        add_momentum(found, run, setup.copies)
        steps, start = run.provenance["steps"], float(q.kinetic_energy(run, 0, 1)[0])
        if run.provenance["engine"] == "reference":
            balance = (
                start - float(q.kinetic_energy(run, -1, 1)[0]) - float(run.contacts["energy_lost"].sum())
            )
            found.add("energy_balance", "9-19", "J", balance, 0.0, start, rounding=steps * q.EPS * start)
        speed = float(np.abs(run.velocities).max())
        drift = q.free_flight_change(run, setup)
        found.add("free_flight", "2", "m/s", drift, 0.0, speed, rounding=steps * q.EPS * speed)
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """Momentum only: when contacts begin, which decides the rest, a trajectory does not tell."""
        found = Findings()
        add_momentum(found, run, setup.copies)
        return found

    def impacts(self) -> list[Impact] | None:
        """Not known beforehand; each keeps the momentum, whatever its duration."""
        return None

    def largest_force(self) -> float:
        """None acts."""
        return 0.0

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Kinetic energy over time."""
        if engine == "exact":
            return []
        case, values = setup.case, tuple(run.history["kinetic_energy"])
        times = tuple(run.history["time"])
        return [Trace(case.name, case.variant, engine, "kinetic energy", "J", times, values)]
