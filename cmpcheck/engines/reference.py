"""The reference implementation as an engine like the others."""

from __future__ import annotations

from dataclasses import replace

from cmpcheck import __version__
from cmpcheck.engines.protocol import Resolution
from cmpcheck.results import EngineInfo
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup


class ReferenceEngine:
    """Runs `reference.simulation` with the resolution's time step."""

    name = "reference"
    surface_forms: tuple[str, ...] = ("impulse",)

    def info(self) -> EngineInfo:
        """Always available."""
        return EngineInfo(self.name, __version__, True)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate a setup.  Raises reference.simulation.SimulationError."""
        return simulate_setup(replace(setup, time_step=resolution.time_step))
