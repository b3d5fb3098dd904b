"""YADE as an engine for cmpcheck: pairs of spheres, and one sphere on a flat wall.

Each run is a process of its own, `yade -n -x cmpcheck_yade_script.py`, which gets a file of numbers and
leaves one: nothing of YADE is loaded here.  Lengths are um, times us, masses pg, as YADE's own tolerances
expect.
"""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from cmpcheck.engines.protocol import NotSupported, Resolution
from cmpcheck.results import EngineInfo
from cmpcheck.trajectories import trajectory_run
from reference.recording import Run
from reference.state import FLOW_NONE, Setup

SCRIPT = Path(__file__).with_name("cmpcheck_yade_script.py")
MICRO, PICOGRAM = 1e-6, 1e-15
INSTALL = "apt-get install yade"
TIMEOUT = 600.0  # s, of one run
SLIP_RATE = 20.0  # frequency of the tangential spring, over the contact duration: slip ends within t_c/10


class Yade:
    """Runs `yade` as a child process; contacts are a spring, a dashpot and a slider."""

    name = "yade"
    surface_forms = ("native",)  # not those of the fix for LAMMPS

    def info(self) -> EngineInfo:
        """Whether the command `yade` is there, and its version."""
        version = _version()
        reason = "" if version else f"no command yade; install with: {INSTALL}"
        return EngineInfo(self.name, version, bool(version), reason)

    def run(self, setup: Setup, resolution: Resolution) -> Run:
        """Simulate one pair, or one sphere and a flat wall, in copies that stay out of each other's way.

        Raises NotSupported for other setups, RuntimeError in one line when YADE fails.
        """
        _refuse(setup)
        model, state, times = setup.model, setup.state, setup.output_times
        stride = max(1, math.ceil(float(times[1]) / resolution.time_step - 1e-6))
        wall = model.has_surface
        m_eff = state.mass[0] if wall else state.mass[:2].prod() / state.mass[:2].sum()
        stiffness, damping = spring(model.restitution, resolution.contact_duration / MICRO, m_eff / PICOGRAM)
        slip = m_eff / PICOGRAM * SLIP_RATE * MICRO / resolution.contact_duration
        job = {
            "positions": (_together(setup) / MICRO).tolist(),
            "velocities": state.velocity.tolist(),
            "masses": (state.mass / PICOGRAM).tolist(),
            "radii": (state.diameter / 2 / MICRO).tolist(),
            "wall": bool(wall),
            "kn": stiffness,
            "cn": damping,
            "ks": slip * SLIP_RATE * MICRO / resolution.contact_duration,
            "cs": 2.0 * slip,
            "friction": 0.0 if wall else model.dynamic_friction,
            "time_step": float(times[1]) / stride / MICRO,
            "stride": stride,
            "outputs": len(times),
        }
        samples = _call(job)
        run = trajectory_run(setup, self.name, times, samples[:, :, :3] * MICRO, samples[:, :, 3:])
        run.provenance["steps"] = stride * (len(times) - 1)
        run.provenance["yade"] = _version()
        return run


def spring(restitution: float, duration: float, mass: float) -> tuple[float, float]:
    """Stiffness and damping of a contact that lasts `duration` and never pulls.

    It ends when the force is 0, before the overlap is: the damping ratio cos(phi) returns e where
    phi cot(phi) = -ln(e)/2, and the contact lasts 2 phi/(w sin(phi)), w^2 = k/m.
    """
    if restitution == 1.0:
        phi = math.pi / 2
    else:
        loss = -math.log(restitution) / 2
        phi = brentq(lambda p: p / math.tan(p) - loss, 1e-6, math.pi / 2)
    frequency = 2.0 * phi / (duration * math.sin(phi))
    return mass * frequency**2, 2.0 * mass * frequency * math.cos(phi)


def _refuse(setup: Setup) -> None:
    model, particles = setup.model, len(setup.state.mass) // setup.copies
    if model.flow != FLOW_NONE or model.has_pad or setup.state.heights.any():
        raise NotSupported("without flow, pad and asperities: two spheres, or one on a flat wall")
    if model.mass_pickup:
        raise NotSupported("its spheres pick nothing up")
    if particles != (1 if model.has_surface else 2):
        raise NotSupported(f"{particles} particles: two spheres, or one on a flat wall")
    if model.static_friction != model.dynamic_friction:
        raise NotSupported("its slider has one coefficient of friction")
    if not model.restitution > math.exp(-2.0):
        raise NotSupported("a contact that never pulls has a restitution above exp(-2)")


def _together(setup: Setup) -> np.ndarray:
    """Positions with no pair cut by a periodic boundary: YADE's box is not periodic."""
    position = setup.state.position.reshape(setup.copies, -1, 3).copy()
    periods = (setup.model.length_x, setup.model.length_y, setup.model.length_z)
    for axis, period in enumerate(periods):
        if period > 0.0:
            first = position[:, :1, axis]
            position[:, :, axis] -= period * np.round((position[:, :, axis] - first) / period)
    return position.reshape(-1, 3)


@cache
def _version() -> str:
    if shutil.which("yade") is None:
        return ""
    done = subprocess.run(["yade", "--version"], capture_output=True, text=True, check=False, timeout=60)
    match = re.search(r"(\d{4}\.\d+\w*)", done.stdout + done.stderr)
    return match.group(1) if match else ""


def _call(job: dict) -> np.ndarray:
    """The samples (T, N, 6) that the script leaves."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        (Path(folder) / "job.json").write_text(json.dumps(job), "utf-8")
        command = ["yade", "-n", "-x", str(SCRIPT), folder]
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
                timeout=TIMEOUT,
            )
        except (OSError, subprocess.TimeoutExpired) as problem:
            raise RuntimeError(f"yade: {problem}") from None
        result = Path(folder) / "samples.npy"
        if done.returncode != 0 or not result.is_file():
            last = " | ".join((done.stderr or done.stdout).strip().splitlines()[-2:])
            raise RuntimeError(f"yade ended with code {done.returncode}: {last}")
        samples = np.load(result, allow_pickle=False)
    if samples.shape != (job["outputs"], len(job["masses"]), 6) or not np.isfinite(samples).all():
        raise RuntimeError(f"yade left {samples.shape} numbers, or some that are not finite")
    return samples
