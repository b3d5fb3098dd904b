"""The shear in LIGGGHTS: as its users run it, a deck and one `run`, and as `cmpcheck compare` drives it."""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.outcome import Timed
from benchmarks.shear import DECKS, shear_setup, soft_resolution, soft_steps
from benchmarks.shear_lammps import TIMEOUT, loop_time
from cmpcheck.engines.child import MPI_VARIABLES
from cmpcheck.engines.lammps_setup import input_flags
from cmpcheck.engines.liggghts import LiggghtsEngine
from cmpcheck.engines.liggghts_library import PROGRAM
from cmpcheck.engines.liggghts_setup import deck_variables, write_surface
from cmpcheck.fixes.layout import MICRO
from reference.heightfield import Heightfield
from reference.recording import Run
from reference.state import Setup

DECK = DECKS / "in.shear.liggghts"
LAUNCHER = ("mpiexec.openmpi", "--allow-run-as-root", "--oversubscribe", "-n")


def run_liggghts(setup: Setup, ranks: int, planes: bool = False) -> Timed:
    """One run of the deck by the program itself; `planes`: the surface is a plane, not a mesh.

    Raises RuntimeError when it fails.
    """
    resolution, steps = soft_resolution(setup.case), soft_steps(setup)
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as name:
        folder = Path(name)
        values = deck_variables(setup, resolution, resolution.time_step, folder / "surface.stl")
        values |= {"steps": str(steps), "planes": str(int(planes)), "lid": setup.state.pad_height / MICRO}
        _write_atoms(setup, (float(values["z_low"]), float(values["z_high"])), folder / "atoms.data")
        if not planes:
            write_surface(Heightfield(setup.state.heights, setup.model.spacing), folder / "surface.stl")
        command = [*((*LAUNCHER, str(ranks)) if ranks > 1 else ()), PROGRAM, "-in", str(DECK)]
        command += ["-log", "log", "-screen", os.devnull]  # "none" crashes with a mesh
        command += input_flags(values)
        environment = {key: value for key, value in os.environ.items() if not key.startswith(MPI_VARIABLES)}
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            timeout=TIMEOUT, cwd=folder, env=environment,
        )  # fmt: skip
        if done.returncode != 0 or not (folder / "end.dump").exists():
            said = (folder / "log").read_text("utf-8", "replace") if (folder / "log").exists() else ""
            raise RuntimeError(f"LIGGGHTS has failed: {(said + done.stderr)[-500:]}")
        end = np.loadtxt(folder / "end.dump", skiprows=9, ndmin=2)
        seconds = loop_time(folder / "log", steps)
    return Timed(
        seconds, steps, resolution.time_step, end[:, 0].astype(int) - 1, end[:, 1:4] * MICRO, end[:, 4:7]
    )


def run_observed(setup: Setup) -> Timed:
    """One run by `LiggghtsEngine`, which looks at every step at which something may touch.

    Raises EngineError when it fails.
    """
    _compile()
    run, n = _engine_run(setup), len(setup.state.mass)
    return Timed(
        run.provenance["stepping_seconds"], run.provenance["steps"], run.provenance["time_step"],
        np.arange(n), run.positions[-1], run.velocities[-1],
    )  # fmt: skip


def _engine_run(setup: Setup) -> Run:
    """The lid is the deck's plane here too, of which the engine need not know: it never moves."""
    model = setup.model._replace(has_pad=False, gap=setup.state.pad_height)
    engine = LiggghtsEngine({setup.case.name: DECK})
    return engine.run(replace(setup, model=model), soft_resolution(setup.case))


@cache
def _compile() -> None:
    """Let the engine's process, which stays, compile or load its kernels before they are timed."""
    _engine_run(shear_setup(20, "asperities", 50))


def _write_atoms(setup: Setup, z: tuple[float, float], path: Path) -> None:
    """Box and particles as a data file of LIGGGHTS, in um and kg/m3."""
    state, n = setup.state, len(setup.state.mass)
    density = state.mass / (np.pi / 6 * state.diameter**3)
    tags, ones = np.arange(1, n + 1), np.ones(n)
    with path.open("w") as file:
        file.write(f"the shear\n\n{n} atoms\n2 atom types\n\n")
        for axis, length in (("x", setup.model.length_x), ("y", setup.model.length_y)):
            file.write(f"0 {length / MICRO!r} {axis}lo {axis}hi\n")
        file.write(f"{z[0]!r} {z[1]!r} zlo zhi\n")
        file.write("\nAtoms\n\n")
        atoms = np.column_stack([tags, ones, state.diameter / MICRO, density, state.position / MICRO])
        np.savetxt(file, atoms, fmt=["%d", "%d", *5 * ["%.17g"]])
        file.write("\nVelocities\n\n")
        np.savetxt(
            file, np.column_stack([tags, state.velocity, np.zeros((n, 3))]), fmt=["%d", *6 * ["%.17g"]]
        )
