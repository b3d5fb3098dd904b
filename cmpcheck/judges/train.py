"""One particle that a uniform flow presses on a flat wall: the train of its bounces, Eqs 20-36 with drag."""

from __future__ import annotations

import math

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import (
    REMOVED_VOLUME_LIMIT,
    Findings,
    Impact,
    Measured,
    add_mass_balance,
    require_stokes,
)
from cmpcheck.judges.wall import wall_of
from cmpcheck.phases import split, unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.recording import Run
from reference.state import Setup

MOST_IMPACTS = 20  # asked of the recursion; those after the end are dropped


class TrainJudge:
    """Judges a bounce train by the recursion of its approach speeds, and each impact by momentum balance."""

    copies = 64  # the phase at each impact adds its own lateness
    has_surface_contact = True
    refines_contact = True

    def __init__(self, setup: Setup):
        self.setup = setup
        state, model = setup.state, setup.model
        require_stokes(setup, np.abs(model.flow_z) + np.abs(state.velocity[:, 2]))
        self.radius = float(state.diameter[0]) / 2
        self.drag_factor = 3.0 * math.pi * model.viscosity * 2.0 * self.radius
        self.height = float(state.position[0, 2])
        self.exact = self._train(self.height)
        self.count = int((self.exact.times < setup.end_time).sum())

    def _train(self, height: float) -> exact.BounceTrain:
        state, model = self.setup.state, self.setup.model
        return exact.bounce_train(
            height - self.radius, -float(state.velocity[0, 2]), -model.flow_z, float(state.mass[0]),
            self.radius, self.drag_factor, wall_of(self.setup), MOST_IMPACTS,
        )  # fmt: skip

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Per impact its time, speed, impulse, load and volume; mass and its balance at the end."""
        copies, model = setup.copies, self.setup.model
        contacts = q.contacts_by_copy(run, setup, "surface")
        found = Findings()
        if not found.count_impacts(contacts, self.count, "29"):
            return found
        removed = 0.0
        for k, rows in enumerate(q.contact_columns(contacts, self.count)):
            hit, place = self.exact.impacts[k], f"impact {k + 1}"
            speed, impulse, volume = self.exact.approach_speeds[k], hit.normal_impulse, hit.removal.volume
            time = self.exact.times[k]
            found.add("impact_time", "20-22", "s", rows["time"], time, time, place)
            found.add("approach_speed", "20-22, 29", "m/s", rows["approach_speed"], speed, speed, place)
            found.add("normal_impulse", "29, 30", "N s", q.model_impulse(rows), impulse, impulse, place)
            found.add("load", "30", "N", rows["load"], hit.load, hit.load, place)
            if volume > 0.0:
                values, limit = rows["removed_volume"], REMOVED_VOLUME_LIMIT
                found.add("removed_volume", "32-36", "m3", values, volume, volume, place, limit=limit)
            removed += volume
        caps = [rows["removed_volume"].to_numpy() for rows in contacts]
        expected = sum(hit.removal.volume > 0.0 for hit in self.exact.impacts[: self.count])
        removals = np.array([float((cap > 0.0).sum()) for cap in caps])
        found.add("removals", "29-36", "1", removals, expected, 1.0, rounding=0.5)
        mass = model.surface_density * removed
        if model.mass_pickup:
            limit = REMOVED_VOLUME_LIMIT
            found.add("removed_mass", "36", "kg", q.mass_gained(run, copies), mass, mass, limit=limit)
            add_mass_balance(found, run, copies, model.surface_density, mass)
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """Velocity and mass at the end, and the largest distance from the exact height."""
        found, copies, model = Findings(), setup.copies, self.setup.model
        times, speed = run.times, float(np.abs(self.setup.state.velocity[0, 2])) + abs(model.flow_z)
        starts = split(setup.state.position, copies)[:, 0, 2]
        heights = [self._path(float(start), times)[0] for start in starts]
        ends = q.final_velocity(run, copies)[:, 0, 2]
        found.add("velocity_z", "20-22, 29", "m/s", ends, self._path(self.height, times)[1][-1], speed)
        gained = model.surface_density * sum(hit.removal.volume for hit in self.exact.impacts[: self.count])
        if model.mass_pickup:
            limit = REMOVED_VOLUME_LIMIT
            found.add("removed_mass", "36", "kg", q.mass_gained(run, copies), gained, gained, limit=limit)
        apart = np.abs(unwrapped(run, setup)[:, :, 2] - np.stack(heights, axis=1)).max(axis=0)
        path = float(np.abs(np.diff(heights[0])).sum())
        found.add("trajectory_distance", "20-22, 29, 37", "m", apart, 0.0, path)
        return found

    def _path(self, height: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heights (T,) in m and velocities (T,) in m/s, of Stokes's relaxation from impact to impact."""
        state, flow = self.setup.state, np.array([0.0, 0.0, self.setup.model.flow_z])
        train = self._train(height)
        knots = np.concatenate([[0.0], train.times])
        after = [float(state.velocity[0, 2]), *(float(hit.velocity[2]) for hit in train.impacts)]
        masses = [float(state.mass[0]), *(hit.mass for hit in train.impacts)]
        leg = np.searchsorted(knots, times, side="right") - 1
        z, v = np.empty(len(times)), np.empty(len(times))
        for k in np.unique(leg):
            begin = np.array([0.0, 0.0, height if k == 0 else self.radius])
            motion = exact.stokes_motion(
                times[leg == k] - knots[k],
                begin,
                np.array([0.0, 0.0, after[k]]),
                flow,
                masses[k] / self.drag_factor,
            )
            z[leg == k], v[leg == k] = motion.positions[:, 2], motion.velocities[:, 2]
        return z, v

    def impacts(self) -> list[Impact] | None:
        """No bound: what one impact changes, the later ones amplify."""
        return None

    def largest_force(self) -> float:
        """The drag at the largest slip, over the mass."""
        state, model = self.setup.state, self.setup.model
        slip = abs(model.flow_z) + float(np.abs(state.velocity[0, 2]))
        return self.drag_factor * slip / float(state.mass[0])

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Gap below the particle, and the approach speed of each impact."""
        case, times = setup.case, tuple(run.times)
        label = {"case": case.name, "variant": case.variant, "engine": engine}
        if engine == "exact":
            train = self._train(float(setup.state.position[0, 2]))
            when, speeds = tuple(train.times[: self.count]), tuple(train.approach_speeds[: self.count])
            return [
                Trace(
                    **label,
                    label="approach speed",
                    unit="m/s",
                    times=when,
                    values=speeds,
                    style="points",
                )
            ]
        gap = unwrapped(run, setup)[:, 0, 2] - self.radius
        impacts = run.contacts[(run.contacts["i"] == 0) & (run.contacts["kind"] == "surface")]
        when, speeds = tuple(impacts["time"]), tuple(impacts["approach_speed"])
        return [
            Trace(**label, label="gap below the particle", unit="m", times=times, values=tuple(gap)),
            Trace(**label, label="approach speed", unit="m/s", times=when, values=speeds, style="points"),
        ]
