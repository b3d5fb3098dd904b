"""The shear in YADE: `yade -n -x shear_yade_script.py FOLDER` in a process of its own, on one thread.

YADE moves the particles and has their contacts with each other.  Drag, surface and lid are a Python function
that it calls at every step: it has no Stokes's drag in a shear flow, and a plane does not fit a periodic box.
Units are um, us, pg.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.outcome import Timed
from benchmarks.shear import soft_resolution, soft_steps
from benchmarks.shear_lammps import TIMEOUT
from cmpcheck.fixes.calibration import spring
from cmpcheck.fixes.layout import MICRO, PICOGRAM
from reference.drag import drag_factor
from reference.state import Setup

SCRIPT = Path(__file__).with_name("shear_yade_script.py")
SLIP_RATE = 20.0  # frequency of the tangential spring, over the contact duration


def missing() -> str:
    """Why it cannot be run here, "" if it can."""
    return "" if shutil.which("yade") else "no command yade; install with: apt-get install yade"


def run_yade(setup: Setup) -> Timed:
    """One run over a flat surface.  Raises RuntimeError with what YADE said when it fails."""
    state, model, resolution = setup.state, setup.model, soft_resolution(setup.case)
    steps, duration = soft_steps(setup), resolution.contact_duration / MICRO
    square, damping = spring(model.restitution, duration)  # per mass
    pair, wall = float(state.mass.mean()) / 2 / PICOGRAM, state.mass / PICOGRAM
    stokes = np.array([drag_factor(0.0, d, model.fluid_density, model.viscosity) for d in state.diameter])
    job = {
        "positions": state.position / MICRO, "velocities": state.velocity, "masses": wall,
        "radii": state.diameter / 2 / MICRO, "kn": pair * square, "cn": pair * damping,
        "ks": pair * (SLIP_RATE / duration) ** 2, "cs": 2.0 * pair * SLIP_RATE / duration,
        "friction": math.atan(model.dynamic_friction), "wall_spring": wall * square,
        "wall_damping": wall * damping,
        "stokes": stokes * MICRO / PICOGRAM,
        "lid": state.pad_height / MICRO, "wall_speed": model.wall_speed,
        "periods": np.array([model.length_x, model.length_y]) / MICRO,
        "time_step": resolution.time_step / MICRO, "steps": steps,
    }  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as name:
        folder = Path(name)
        np.savez(folder / "job.npz", **job)
        done = subprocess.run(
            ["yade", "-n", "-x", "-j1", str(SCRIPT), name], cwd=folder, capture_output=True, text=True,
            errors="replace", timeout=TIMEOUT, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
        if done.returncode != 0 or not (folder / "end.npz").exists():
            raise RuntimeError(f"YADE has failed: {(done.stdout + done.stderr)[-500:]}")
        end = np.load(folder / "end.npz", allow_pickle=False)
        seconds, position, velocity = float(end["seconds"]), end["position"] * MICRO, end["velocity"]
    return Timed(seconds, steps, resolution.time_step, np.arange(len(position)), position, velocity)
