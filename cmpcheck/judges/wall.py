"""One particle that strikes the surface in free flight: Eqs 23-36 without external forces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pandas as pd

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import REMOVED_VOLUME_LIMIT, Findings, Impact, Measured, add_mass_balance
from cmpcheck.phases import split, surfaces, unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.contact import effective_modulus
from reference.heightfield import Heightfield, flatness
from reference.recording import Run
from reference.state import DEPOSIT_NODE_DEPTH, DEPOSIT_NONE, Setup

FLATTER = 1e-6  # a smaller change of Pi is lost in the round-off of its sum


class Flight(NamedTuple):
    """Free flight of one particle with the impacts that it has before the end."""

    times: list[float]  # of the impacts, s
    points: list[np.ndarray]  # centres at the impacts, m
    velocities: list[np.ndarray]  # before the first, and after each impact, m/s
    hits: list[exact.WallImpact]
    normals: list[np.ndarray]
    heights: np.ndarray  # of the surface at the end, m

    def position(self, start: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Centres (T, 3) at given times, m; before time 0 on the way to where it starts."""
        knots = np.array([0.0, *self.times])
        centres = np.array([start, *self.points])
        leg = np.maximum(np.searchsorted(knots, times, side="right") - 1, 0)
        return centres[leg] + np.array(self.velocities)[leg] * (times - knots[leg])[:, np.newaxis]


def wall_of(setup: Setup) -> exact.Wall:
    """The surface as the closed forms know it."""
    model = setup.model
    removes = model.deposit != DEPOSIT_NONE
    return exact.Wall(
        model.restitution,
        float(effective_modulus(setup.state.modulus[0], model.surface_modulus)),
        model.poisson_ratio,
        model.yield_stress,
        model.surface_density,
        model.impact_duration,
        model.threshold_velocity if removes else np.inf,
        model.mass_pickup,
    )


def fly(setup: Setup, surface: Heightfield, position: np.ndarray) -> Flight:
    """Exact flight of particle 0 from `position` until the end, lowering a copy of the surface as it goes."""
    model, wall = setup.model, wall_of(setup)
    radius, mass = float(setup.state.diameter[0]) / 2, float(setup.state.mass[0])
    z, flight = surface.z, Flight([], [], [setup.state.velocity[0]], [], [], surface.z)
    clock, centre, velocity = 0.0, np.array(position), setup.state.velocity[0]
    while velocity[2] < 0.0:
        touch = exact.meet_heightfield(z, surface.spacing, centre, velocity, radius)
        clock += touch.time
        if not clock < setup.end_time:
            break
        hit = exact.removing_impact(mass, radius, velocity, touch.normal, wall)
        amount = "depth" if model.deposit == DEPOSIT_NODE_DEPTH else "volume"
        taken = {amount: model.acceleration * getattr(hit.removal, amount)}
        z = exact.lowered(z, surface.spacing, touch.point[0], touch.point[1], **taken)
        centre, velocity, mass = touch.centre, hit.velocity, hit.mass
        flight.times.append(clock)
        flight.points.append(centre)
        flight.velocities.append(velocity)
        flight.hits.append(hit)
        flight.normals.append(touch.normal)
    return flight._replace(heights=z)


