"""One run of LIGGGHTS, in the child process: from a deck and a setup to what was observed.

LIGGGHTS integrates and computes the contacts with particles and mesh; between its steps each contact is
followed from outside (`fixes/native.py`, `fixes/pairs.py`), and the surface is lowered by the reference's
kernels and read by LIGGGHTS again before a particle can touch where it was lowered.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np

from cmpcheck.engines.lammps_setup import Deck, input_flags
from cmpcheck.engines.liggghts_library import Liggghts, opened
from cmpcheck.engines.liggghts_setup import (
    OBSERVED,
    create_atoms,
    deck_variables,
    pad_id,
    wall_lines,
    write_pad,
    write_surface,
)
from cmpcheck.engines.observed import Observed
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.calibration import spring
from cmpcheck.fixes.layout import ERRORS, MICRO
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.native import WALL_COLUMNS, look, plan_steps
from reference.heightfield import Heightfield
from reference.pad import lowest_pad_height, pad_velocity
from reference.state import FLOW_NONE, Setup

DESCENT = "cmpcheck_descent"  # ID of the fix that moves the pad
ONE_STEP = "run 1 pre no post no"
STEP = "run {} pre no post no"


def simulate(deck: Deck, setup: Setup, resolution: Resolution, stride: int, time_step: float) -> Observed:
    """Run the deck in this process, whose working directory gets files.

    Parameters: stride, steps between outputs; time_step in s.
    Raises ValueError, in one line, for a deck or a run that is not as it must be.  LIGGGHTS's own errors end
    the process; the last lines of its output tell them.
    """
    mesh = Path("surface.stl").absolute()
    if setup.model.has_surface:
        write_surface(Heightfield(setup.state.heights, setup.model.spacing), mesh)
    if setup.model.has_pad:
        write_pad(setup, mesh.with_name("pad.stl"))
    values = {"driver": "1", **deck_variables(setup, resolution, time_step, mesh)}
    with opened(deck.definitions(), input_flags(values)) as liggghts:
        return _Watched(liggghts, deck, setup, resolution, stride, time_step, mesh).run()


class _Watched:
    """A LIGGGHTS instance with the observers beside it."""

    def __init__(
        self, liggghts: Liggghts, deck: Deck, setup: Setup, resolution: Resolution, stride: int,
        time_step: float, mesh: Path,
    ) -> None:  # fmt: skip
        self.liggghts, self.setup, self.stride, self.mesh = liggghts, setup, stride, mesh
        model, state = setup.model, setup.state
        self.mesh_line, self.wall_line, self.mesh_id, self.wall_id = wall_lines(deck)
        self.has_wall, self.wall_force = bool(self.wall_line), f"force_{self.wall_id}".encode()
        if self.has_wall != model.has_surface and (self.has_wall or model.flow == FLOW_NONE):
            raise ValueError(f"{deck.path}: the case {setup.case.name} and its deck do not agree on a wall")
        self.pad = pad_id(deck)
        if model.has_pad != bool(self.pad):
            raise ValueError(f"{deck.path}: the case {setup.case.name} and its deck do not agree on a pad")
        observes_pairs = model.has_pairs and len(state.mass) > setup.copies and model.flow == FLOW_NONE
        self.memory = Memory(
            model, state.modulus, state.heights, "observe", resolution.contact_duration, stride, 100_000,
            len(setup.output_times), observes_pairs, state.pad_height, setup.case.numerics.ledger_speed,
        )  # fmt: skip
        self.memory.context.time_step = time_step
        self.memory.context.largest = state.diameter.max()
        if model.has_pad:
            self.memory.context.spring, _ = spring(model.restitution, resolution.contact_duration)
        self.contacts = np.zeros((len(state.mass), WALL_COLUMNS))
        self.no_wall = np.zeros((len(state.mass), 3))
        self.known = state.heights.copy()  # the surface as LIGGGHTS has read it
        self.step, self.reread, self.reread_seconds = 0, 0, 0.0
        self.pad_speed = 0.0  # of LIGGGHTS's pad

    def run(self) -> Observed:
        """From output to output."""
        setup, c = self.setup, self.memory.context
        create_atoms(self.liggghts, setup.state)
        self.liggghts.command(f"timestep {float(c.time_step) / MICRO!r}")
        self.liggghts.command("thermo 0")
        self.liggghts.command("thermo_style custom step")
        self.liggghts.command("run 0 post no")
        surfaces, pad_heights = [setup.state.heights], [setup.state.pad_height]
        begin = perf_counter()
        self._look()
        for k in range(1, len(setup.output_times)):
            while self.step < k * self.stride:
                self._advance(k * self.stride - self.step)
            surfaces.append(self.memory.heights.copy())
            pad_heights.append(float(c.pad_height))
        stepping = perf_counter() - begin
        times, positions, velocities, masses = self.memory.trajectory()
        return Observed(
            times, positions, velocities, masses, self.memory.contacts(), surfaces, pad_heights,
            {
                "surface_read_again": self.reread,
                "surface_read_seconds": self.reread_seconds,
                "stepping_seconds": stepping,
            },
        )  # fmt: skip

    def _advance(self, most: int) -> None:
        """As many steps as surely have no contact, at most `most`; then look."""
        memory = self.memory
        free, stale = plan_steps(memory.context, memory.by_tag, self.known, self.contacts, memory.heights)
        steps = min(free, most)
        if stale:
            self._read_surface()
        if self.pad:
            self._steer_pad()
        self.liggghts.command(ONE_STEP if steps == 1 else STEP.format(steps))
        self.step += steps
        if self.pad_speed:
            memory.context.pad_height -= self.pad_speed * steps * memory.context.time_step
        self._look()

    def _steer_pad(self) -> None:
        """Let the pad descend or rest for the next step, as `reference/pad.py` says, and the drag know H."""
        c, model = self.memory.context, self.setup.model
        lowest = lowest_pad_height(model, c.highest, c.largest)
        speed = float(pad_velocity(model, c.pad_height, lowest))
        if speed == self.pad_speed:
            return
        if self.pad_speed:
            self.liggghts.command(f"unfix {DESCENT}")
        if speed:
            self.liggghts.command(f"fix {DESCENT} all move/mesh mesh {self.pad} linear 0 0 {-speed!r}")
        # a variable defined anew must be followed by a run with its set-up, which looks it up
        height = float(c.pad_height) / MICRO
        self.liggghts.command(f"variable film equal {height!r}-{speed!r}*(step-{self.step})*dt")
        self.liggghts.command("run 0 post no")
        self.pad_speed = speed

    def _look(self) -> None:
        """Follow contacts, lower the surface, and record, at the step that has just been made."""
        memory, liggghts = self.memory, self.liggghts
        tags = liggghts.tags()
        if len(tags) != len(memory.modulus):
            lost = len(memory.modulus) - len(tags)
            raise ValueError(f"step {self.step}: LIGGGHTS has lost {lost} of {len(memory.modulus)} particles")
        failed = look(
            memory.context, self.step, OBSERVED, tags, liggghts.vectors(b"x"), liggghts.vectors(b"v"),
            liggghts.vectors(b"f"), liggghts.fix_vectors(self.wall_force) if self.has_wall else self.no_wall,
            liggghts.scalars(b"radius"), liggghts.scalars(b"rmass"), memory.by_tag, memory.modulus,
            memory.heights, self.contacts, memory.rows, memory.position, memory.pairs, memory.listed,
            memory.open_pairs, memory.samples,
        )  # fmt: skip
        if failed:
            c = memory.context
            raise ValueError(f"step {c.error_step}, particle {c.error_tag - 1}: {ERRORS[int(c.error)]}")

    def _read_surface(self) -> None:
        """Let LIGGGHTS read the surface as it is now."""
        begin = perf_counter()
        write_surface(Heightfield(self.memory.heights, self.setup.model.spacing), self.mesh)
        for line in (f"unfix {self.wall_id}", f"unfix {self.mesh_id}", self.mesh_line, self.wall_line):
            self.liggghts.command(line)
        self.liggghts.command("run 0 post no")
        self.known = self.memory.heights.copy()
        self.reread += 1
        self.reread_seconds += perf_counter() - begin
