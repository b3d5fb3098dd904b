"""How fast are the engines?  The same shear in each of them, in turn, in one run.

`python -m benchmarks.engines` writes `engines.md` here, and the keys `particle_steps_per_s` and `engines` of
`results.json`.  It exits with 1, and shows no speed, where a run fails or does not end as the reference's.
How a run is made is `shear_*.py`, what is written `engines_page.py`.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from benchmarks import engines_page, record, shear_yade
from benchmarks.measurement import Cell, Way
from benchmarks.outcome import Timed, outcome
from benchmarks.shear import SURFACES, shear_setup, soft_resolution
from benchmarks.shear_lammps import run_lammps
from benchmarks.shear_liggghts import run_liggghts, run_observed
from benchmarks.shear_reference import run_reference, shear
from benchmarks.shear_yade import run_yade
from cmpcheck.engines import lammps_library, liggghts_library
from reference.state import Setup

SIZES, REPEATS = (73, 5_000), 5


def at_own_step(setup: Setup) -> Timed:
    return run_reference(setup, setup.time_step)


def at_soft_step(setup: Setup) -> Timed:
    return run_reference(setup, soft_resolution(setup.case).time_step)


def all_ways() -> list[Way]:
    """Every way to run the shear that is timed.  A further engine is a further entry here."""
    lammps, liggghts = lammps_library.available()[1], liggghts_library.available()[1]
    ways = [
        Way("reference", "reference, its own step of 9 ns", at_own_step),
        Way("reference_soft_step", "reference, the step of the others", at_soft_step),
    ]
    for ranks in (1, 2):
        run = partial(run_lammps, ranks=ranks, walls="fix")
        ways.append(Way("lammps_fix", "LAMMPS with the Python fix", run, ranks, missing=lammps))
    run = partial(run_lammps, ranks=1, walls="fix", observed=True)
    ways.append(
        Way("lammps_observed", "LAMMPS with the fix, contacts of pairs followed", run, missing=lammps)
    )
    for ranks in (1, 2):
        label = "LAMMPS by itself: plane, drag as a variable"
        run = partial(run_lammps, ranks=ranks, walls="native")
        ways.append(Way("lammps_native", label, run, ranks, ("flat",), lammps))
    for ranks in (1, 2):
        label = "LIGGGHTS by itself: mesh, drag as a variable"
        ways.append(Way("liggghts", label, partial(run_liggghts, ranks=ranks), ranks, missing=liggghts))
    label = "LIGGGHTS as `cmpcheck compare` drives it"
    ways.append(Way("liggghts_observed", label, run_observed, missing=liggghts))
    for ranks in (1, 2):
        label = "LIGGGHTS by itself: plane, drag as a variable"
        run = partial(run_liggghts, ranks=ranks, planes=True)
        ways.append(Way("liggghts_plane", label, run, ranks, ("flat",), liggghts))
    label = "YADE: contacts of pairs, all else in Python"
    ways.append(Way("yade", label, run_yade, surfaces=("flat",), missing=shear_yade.missing()))
    return ways


def usual_end(setup: Setup) -> Timed:
    """The end of the reference's run at the step of the soft engines, by which all are judged."""
    step = soft_resolution(setup.case).time_step
    seconds, steps, end = shear(setup, step)
    return Timed(seconds, steps, step, np.arange(len(end.mass)), end.position, end.velocity)


def measure(
    sizes: Sequence[int] = SIZES,
    repeats: int = REPEATS,
    ways: Sequence[Way] | None = None,
    surfaces: Sequence[str] = SURFACES,
    steps: int | None = None,
    say: Callable[[str], None] = print,
) -> list[Cell]:
    """Run every way `repeats` times over every surface and size, in turn: there, back, there, ..."""
    setups = {(surface, n): shear_setup(n, surface, steps) for n in sizes for surface in surfaces}
    usual = {where: usual_end(setup) for where, setup in setups.items()}
    ways = all_ways() if ways is None else ways
    cells = [
        Cell(way, surface, n, 2 * setup.state.heights.size)
        for (surface, n), setup in setups.items()
        for way in ways
        if surface in way.surfaces
    ]
    for repeat in range(repeats):
        for cell in cells if repeat % 2 == 0 else reversed(cells):
            if cell.way.missing or cell.problem:
                continue
            where = cell.surface, cell.count
            busy = record.busy_cores()
            try:
                timed = cell.way.run(setups[where])
            except Exception as error:  # of any engine: the others go on
                cell.failure = f"{type(error).__name__}: {error}"
            else:
                cell.add(timed, outcome(setups[where], timed, usual[where]), busy)
            say(f"{repeat + 1}/{repeats} {cell}")
    return cells


def positive(word: str) -> int:
    value = int(word)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{word}: allowed: 1 and more")
    return value


def main(arguments: Sequence[str] | None = None) -> int:
    words = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(prog="python -m benchmarks.engines", description=__doc__)
    parser.add_argument("--sizes", type=positive, nargs="+", default=SIZES, help="numbers of particles")
    parser.add_argument("--repeats", type=positive, default=REPEATS, help="of each measurement")
    parser.add_argument("--steps", type=positive, help="of the soft engines in each run")
    chosen = parser.parse_args(words)
    conditions = record.conditions(shlex.join(["python", "-m", "benchmarks.engines", *words]))
    cells = measure(chosen.sizes, chosen.repeats, steps=chosen.steps)
    engines_page.write(cells, conditions)
    return 1 if any(cell.problem for cell in cells) else 0


if __name__ == "__main__":
    sys.exit(main())
