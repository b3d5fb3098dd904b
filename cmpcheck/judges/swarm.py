"""Many particles that collide in a periodic box: balances, and the ledger up to the horizon (Eqs 9-19)."""

from __future__ import annotations

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Measured
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
        scale = q.momentum_scale(run, 1)
        steps = float(run.provenance.get("steps", 1))
        start = float(q.kinetic_energy(run, 0, 1)[0])
        lost = start - float(q.kinetic_energy(run, -1, 1)[0])
        balance = lost - float(run.contacts["energy_lost"].sum())
        change = q.momentum_change(run, 1)
        measured = [Measured("momentum", "", "3, 4, 12", "N s", change, 0.0, scale, rounding=steps * q.EPS * scale)]
        if run.provenance["engine"] == "reference":
            bound = steps * q.EPS * start
            measured.append(
                Measured("energy_balance", "", "9-19", "J", np.array([balance]), 0.0, start, rounding=bound)
            )
        return measured

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Kinetic energy over time."""
        if engine == "exact":
            return []
        case, values = setup.case, tuple(run.history["kinetic_energy"])
        times = tuple(run.history["time"])
        return [Trace(case.name, case.variant, engine, "kinetic energy", "J", times, values)]
