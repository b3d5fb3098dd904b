"""Particles dragged by a known flow, far from each other and from walls: Eqs 20-22 and 37-39."""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.judges.protocol import Findings, Impact, Measured, require_stokes
from cmpcheck.phases import unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.drag import fluid_velocity
from reference.recording import Run
from reference.state import FLOW_COUETTE, Setup


class DragJudge:
    """Judges relaxation to a uniform or a shear flow by its closed form, or by an ODE solved to 1e-12."""

    copies = 1
    has_surface_contact = False
    refines_contact = False

    def __init__(self, setup: Setup):
        self.setup = setup
        self.cached: dict[bytes, list[exact.DragMotion]] = {}
        if setup.model.flow == FLOW_COUETTE:
            flow = np.array([fluid_velocity(setup.model, math.nan, z) for z in setup.state.position[:, 2]])
            slip = np.linalg.norm(flow - setup.state.velocity, axis=1)
            require_stokes(setup, slip)

    def motions(self, times: np.ndarray) -> list[exact.DragMotion]:
        """Exact motion of each particle at given times."""
        key = times.tobytes()
        if key not in self.cached:
            self.cached[key] = [self._motion(k, times) for k in range(len(self.setup.state.mass))]
        return self.cached[key]

    def _motion(self, k: int, times: np.ndarray) -> exact.DragMotion:
        model, state = self.setup.model, self.setup.state
        start, velocity = state.position[k], state.velocity[k]
        mass, diameter = float(state.mass[k]), float(state.diameter[k])
        if model.flow == FLOW_COUETTE:
            tau = exact.stokes_time(mass, diameter, model.viscosity)
            return exact.couette_motion(times, start, velocity, model.wall_speed, model.gap, tau)
        flow = (model.flow_x, model.flow_y, model.flow_z)
        return exact.drag_motion(
            times, start, velocity, flow, mass, diameter, model.fluid_density, model.viscosity
        )

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Of each particle, velocities halfway and at the end, and its distance from the exact path."""
        found = Findings()
        found.add("impacts", "20-22", "1", len(run.contacts), 0.0, 1.0, rounding=0.5)
        found += self.measure_trajectory(setup, run)
        return found

    def impacts(self) -> list[Impact]:
        """There are none."""
        return []

    def largest_force(self) -> float:
        """Of the exact motions, by differences over a ten thousandth of the end time."""
        times = np.linspace(0.0, self.setup.end_time, 10_001)
        steps = [np.linalg.norm(np.diff(motion.velocities, axis=0), axis=1) for motion in self.motions(times)]
        return float(max(step.max() for step in steps) / times[1])

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """All of them but the number of impacts."""
        found = Findings()
        positions, last = unwrapped(run, setup), len(run.times) - 1
        shear = self.setup.model.flow == FLOW_COUETTE
        equations = "20-22, 37-39"
        for k, motion in enumerate(self.motions(run.times)):
            name = [f"particle {k}"] if len(self.setup.state.mass) > 1 else []
            start = np.zeros(3) if shear else motion.velocities[0]
            scale = float(np.linalg.norm(motion.velocities - start, axis=1).max())
            for axis, component in enumerate("xyz"):
                if np.ptp(motion.velocities[:, axis]) == 0.0:
                    continue
                for frame, when in ((last // 2, "halfway"), (last, "end")):
                    value, expected = run.velocities[frame, k, axis], motion.velocities[frame, axis]
                    place = ", ".join([*name, when])
                    found.add(f"velocity_{component}", equations, "m/s", value, expected, scale, place)
            distance = np.linalg.norm(positions[:, k] - motion.positions, axis=1).max()
            path = float(np.linalg.norm(motion.positions - motion.positions[0], axis=1).max())
            found.add("trajectory_distance", equations, "m", distance, 0.0, path, "".join(name))
        return found

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Speed of each particle relative to its start (shear: velocity along the flow)."""
        case, times = setup.case, tuple(run.times)
        shear = self.setup.model.flow == FLOW_COUETTE
        traces = []
        motions = self.motions(run.times) if engine == "exact" else []
        for k in range(len(self.setup.state.mass)):
            velocities = motions[k].velocities if engine == "exact" else run.velocities[:, k]
            if shear:
                values, label = velocities[:, 0], f"velocity along the flow, particle {k}"
            else:
                model = setup.model
                flow = np.array([model.flow_x, model.flow_y, model.flow_z])
                values, label = np.linalg.norm(velocities - flow, axis=1), f"slip speed, particle {k}"
            traces.append(Trace(case.name, case.variant, engine, label, "m/s", times, tuple(values)))
        return traces
