"""One particle between a flat wall and a pad that descends and then rests: Eqs 29-31 in the frame of each."""

from __future__ import annotations

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import Findings, Impact, Measured
from cmpcheck.phases import unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.recording import Run
from reference.state import Setup


class PadJudge:
    """Judges each impact on pad and wall, and the height of the pad at all times."""

    copies = 32
    has_surface_contact = True
    refines_contact = True

    def __init__(self, setup: Setup):
        self.setup = setup
        state, model = setup.state, setup.model
        self.pad = exact.Pad(state.pad_height, model.pad_minimum, model.pad_descent, model.pad_restitution)
        self.exact = exact.between_wall_and_pad(
            float(state.position[0, 2]), float(state.velocity[0, 2]), float(state.mass[0]),
            float(state.diameter[0]) / 2, model.restitution, self.pad, setup.end_time,
        )  # fmt: skip
        if not any(hit.kind == "pad" for hit in self.exact):
            raise ValueError("the particle does not reach the pad")

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Of each impact its time, speed and impulse; velocities at the end; the pad's height."""
        found = Findings()
        heights = run.history["pad_height"].to_numpy(float)
        wrong = float(np.abs(heights - self.pad.at(run.times)).max())
        rounding = run.provenance["steps"] * q.EPS * self.pad.height
        found.add("pad_height", "", "m", wrong, 0.0, self.pad.height, rounding=rounding)
        by_kind = {kind: q.contacts_by_copy(run, setup, kind) for kind in ("pad", "surface")}
        for kind, contacts in by_kind.items():
            hits = [hit for hit in self.exact if hit.kind == kind]
            counts = np.array([len(rows) for rows in contacts], float)
            found.add("impacts", "29", "1", counts, len(hits), 1.0, kind, rounding=0.5)
            if (counts != len(hits)).any():
                continue
            for k, (hit, rows) in enumerate(zip(hits, q.contact_columns(contacts, len(hits)), strict=True)):
                place = f"{kind}, impact {k + 1}"
                speed, impulse = hit.approach_speed, hit.normal_impulse
                found.add("impact_time", "2, 37", "s", rows["time"], hit.time, hit.time, place)
                found.add("approach_speed", "29", "m/s", rows["approach_speed"], speed, speed, place)
                found.add("normal_impulse", "29, 30", "N s", rows["normal_impulse"], impulse, impulse, place)
        found += self.measure_trajectory(setup, run)
        return found

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """Velocities at the end."""
        model, state, found = self.setup.model, self.setup.state, Findings()
        after = q.final_velocity(run, setup.copies)[:, 0]
        scale = float(np.linalg.norm(state.velocity[0])) + model.pad_descent
        for axis, final in enumerate((*state.velocity[0, :2], self.exact[-1].velocity)):
            found.add(f"velocity_{'xyz'[axis]}", "29, 31", "m/s", after[:, axis], final, scale)
        return found

    def impacts(self) -> list[Impact] | None:
        """No bound: each impact decides when and how fast the next one is."""
        return None

    def largest_force(self) -> float:
        """Not asked for without a bound on the impacts."""
        return 0.0

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Height of the centre between wall and pad."""
        case, times = setup.case, np.asarray(run.times)
        heights = unwrapped(run, setup)[:, 0, 2]
        if engine == "exact":
            start = setup.state
            knots = [0.0, *(hit.time for hit in self.exact)]
            centres = [float(start.position[0, 2]), *(hit.height for hit in self.exact)]
            speeds = [float(start.velocity[0, 2]), *(hit.velocity for hit in self.exact)]
            leg = np.searchsorted(knots, times, side="right") - 1
            heights = np.array(centres)[leg] + np.array(speeds)[leg] * (times - np.array(knots)[leg])
        label = "height of the centre"
        return [Trace(case.name, case.variant, engine, label, "m", tuple(times), tuple(heights))]
