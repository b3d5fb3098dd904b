"""One run of LIGGGHTS, in the child process: from a deck and a setup to what was observed.

LIGGGHTS integrates and computes the contacts with particles and mesh; between its steps each contact is
followed from outside (`fixes/native.py`, `fixes/pairs.py`), and the surface is lowered by the reference's
kernels and read by LIGGGHTS again before a particle can touch where it was lowered.
"""

from __future__ import annotations

from pathlib import Path
from time import perf_counter

import numpy as np

from cmpcheck.engines.lammps_setup import Deck
from cmpcheck.engines.liggghts_library import Liggghts
from cmpcheck.engines.liggghts_setup import OBSERVED, create_atoms, deck_variables, wall_lines, write_surface
from cmpcheck.engines.observed import Observed
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import ERRORS, MICRO, NO_ERROR
from cmpcheck.fixes.memory import Memory
from cmpcheck.fixes.native import (
    WALL_COLUMNS,
    approaches_stale,
    collect_native,
    follow_walls,
    steps_without_contact,
)
from cmpcheck.fixes.pairs import observe_pairs
from cmpcheck.fixes.particles import remove_in_order
from cmpcheck.fixes.samples import store_sample
from reference.heightfield import Heightfield
from reference.state import FLOW_NONE, Setup

SCREEN = "screen"  # file in the working directory that gets what LIGGGHTS says
ONE_STEP = "run 1 pre no post no"
STEP = "run {} pre no post no"


def simulate(deck: Deck, setup: Setup, resolution: Resolution, stride: int, time_step: float) -> Observed:
    """Run the deck in this process, whose working directory gets files.

    Parameters: stride, steps between outputs; time_step in s.
    Raises ValueError, in one line, for a deck or a run that is not as it must be.  LIGGGHTS's own errors end
    the process; the last lines of the file `SCREEN` tell them.
    """
    mesh = Path("surface.stl").absolute()
    if setup.model.has_surface:
        write_surface(Heightfield(setup.state.heights, setup.model.spacing), mesh)
    arguments = ["-log", "none", "-screen", SCREEN, "-var", "driver", "1"]
    for key, value in deck_variables(setup, resolution, time_step, mesh).items():
        arguments += ["-var", key, value if isinstance(value, str) else repr(float(value))]
    part = Path("definitions").absolute()
    part.write_text(deck.definitions(), "utf-8")
    liggghts = Liggghts(arguments)
    try:
        liggghts.file(str(part))
        return _Watched(liggghts, deck, setup, resolution, stride, time_step, mesh).run()
    finally:
        liggghts.close()


