"""A sphere that rests on a flat wall is struck by another: three bodies at once, Eqs 9 and 29-36.

The exact values are impacts in turn, as the model has them.  What soft contacts make of it is
`cmpcheck/three_bodies.py`.
"""

from __future__ import annotations

import numpy as np

from cmpcheck import quantities as q
from cmpcheck.judges.protocol import REMOVED_VOLUME_LIMIT, Findings, Impact, Measured
from cmpcheck.judges.wall import wall_of
from cmpcheck.phases import split, unwrapped
from cmpcheck.results import Trace
from reference import exact
from reference.recording import Run
from reference.state import Setup

UP = np.array([0.0, 0.0, 1.0])


class StruckJudge:
    """Judges what becomes of both spheres, and what the wall gives and loses in all impacts together."""

    copies = 32
    has_surface_contact = True
    refines_contact = True

    def __init__(self, setup: Setup):
        state, model = setup.state, setup.model
        radii, apart = state.diameter / 2, state.position[1] - state.position[0]
        below = state.position[0, 2] <= radii[0] * (1 + 1e-9) and not state.velocity[0].any()
        falls = not apart[:2].any() and not state.velocity[1, :2].any() and state.velocity[1, 2] < 0.0
        if not (below and falls) or state.heights.any() or model.mass_pickup:
            raise ValueError(
                "of two spheres and a wall only this is known: without mass_pickup, the first rests on a "
                "flat wall and the second falls on it from straight above"
            )
        self.setup, self.speed = setup, -float(state.velocity[1, 2])
        self.exact = exact.resting_struck(
            float(state.mass[0]), float(state.mass[1]), self.speed, model.restitution
        )
        wall = wall_of(setup)
        hits = [
            exact.removing_impact(float(state.mass[0]), float(radii[0]), -v * UP, UP, wall)
            for v in self.exact.approaches
        ]
        volumes = [hit.removal.volume for hit in hits]
        self.removals, self.volume = sum(volume > 0.0 for volume in volumes), sum(volumes)

    def measure(self, setup: Setup, run: Run) -> list[Measured]:
        """Speeds after, impulse of the wall, number of removing impacts and removed volume of each copy."""
        found = Findings(self.measure_trajectory(setup, run))
        if self.removals:
            caps = [rows["removed_volume"].to_numpy() for rows in q.contacts_by_copy(run, setup, "surface")]
            counts = np.array([float((cap > 0.0).sum()) for cap in caps])
            found.add("removals", "29-36", "1", counts, self.removals, 1.0, rounding=0.5)
            volumes = np.array([cap.sum() for cap in caps])
            found.add(
                "removed_volume", "36", "m3", volumes, self.volume, self.volume,
                limit=REMOVED_VOLUME_LIMIT, against_exact=True,
            )  # fmt: skip
        return found

    def impacts(self) -> list[Impact] | None:
        """No bound: soft contacts make one long contact of them."""
        return None

    def largest_force(self) -> float:
        """None acts."""
        return 0.0

    def measure_trajectory(self, setup: Setup, run: Run) -> list[Measured]:
        """Speeds after, and the impulse of the wall."""
        copies, speed, found = setup.copies, self.speed, Findings()
        after = q.final_velocity(run, copies)[..., 2]
        for k, (name, value) in enumerate((("lower", self.exact.lower), ("upper", self.exact.upper))):
            found.add("velocity_z", "9, 29", "m/s", after[:, k], value, speed, name)
        impulse = q.momentum_change(run, copies)
        found.add(
            "normal_impulse", "29, 30", "N s", impulse, self.exact.normal_impulse, impulse.mean(), "wall"
        )
        return found

    def traces(self, setup: Setup, run: Run, engine: str) -> list[Trace]:
        """Heights of both spheres above where they touch the wall and each other."""
        case, times = setup.case, run.times
        start, radii = split(setup.state.position, setup.copies)[0, :, 2], self.setup.state.diameter / 2
        rest = np.array([radii[0], 2 * radii[0] + radii[1]])
        if engine == "exact":
            met = (start[1] - rest[1]) / self.speed
            after = np.array([self.exact.lower, self.exact.upper]) * np.maximum(times - met, 0.0)[:, None]
            heights = after + np.array([0.0, 1.0]) * np.maximum(met - times, 0.0)[:, None] * self.speed
        else:
            heights = unwrapped(run, setup)[:, :2, 2] - rest
        return [
            Trace(
                case.name, case.variant, engine, f"height of the {name} sphere", "m", tuple(times), tuple(z)
            )
            for name, z in zip(("lower", "upper"), heights.T, strict=True)
        ]
