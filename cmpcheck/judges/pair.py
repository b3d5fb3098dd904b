"""Two particles that meet in free flight: Eqs 3-19 without external forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Findings, Impact, Measured, add_momentum
from cmpcheck.phases import split, unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.recording import Run
from reference.state import Setup


def _trajectory(setup: Setup, position: np.ndarray, times: np.ndarray) -> exact.PairTrajectory:
    state, model = setup.state, setup.model
    i, j = (
        exact.Sphere(float(state.mass[k]), float(state.diameter[k]) / 2, position[k], state.velocity[k])
        for k in (0, 1)
    )
    periods = (model.length_x, model.length_y, model.length_z)
    return exact.pair_trajectory(
        times, i, j, model.restitution, model.static_friction, model.dynamic_friction, periods
    )


class PairJudge:
    """Judges one collision of two spheres by momentum, restitution and friction."""

    copies = 32
    has_surface_contact = False
    refines_contact = True

    def __init__(self, setup: Setup):
        self.setup = setup
        self.exact = _trajectory(setup, setup.state.position, np.array([0.0, setup.end_time]))

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Impulses, restitution, energy, velocities after, momentum and the distance to the exact path."""
        contacts = q.contacts_by_copy(run, setup, "pair")
        found = Findings()
        if not found.count_impacts(contacts, 1, "9"):
            return found
        rows = next(q.contact_columns(contacts, 1))
        self._add_impulses(found, rows["normal_impulse"], rows["friction_impulse"])
        self._add_flight(found, setup, run, rows[["nx", "ny", "nz"]].to_numpy(float))
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """The same, with the impulse told by the change of momentum, and the exact normal."""
        found, copies = Findings(), setup.copies
        normal = self.exact.touch.normal
        masses, velocities = split(run.masses[0], copies)[:, 0, np.newaxis], run.velocities
        change = masses * (split(velocities[-1], copies)[:, 0] - split(velocities[0], copies)[:, 0])
        pushed = -change @ normal
        across = np.linalg.norm(change + pushed[:, np.newaxis] * normal, axis=1)
        self._add_impulses(found, pushed, across)
        self._add_flight(found, setup, run, np.tile(normal, (copies, 1)))
        return found

    def impacts(self) -> list[Impact]:
        """The one collision."""
        state, hit, touch = self.setup.state, self.exact.collision, self.exact.touch
        approach = state.velocity[0] - state.velocity[1]
        speed = float(approach @ touch.normal)
        slip = approach - speed * touch.normal
        change = -hit.normal_impulse * touch.normal + hit.friction_impulse
        turning = 2.0 / float(state.diameter.sum())
        return [Impact(touch.time, (0, 1), touch.normal, change, speed, slip, turning)]

    def largest_force(self) -> float:
        """None acts."""
        return 0.0

    def _add_impulses(self, found: Findings, pushed: ArrayLike, across: ArrayLike) -> None:
        hit = self.exact.collision
        normal, friction = hit.normal_impulse, float(np.linalg.norm(hit.friction_impulse))
        found.add("normal_impulse", "9, 12", "N s", pushed, normal, normal)
        if self.setup.model.static_friction > 0.0:
            found.add("friction_impulse", "14-18", "N s", across, friction, friction or normal)

    def _add_flight(self, found: Findings, setup: Setup, run: Run, normals: np.ndarray) -> None:
        """What the velocities (copies, 2, 3) after the collision and the paths tell."""
        hit, state, copies = self.exact.collision, self.setup.state, setup.copies
        mass_i, mass_j = state.mass
        approach = float((state.velocity[0] - state.velocity[1]) @ self.exact.touch.normal)
        energy = 0.5 * mass_i * mass_j / (mass_i + mass_j) * approach**2
        after = q.final_velocity(run, copies)
        parting = np.einsum("cx,cx->c", after[:, 1] - after[:, 0], normals)
        before = np.einsum("x,cx->c", state.velocity[0] - state.velocity[1], normals)
        lost = q.kinetic_energy(run, 0, copies) - q.kinetic_energy(run, -1, copies)
        e = self.setup.model.restitution
        found.add("restitution", "5, 8", "1", parting / before, e, e or 1.0)
        found.add("energy_lost", "3-9", "J", lost, hit.energy_lost, energy)
        for k, final in enumerate((hit.velocity_i, hit.velocity_j)):
            for axis, name in enumerate("xyz"):
                values, place = after[:, k, axis], f"particle {k}"
                found.add(f"velocity_{name}", "3, 4, 19", "m/s", values, final[axis], approach, place)
        add_momentum(found, run, copies)
        path = approach * self.setup.end_time
        found.add("trajectory_distance", "2, 37", "m", self._distance(setup, run).max(axis=0), 0.0, path)

    def _distance(self, setup: Setup, run: Run) -> np.ndarray:
        """Distance (T, copies) of the farther particle from its exact path."""
        positions = unwrapped(run, setup).reshape(len(run.times), setup.copies, 2, 3)
        starts = split(setup.state.position, setup.copies)
        paths = [_trajectory(setup, start, run.times).positions for start in starts]
        return np.linalg.norm(positions - np.stack(paths, axis=1), axis=3).max(axis=2)

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Distance between the centres less the sum of the radii."""
        case = setup.case
        positions = unwrapped(run, setup)[:, :2]
        if engine == "exact":
            positions = _trajectory(setup, setup.state.position[:2], run.times).positions
        model = setup.model
        apart = positions[:, 1] - positions[:, 0]
        for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
            if period > 0.0:
                apart[:, axis] -= period * np.round(apart[0, axis] / period)
        gap = np.linalg.norm(apart, axis=1) - setup.state.diameter[:2].mean()
        return [
            Trace(
                case.name, case.variant, engine, "gap between the spheres", "m", tuple(run.times), tuple(gap)
            )
        ]