class WallJudge:
    """Judges impacts on a flat wall or on asperities by momentum balance, geometry and quadrature."""

    copies = 32
    has_surface_contact = True
    refines_contact = True

    def __init__(self, setup: Setup):
        self.setup = setup
        self.surface = Heightfield(setup.state.heights, setup.model.spacing)
        self.exact = fly(setup, self.surface, setup.state.position[0])

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Per impact its impulse, load and removal; velocity, mass, energy and balances at the end."""
        copies, start = setup.copies, self.setup.state
        hits = self.exact.hits
        contacts = q.contacts_by_copy(run, setup, "surface")
        found = Findings()
        if not found.count_impacts(contacts, len(hits), "29"):
            return found
        before, speed = start.velocity[0], float(np.linalg.norm(start.velocity[0]))
        for k, (hit, rows) in enumerate(zip(hits, q.contact_columns(contacts, len(hits)), strict=True)):
            place = f"impact {k + 1}" if len(hits) > 1 else ""
            approach, impulse = -float(before @ self.exact.normals[k]), hit.normal_impulse
            found.add("approach_speed", "29", "m/s", rows["approach_speed"], approach, speed, place)
            found.add("normal_impulse", "29, 30", "N s", q.model_impulse(rows), impulse, impulse, place)
            self._add_removal(found, hit, rows, place)
            before = hit.velocity
        self._add_flight(found, setup, run)
        if any(hit.removal.volume > 0.0 for hit in hits):
            self._add_mass(found, run, copies)
            self._add_shape(found, run, copies)
        self._add_distance(found, setup, run)
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """The impulse of a single impact by the change of momentum; velocity, mass, energy and the path."""
        found, copies, flight = Findings(), setup.copies, self.exact
        if len(flight.hits) == 1:
            momentum = [
                split(run.masses[k], copies)[:, 0]
                * (split(run.velocities[k], copies)[:, 0] @ flight.normals[0])
                for k in (0, -1)
            ]
            impulse = flight.hits[0].normal_impulse
            found.add("normal_impulse", "29, 30", "N s", momentum[1] - momentum[0], impulse, impulse)
        self._add_flight(found, setup, run)
        if self.setup.model.mass_pickup and any(hit.removal.volume > 0.0 for hit in flight.hits):
            self._add_mass_gained(found, run, copies)
        self._add_distance(found, setup, run)
        return found

    def impacts(self) -> list[Impact] | None:
        """Those of the exact flight; on a curved surface, each decides where the next one is."""
        flight, impacts = self.exact, []
        flat = not self.setup.state.heights.any()
        if not flat and len(flight.hits) > 1:
            return None
        masses = [float(self.setup.state.mass[0]), *(hit.mass for hit in flight.hits)]
        for k, (hit, normal) in enumerate(zip(flight.hits, flight.normals, strict=True)):
            before = flight.velocities[k]
            slip = before - (before @ normal) * normal
            change = hit.mass * hit.velocity - masses[k] * before
            turning = 0.0 if flat else 2.0 / float(self.setup.state.diameter[0])
            impacts.append(
                Impact(flight.times[k], (0,), normal, change, -float(before @ normal), slip, turning)
            )
        return impacts

    def largest_force(self) -> float:
        """None acts."""
        return 0.0

    def _add_flight(self, found: Findings, setup: Setup, run: Run) -> None:
        """What velocities and masses at the end tell."""
        copies, start, hits = setup.copies, self.setup.state, self.exact.hits
        speed = float(np.linalg.norm(start.velocity[0]))
        after = q.final_velocity(run, copies)[:, 0]
        for axis, name in enumerate("xyz"):
            final = self.exact.velocities[-1][axis]
            found.add(f"velocity_{name}", "29, 31", "m/s", after[:, axis], final, speed)
        if len(hits) == 1:
            normal = self.exact.normals[0]
            returned = (
                run.masses[-1] * (after @ normal) / -(start.mass[0] * float(start.velocity[0] @ normal))
            )
            e = self.setup.model.restitution
            found.add("restitution", "28", "1", returned, e, e or 1.0)
        energy = 0.5 * float(start.mass[0]) * speed**2
        lost = q.kinetic_energy(run, 0, copies) - q.kinetic_energy(run, -1, copies)
        found.add("energy_lost", "29, 31", "J", lost, sum(hit.energy_lost for hit in hits), energy)

    def _add_distance(self, found: Findings, setup: Setup, run: Run) -> None:
        path = float(np.linalg.norm(self.setup.state.velocity[0])) * self.setup.end_time
        found.add("trajectory_distance", "2, 37", "m", self._distance(setup, run).max(axis=0), 0.0, path)

    def _add_removal(self, found: Findings, hit: exact.WallImpact, rows: pd.DataFrame, place: str) -> None:
        """Load and cap of one impact.  Engines share these kernels, so all are judged by closed forms."""
        cut, limit = hit.removal, REMOVED_VOLUME_LIMIT
        x_p, depth, volume = cut.yield_radius, cut.depth, cut.volume
        found.add("load", "30", "N", rows["load"], hit.load, hit.load, place, against_exact=True)
        if volume > 0.0:
            found.add("yield_radius", "34", "m", rows["yield_radius"], x_p, x_p, place, against_exact=True)
            found.add("indentation_depth", "35", "m", rows["depth"], depth, depth, place, against_exact=True)
            values = rows["removed_volume"]
            found.add(
                "removed_volume", "36", "m3", values, volume, volume, place, limit=limit, against_exact=True
            )

    def _add_mass_gained(self, found: Findings, run: Run, copies: int) -> float:
        """Add the mass picked up; returns what the surface has lost, kg."""
        model, limit = self.setup.model, REMOVED_VOLUME_LIMIT
        cut = sum(hit.removal.volume for hit in self.exact.hits) * model.surface_density
        gained, expected = q.mass_gained(run, copies), cut if model.mass_pickup else 0.0
        found.add("removed_mass", "36", "kg", gained, expected, cut, limit=limit, against_exact=True)
        return cut

    def _add_mass(self, found: Findings, run: Run, copies: int) -> None:
        model, limit = self.setup.model, REMOVED_VOLUME_LIMIT
        cut = self._add_mass_gained(found, run, copies)
        deeper = model.deposit == DEPOSIT_NODE_DEPTH
        amounts = [
            hit.removal.depth * model.spacing**2 if deeper else hit.removal.volume for hit in self.exact.hits
        ]
        lowered = model.acceleration * sum(amounts)
        lost = q.volume_lost(run, copies)
        found.add(
            "removed_volume", "36", "m3", lost, lowered, lowered, "surface", limit=limit, against_exact=True,
            expected_error=q.volume_rounding(run),
        )  # fmt: skip
        if model.mass_pickup and model.deposit != DEPOSIT_NODE_DEPTH and model.acceleration == 1.0:
            add_mass_balance(found, run, copies, model.surface_density, cut)

    def _add_shape(self, found: Findings, run: Run, copies: int) -> None:
        """The node that departs farthest from where it should be, and how much flatter the surface is."""
        assert run.surface is not None
        ends = surfaces(run.surface, copies)
        fall = float((self.surface.z - self.exact.heights).max())
        wrong = [float(np.abs(end.z - self.exact.heights).max()) for end in ends]
        found.add(
            "surface_shape", "36", "m", wrong, 0.0, fall, limit=REMOVED_VOLUME_LIMIT, against_exact=True,
            expected_error=q.volume_rounding(run) / self.surface.spacing**2,
        )  # fmt: skip
        if not self.surface.z.any():
            return
        cost, start = self.setup.case.cost, self.surface.z
        flatter = [1.0 - flatness(end.z, start, cost.target_height, cost.exponent) for end in ends]
        expected = 1.0 - exact.flatness(self.exact.heights, start, cost.target_height, cost.exponent)
        if abs(expected) > FLATTER:
            found.add(
                "flatness", "44", "1", flatter, expected, abs(expected), "1 - Pi", limit=REMOVED_VOLUME_LIMIT,
                against_exact=True, expected_error=q.EPS * (start.size + 10),
            )  # fmt: skip

    def _paths(self, setup: Setup, times: np.ndarray) -> np.ndarray:
        """Exact centres (T, copies, 3) in the first copy's place: all fly one path, each at another phase."""
        velocity, origin = self.setup.state.velocity[0], self.setup.state.position[0]
        aside = self.setup.model.length_x * np.arange(setup.copies)[:, np.newaxis] * [1.0, 0.0, 0.0]
        apart = split(setup.state.position, setup.copies)[:, 0] - aside - origin
        apart[:, :2] -= self.setup.model.length_x * np.round(apart[:, :2] / self.setup.model.length_x)
        early = apart @ velocity / (velocity @ velocity)
        paths = [self.exact.position(origin, times + shift) for shift in early]
        # each starts where it was put, at whichever image that is
        return np.stack(paths, axis=1) + (
            split(setup.state.position, setup.copies)[:, 0] - aside - origin - apart
        )

    def _distance(self, setup: Setup, run: Run) -> np.ndarray:
        """Distance (T, copies) from the exact path."""
        shift = self.setup.model.length_x * np.arange(setup.copies)[:, np.newaxis] * [1.0, 0.0, 0.0]
        return np.linalg.norm(unwrapped(run, setup) - shift - self._paths(setup, run.times), axis=2)

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Height of the centre, and the normal impulse of each impact."""
        case, times = setup.case, tuple(run.times)
        heights = unwrapped(run, setup)[:, 0, 2]
        impacts = run.contacts[(run.contacts["i"] == 0) & (run.contacts["kind"] == "surface")]
        when, impulse = impacts["time"], impacts["normal_impulse"]
        if engine == "exact":
            heights = self._paths(setup, run.times)[:, 0, 2]
            when, impulse = self.exact.times, [hit.normal_impulse for hit in self.exact.hits]
        label = {"case": case.name, "variant": case.variant, "engine": engine}
        return [
            Trace(**label, label="height of the centre", unit="m", times=times, values=tuple(heights)),
            Trace(
                **label,
                label="normal impulse",
                unit="N s",
                times=tuple(when),
                values=tuple(impulse),
                style="points",
            ),
        ]