class _Watched:
    """A LIGGGHTS instance with the observers beside it."""

    def __init__(
        self, liggghts: Liggghts, deck: Deck, setup: Setup, resolution: Resolution, stride: int,
        time_step: float, mesh: Path,
    ) -> None:  # fmt: skip
        self.liggghts, self.setup, self.stride, self.mesh = liggghts, setup, stride, mesh
        model, state = setup.model, setup.state
        self.mesh_line, self.wall_line, self.mesh_id, self.wall_id = wall_lines(deck)
        self.has_wall = bool(self.wall_line)
        if self.has_wall != model.has_surface and (self.has_wall or model.flow == FLOW_NONE):
            raise ValueError(f"{deck.path}: the case {setup.case.name} and its deck do not agree on a wall")
        observes_pairs = model.has_pairs and len(state.mass) > setup.copies and model.flow == FLOW_NONE
        self.memory = Memory(
            model, state.modulus, state.heights, "observe", resolution.contact_duration, stride, 100_000,
            len(setup.output_times), observes_pairs, state.pad_height, setup.case.numerics.ledger_speed,
        )  # fmt: skip
        self.memory.context.time_step = time_step
        self.contacts = np.zeros((len(state.mass), WALL_COLUMNS))
        self.no_wall = np.zeros((len(state.mass), 3))
        self.stale = np.zeros(state.heights.shape, bool)  # nodes that were lowered since LIGGGHTS read them
        self.step, self.reread, self.reread_seconds = 0, 0, 0.0

    def run(self) -> Observed:
        """From output to output."""
        setup, c = self.setup, self.memory.context
        create_atoms(self.liggghts, setup.state)
        self.liggghts.command(f"timestep {float(c.time_step) / MICRO!r}")
        self.liggghts.command("thermo 0")
        self.liggghts.command("thermo_style custom step")
        self.liggghts.command("run 0 post no")
        surfaces = [setup.state.heights]
        begin = perf_counter()
        self._look()
        for k in range(1, len(setup.output_times)):
            while self.step < k * self.stride:
                self._advance(k * self.stride - self.step)
            surfaces.append(self.memory.heights.copy())
        stepping = perf_counter() - begin
        times, positions, velocities, masses = self.memory.trajectory()
        return Observed(
            times, positions, velocities, masses, self.memory.contacts(), surfaces,
            [setup.state.pad_height] * len(surfaces),
            {
                "surface_read_again": self.reread,
                "surface_read_seconds": self.reread_seconds,
                "stepping_seconds": stepping,
            },
        )  # fmt: skip

    def _advance(self, most: int) -> None:
        """As many steps as surely have no contact, at most `most`; then look."""
        memory = self.memory
        state = memory.by_tag, memory.heights, self.contacts
        steps = min(int(steps_without_contact(memory.context, *state)), most)
        if steps == 1 and self.stale.any() and approaches_stale(memory.context, *state, self.stale):
            self._read_surface()
        self.liggghts.command(ONE_STEP if steps == 1 else STEP.format(steps))
        self.step += steps
        self._look()

    def _look(self) -> None:
        """Follow contacts, lower the surface, and record, at the step that has just been made."""
        memory, c, liggghts = self.memory, self.memory.context, self.liggghts
        n = len(memory.modulus)
        tags = liggghts.tags()
        if len(tags) != n:
            raise ValueError(f"step {self.step}: LIGGGHTS has lost {n - len(tags)} of {n} particles")
        v, mass = liggghts.vectors("v"), liggghts.scalars("rmass")
        wall = liggghts.fix_vectors(f"force_{self.wall_id}") if self.has_wall else self.no_wall
        collect_native(
            c, self.step, OBSERVED, tags, liggghts.vectors("x"), v, liggghts.vectors("f"), wall,
            liggghts.scalars("radius"), mass, memory.by_tag,
        )  # fmt: skip
        first = int(c.rows)
        if self.has_wall and c.error == NO_ERROR:
            follow_walls(
                c, self.step, OBSERVED, tags, v, mass, memory.by_tag, memory.modulus, memory.heights,
                self.contacts, memory.rows,
            )  # fmt: skip
            if c.rows > first:
                before = memory.heights.copy()
                remove_in_order(c, memory.heights, memory.rows, first, c.rows)
                self.stale |= memory.heights != before
        if c.observe_pairs and c.error == NO_ERROR:
            observe_pairs(
                c, self.step, memory.by_tag, memory.modulus, memory.position, memory.pairs, memory.listed,
                memory.open_pairs, memory.rows,
            )  # fmt: skip
        if self.step % self.stride == 0 and c.error == NO_ERROR:
            store_sample(c, self.step, memory.by_tag, memory.samples)
        if c.error != NO_ERROR:
            raise ValueError(f"step {c.error_step}, particle {c.error_tag - 1}: {ERRORS[int(c.error)]}")

    def _read_surface(self) -> None:
        """Let LIGGGHTS read the surface as it is now."""
        begin = perf_counter()
        write_surface(Heightfield(self.memory.heights, self.setup.model.spacing), self.mesh)
        for line in (f"unfix {self.wall_id}", f"unfix {self.mesh_id}", self.mesh_line, self.wall_line):
            self.liggghts.command(line)
        self.liggghts.command("run 0 post no")
        self.stale[:] = False
        self.reread += 1
        self.reread_seconds += perf_counter() - begin
