"""The shear in the reference's stepper, called as `reference/simulation.py` calls it, recording nothing."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from benchmarks.outcome import Timed
from reference.ledger import empty_ledger
from reference.schemes import Numerics
from reference.state import Particles, Setup, State
from reference.timestep import DONE, LEDGER_FULL, P, advance, new_progress

AT_LEAST = 0.5  # s: a shear with large steps is repeated, from its start, until it has taken that long
ROWS = 16_384  # of the ledger, as in a simulation


def run_reference(setup: Setup, time_step: float) -> Timed:
    """Time the reference at a step (s), which is made a little smaller to reach the end in whole steps."""
    shear(setup, time_step, 1)  # compiles
    seconds, steps = 0.0, 0
    while seconds < AT_LEAST:
        once, count, particles = shear(setup, time_step)
        seconds, steps = seconds + once, steps + count
    return Timed(
        seconds, steps, setup.end_time / count, np.arange(len(particles.mass)), particles.position,
        particles.velocity,
    )  # fmt: skip


def shear(setup: Setup, time_step: float, most: int | None = None) -> tuple[float, int, Particles]:
    """From the start to the end, or `most` steps: seconds, steps and the particles."""
    seconds, steps, state = step_on(setup, time_step, most)
    return seconds, steps, state.particles


def step_on(setup: Setup, time_step: float, most: int | None = None) -> tuple[float, int, State]:
    """From the start to the end, or `most` steps: seconds, steps and the whole state, its time from 0."""
    steps = most or int(np.ceil(setup.end_time / time_step - 1e-9))
    end = setup.end_time if most is None else steps * time_step
    part = setup.case.numerics
    numerics = Numerics(
        time_step, part.scheme == "fixed_point", part.tolerance, part.iterations, part.norm == "printed",
        part.contacts == "iterated", part.ledger_speed,
    )  # fmt: skip
    particles = Particles(*(array.copy() for array in setup.state.particles))
    heights, scalars = setup.state.heights.copy(), new_progress()
    rows = empty_ledger(max(ROWS, 20 * len(particles.mass)))
    scalars[P.step], scalars[P.pad_height] = time_step, setup.state.pad_height
    begin = perf_counter()
    while True:
        left = int(steps - scalars[P.steps])
        status = advance(setup.model, numerics, scalars, end, left, particles, heights, rows)
        if status == DONE:
            seconds, pad_height = perf_counter() - begin, float(scalars[P.pad_height])
            state = State(float(scalars[P.time]), *particles, heights, pad_height)
            return seconds, int(scalars[P.steps]), state
        if status != LEDGER_FULL:
            raise RuntimeError(f"the reference has stopped with status {status}")
        scalars[P.rows] = 0
