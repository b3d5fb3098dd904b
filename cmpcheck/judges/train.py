"""One particle that a uniform flow presses on a flat wall: the train of its bounces, Eqs 20-36 with drag."""

from __future__ import annotations

import math

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import REMOVED_VOLUME_LIMIT, Measured
from cmpcheck.judges.wall import wall_of
from cmpcheck.phases import unwrapped
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
        self.radius = float(state.diameter[0]) / 2
        self.drag_factor = 3.0 * math.pi * model.viscosity * 2.0 * self.radius
        self.exact = self._train(float(state.position[0, 2]))
        self.impacts = int((self.exact.times < setup.end_time).sum())

    def _train(self, height: float) -> exact.BounceTrain:
        state, model = self.setup.state, self.setup.model
        return exact.bounce_train(
            height - self.radius, -float(state.velocity[0, 2]), -model.flow_z, float(state.mass[0]), self.radius,
            self.drag_factor, wall_of(self.setup), MOST_IMPACTS,
        )  # fmt: skip

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Per impact its time, speed, impulse, load and volume; mass and its balance at the end."""
        copies, model = setup.copies, self.setup.model
        contacts = q.contacts_by_copy(run, setup, "surface")
        counts = np.array([len(rows) for rows in contacts], float)
        measured = [Measured("impacts", "", "29", "1", counts, float(self.impacts), 1.0, rounding=0.5)]
        if (counts != self.impacts).any():
            return measured

        def add(quantity, place, equations, unit, values, expected, scale, **more):
            values = np.asarray(values, float)
            measured.append(Measured(quantity, place, equations, unit, values, float(expected), float(scale), **more))

        removed = 0.0
        for k, rows in enumerate(q.contact_columns(contacts, self.impacts)):
            hit, place = self.exact.impacts[k], f"impact {k + 1}"
            speed = self.exact.approach_speeds[k]
            add("approach_speed", place, "20-22, 29", "m/s", rows["approach_speed"], speed, speed)
            add("normal_impulse", place, "29, 30", "N s", q.model_impulse(rows), hit.normal_impulse, hit.normal_impulse)
            add("load", place, "30", "N", rows["load"], hit.load, hit.load)
            if hit.removal.volume > 0.0:
                volume, limit = rows["removed_volume"], REMOVED_VOLUME_LIMIT
                add("removed_volume", place, "32-36", "m3", volume, hit.removal.volume, hit.removal.volume, limit=limit)
            removed += hit.removal.volume
        mass = model.surface_density * removed
        gained = q.mass_gained(run, copies)
        limit = REMOVED_VOLUME_LIMIT
        if model.mass_pickup:
            add("removed_mass", "", "36", "kg", gained, mass, mass, limit=limit)
            balance = gained - model.surface_density * q.volume_lost(run, copies)
            rounding = model.surface_density * q.volume_rounding(run) + 2 * q.EPS * float(run.masses.max()) * len(counts)
            add("mass_balance", "", "36", "kg", balance, 0.0, mass, rounding=rounding)
        return measured

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Gap below the particle, and the approach speed of each impact."""
        case, times = setup.case, tuple(run.times)
        label = {"case": case.name, "variant": case.variant, "engine": engine}
        if engine == "exact":
            train = self._train(float(setup.state.position[0, 2]))
            when, speeds = train.times[: self.impacts], train.approach_speeds[: self.impacts]
            return [
                Trace(**label, label="approach speed", unit="m/s", times=tuple(when), values=tuple(speeds), style="points")
            ]
        gap = unwrapped(run, setup)[:, 0, 2] - self.radius
        impacts = run.contacts[(run.contacts["i"] == 0) & (run.contacts["kind"] == "surface")]
        when, speeds = tuple(impacts["time"]), tuple(impacts["approach_speed"])
        return [
            Trace(**label, label="gap below the particle", unit="m", times=times, values=tuple(gap)),
            Trace(**label, label="approach speed", unit="m/s", times=when, values=speeds, style="points"),
        ]
