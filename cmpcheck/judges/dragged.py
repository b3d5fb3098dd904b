"""Two spheres that collide while a uniform flow drags them: the drag in Eqs 9 and 14-18."""

from __future__ import annotations

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Findings, Impact, Measured, require_stokes
from cmpcheck.phases import unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.recording import Run
from reference.state import Setup


class DraggedPairJudge:
    """Judges one collision under drag, by phases of the contact with the drag's impulse in each.

    The paper's contact has a duration, and J and friction contain the drag over it.  Of engines whose
    contacts last otherwise only the normal impulse is compared, corrected by the ledger's own account of it
    (`quantities.model_impulse`).
    """

    copies = 32
    has_surface_contact = False
    refines_contact = True

    def __init__(self, setup: Setup):
        model, state = setup.model, setup.state
        flow = np.array([model.flow_x, model.flow_y, model.flow_z])
        require_stokes(setup, np.linalg.norm(flow - state.velocity, axis=1))
        if not model.impact_duration > 0.0 or model.static_friction != model.dynamic_friction:
            raise ValueError(
                "two spheres that meet in a flow need a constant impact_duration and one coefficient of "
                "friction"
            )
        self.setup = setup
        i, j = (
            exact.Sphere(
                float(state.mass[k]), float(state.diameter[k]) / 2, state.position[k], state.velocity[k]
            )
            for k in (0, 1)
        )
        self.exact = exact.dragged_collision(
            i, j, flow, model.viscosity, model.impact_duration, model.restitution, model.static_friction,
            setup.end_time,
        )  # fmt: skip

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Speed of the impact, its impulse and friction, and both velocities at the end."""
        hit, state, found = self.exact, self.setup.state, Findings()
        contacts = q.contacts_by_copy(run, setup, "pair")
        if not found.count_impacts(contacts, 1, "9"):
            return found
        rows = next(q.contact_columns(contacts, 1))
        approach, normal = hit.approach_speed, hit.normal_impulse
        found.add("approach_speed", "20-22", "m/s", rows["approach_speed"], approach, approach)
        reduced = float(np.prod(state.mass[:2]) / state.mass[:2].sum())
        values = q.pair_model_impulse(rows, reduced)
        found.add("normal_impulse", "8, 9", "N s", values, normal, normal)
        e = values / (reduced * rows["approach_speed"].to_numpy(float)) - 1.0
        found.add("restitution", "8, 9", "1", e, normal / (reduced * approach) - 1.0, 1.0, "apparent")
        if run.provenance["engine"] != "reference":
            return found
        friction = float(np.linalg.norm(hit.friction_impulse))
        found.add("friction_impulse", "14-18", "N s", rows["friction_impulse"], friction, friction or normal)
        found += self.measure_trajectory(setup, run)
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """Both velocities at the end, of a contact that lasts as long as the case says."""
        hit, state, found = self.exact, self.setup.state, Findings()
        approach, after = hit.approach_speed, q.final_velocity(run, setup.copies)
        flow = np.array([self.setup.model.flow_x, self.setup.model.flow_y, self.setup.model.flow_z])
        left = setup.end_time - hit.time
        for k in (0, 1):
            tau = exact.stokes_time(
                float(state.mass[k]), float(state.diameter[k]), self.setup.model.viscosity
            )
            final = flow + (hit.velocities[k] - flow) * np.exp(-left / tau)
            for axis, name in enumerate("xyz"):
                values, place = after[:, k, axis], f"particle {k}"
                found.add(f"velocity_{name}", "3, 4, 19-22", "m/s", values, final[axis], approach, place)
        return found

    def impacts(self) -> list[Impact] | None:
        """No bound: the drag of a contact that lasts otherwise is another."""
        return None

    def largest_force(self) -> float:
        """Not asked for without a bound on the impacts."""
        return 0.0

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Distance between the centres less the sum of the radii."""
        if engine == "exact":
            return []
        positions = unwrapped(run, setup)[:, :2]
        gap = np.linalg.norm(positions[:, 1] - positions[:, 0], axis=1) - setup.state.diameter[:2].mean()
        name, variant = setup.case.name, setup.case.variant
        return [Trace(name, variant, engine, "gap between the spheres", "m", tuple(run.times), tuple(gap))]
