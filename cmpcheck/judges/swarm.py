"""Many particles that collide in a periodic box: balances, and the ledger up to the horizon (Eqs 9-19)."""

from __future__ import annotations

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Findings, Measured, add_momentum
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
        """Momentum, and the energy that the ledger accounts for against the energy that is gone."""
        found = Findings()
        add_momentum(found, run, setup.copies)
        if run.provenance["engine"] == "reference":
            start, end = (float(q.kinetic_energy(run, frame, 1)[0]) for frame in (0, -1))
            balance = start - end - float(run.contacts["energy_lost"].sum())
            rounding = run.provenance["steps"] * q.EPS * start
            found.add("energy_balance", "9-19", "J", balance, 0.0, start, rounding=rounding)
        return found

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Kinetic energy over time."""
        if engine == "exact":
            return []
        case, values = setup.case, tuple(run.history["kinetic_energy"])
        times = tuple(run.history["time"])
        return [Trace(case.name, case.variant, engine, "kinetic energy", "J", times, values)]
