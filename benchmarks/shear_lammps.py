"""The shear in LAMMPS, on one rank or more: `python -m benchmarks.shear_lammps JOB END` does one run.

A process for each run, because ranks need a launcher.  JOB is a pickled `Job`, END gets the pickled `Timed`.
"""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.outcome import Timed
from benchmarks.shear import DECKS, soft_resolution, soft_steps
from cmpcheck.engines.lammps_library import open_lammps, per_atom
from cmpcheck.engines.lammps_setup import create_atoms, execute, input_flags, variables
from cmpcheck.fixes.layout import MICRO
from cmpcheck.fixes.slurry import SlurryFix
from reference.state import Setup

DECK = DECKS / "in.shear"
LOOP = re.compile(r"^Loop time of (\S+) on \d+ procs for (\d+) steps", re.MULTILINE)
TIMEOUT = 900.0  # s


class Job(NamedTuple):
    """One run: surface, lid and drag by the fix, or by LAMMPS itself; contacts of pairs followed or not."""

    setup: Setup
    walls: str  # fix | native
    observed: bool


def run_lammps(setup: Setup, ranks: int, walls: str, observed: bool = False) -> Timed:
    """One run in processes of its own.  Raises RuntimeError with what they said when they fail."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        job, end = Path(folder) / "job", Path(folder) / "end"
        job.write_bytes(pickle.dumps(Job(setup, walls, observed)))
        launcher = [str(Path(sys.executable).with_name("mpiexec")), "-n", str(ranks)] if ranks > 1 else []
        command = [*launcher, sys.executable, "-m", "benchmarks.shear_lammps", str(job), str(end)]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=TIMEOUT, cwd=Path(__file__).parents[1],
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if done.returncode != 0:
            raise RuntimeError(f"LAMMPS has failed: {(done.stdout + done.stderr)[-500:]}")
        timed: Timed = pickle.loads(end.read_bytes())
        return timed


def loop_time(log: Path, steps: int) -> float:
    """Seconds that LAMMPS or LIGGGHTS says its loop of `steps` steps took, without setting up the run.

    Raises RuntimeError when the log has no such loop.
    """
    for seconds, count in LOOP.findall(log.read_text("utf-8", "replace")):
        if int(count) == steps:
            return float(seconds)
    raise RuntimeError(f"the log has no loop of {steps} steps")


def work(job: Job, log: Path) -> Timed | None:
    """The run, in this process, one of the ranks; the first one returns its end."""
    setup, resolution, steps = job.setup, soft_resolution(job.setup.case), soft_steps(job.setup)
    arguments = [
        "-log",
        str(log),
        "-screen",
        "none",
        "-var",
        "driver",
        "cmpcheck",
        "-var",
        "walls",
        job.walls,
    ]
    values = variables(setup, resolution, resolution.time_step)
    values["lid"] = setup.state.pad_height / MICRO
    lmp = open_lammps(arguments + input_flags(values))
    comm = lmp.get_mpi_comm()
    execute(lmp, DECK.read_text("utf-8"), DECK)
    create_atoms(lmp, setup.state)
    fix = None
    if job.walls == "fix":
        lmp.command("fix slurry all external pf/callback 1 1")
        fix = SlurryFix(
            lmp, "slurry", setup.model, setup.state.modulus, setup.state.heights,
            pad_height=setup.state.pad_height, form="soft", contact_duration=resolution.contact_duration,
            ledger_speed=setup.case.numerics.ledger_speed, observe_pairs=job.observed, comm=comm,
        )  # fmt: skip
        fix.attach()
    for line in (f"timestep {resolution.time_step / MICRO!r}", "thermo 0", "run 0", f"run {steps}"):
        lmp.command(line)
    if fix is not None:
        fix.check()
    parts = comm.gather(_atoms(lmp))
    lmp.close()
    if comm.rank > 0:
        return None
    index, position, velocity = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Timed(loop_time(log, steps), steps, resolution.time_step, index, position, velocity)


def _atoms(lmp: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index, position and velocity of this rank's atoms, SI."""
    n = lmp.extract_setting("nlocal")
    tags = np.array(lmp.numpy.extract_atom("id", nelem=n), dtype=np.int64).reshape(-1)
    return tags - 1, per_atom(lmp, "x", n, 3) * MICRO, per_atom(lmp, "v", n, 3).copy()


def main() -> None:
    job, end = map(Path, sys.argv[1:])
    timed = work(pickle.loads(job.read_bytes()), end.with_name("log"))
    if timed is not None:
        end.write_bytes(pickle.dumps(timed))


if __name__ == "__main__":
    main()
