"""An engine of one's own: two spheres with a spring and a dashpot, in NumPy."""

import math

import numpy as np

from cmpcheck.engines.protocol import NotSupported, Resolution
from cmpcheck.results import EngineInfo
from cmpcheck.trajectories import trajectory_run
from reference.recording import Run
from reference.state import FLOW_NONE, Setup


class TwoSpheres:
    """`setup` holds `copies` of the pair side by side; all numbers are SI."""

    name = "two_spheres"
    surface_forms = ("native",)  # not those of the fix for LAMMPS

    def info(self) -> EngineInfo:
        """Always there."""
        return EngineInfo(self.name, "1.0", available=True)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """The pair at one resolution: leap-frog, and the force whose half period is the contact duration."""
        model, state, times = setup.model, setup.state, setup.output_times
        if len(state.mass) != 2 * setup.copies or model.has_surface or model.static_friction > 0.0:
            raise NotSupported("two spheres without wall and friction are all that it knows")
        if model.flow != FLOW_NONE or model.restitution == 0.0:
            raise NotSupported("a flow, or a restitution of 0, is more than it knows")
        r, v = state.position.reshape(-1, 2, 3).copy(), state.velocity.reshape(-1, 2, 3).copy()
        m, diameter = state.mass.reshape(-1, 2, 1), state.diameter.reshape(-1, 2).mean(axis=1)
        box = np.array(
            [p or 1.0e9 for p in (model.length_x, model.length_y, model.length_z)]
        )  # not periodic: 0
        t_c, loss, m_eff = resolution.contact_duration, -math.log(model.restitution), m.prod(1) / m.sum(1)
        stride = max(1, math.ceil(times[1] / resolution.time_step - 1e-6))
        dt, positions, velocities = times[1] / stride, [r.copy()], [v.copy()]
        for step in range(1, stride * (len(times) - 1) + 1):
            r += v * dt
            apart = r[:, 1] - r[:, 0]
            apart -= box * np.round(apart / box)
            gap = np.linalg.norm(apart, axis=1)
            n = apart / gap[:, None]
            approach = np.einsum("ci,ci->c", v[:, 0] - v[:, 1], n)
            spring = (math.pi**2 + loss**2) / t_c**2 * (diameter - gap) + 2.0 * loss / t_c * approach
            push = (m_eff * np.where(gap < diameter, spring, 0.0)[:, None] * n)[:, None] * dt / m
            v += push * np.array([-1.0, 1.0])[:, None]
            if step % stride == 0:
                positions.append(r.copy())
                velocities.append(v.copy())
        shape = (len(times), -1, 3)
        return trajectory_run(
            setup, self.name, times, np.reshape(positions, shape), np.reshape(velocities, shape)
        )
