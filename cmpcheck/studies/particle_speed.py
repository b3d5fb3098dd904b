"""Whether particles move faster as the surface flattens: their mean velocity, and the fluid's around them.

Paper: Section 4 says that they do, since nothing is left to slow them down.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cmpcheck.display import uncertain
from cmpcheck.results import Chart, Column, Curve, Estimate, StudyResult, Table
from cmpcheck.statistics import mean_band
from cmpcheck.studies.sampling import clear, estimate, interval_text, samples_of
from reference import simulate
from reference.case import Case, load_case
from reference.drag import fluid_velocity
from reference.ensemble import run_samples
from reference.process import build_setup

CASE = "polish"  # 10 s a sample
SAMPLES = {"quick": 2, "full": 8}
PARTS = (0.0, 0.25, 0.5, 0.75, 1.0)  # t/T
SAME = 0.02  # particles and fluid closer than this move together


class Course(NamedTuple):
    """One sample over time, (T,) each; speeds in parts of V_pad."""

    particles: np.ndarray  # mean v_x
    fluid: np.ndarray  # mean u_x at the particles' heights
    flatness: np.ndarray


def study(profile: str, runs: Path) -> StudyResult:
    """The mean velocity of the particles over time, beside that of the fluid and the flatness."""
    (case,) = load_case(CASE).variants()
    n = SAMPLES[profile]
    courses = run_samples(case, range(n), course)
    particles, fluid, flat = (np.array(curves) for curves in zip(*courses, strict=True))
    part = np.linspace(0.0, 1.0, particles.shape[1])
    rows: list[tuple[float | Estimate, ...]] = []
    for t in PARTS:
        k = round(t * (len(part) - 1))
        cells = (particles[:, k], fluid[:, k], particles[:, k] / fluid[:, k], flat[:, k])
        rows.append((t, float(n), *(estimate(values) for values in cells)))
    band = mean_band(particles)
    charts = [
        Curve("particles, 95 % band", tuple(part), tuple(band.mean), tuple(band.lower), tuple(band.upper)),
        Curve("fluid around them", tuple(part), tuple(fluid.mean(axis=0))),
        Curve("Π", tuple(part), tuple(flat.mean(axis=0))),
    ]
    return StudyResult(
        name="particle_speed",
        title="How fast particles move as the surface flattens",
        varied="Nothing but time: mean v_x of all particles, and mean u = V_pad z/H at their centres, in "
        "parts of V_pad.",
        samples=samples_of(case, n),
        tables=(
            Table(
                "Mean velocities over the course of polishing, ± standard error",
                (Column("t/T"), Column("seeds"), Column("particles, v_x/V_pad"), Column("fluid, u/V_pad"),
                 Column("v_x/u"), Column("Π")),
                tuple(rows),
            ),
        ),
        sentence=_sentence(particles, fluid),
        charts=(
            Chart(
                "Mean velocity of the particles and of the fluid at their heights, and "
                "flatness", Column("t/T"),
                Column("in parts of V_pad, and Π"), tuple(charts),
            ),
        ),
    )  # fmt: skip


def course(case: Case) -> Course:
    """Mean velocities and flatness of one run at its output times."""
    run, model = simulate(case), build_setup(case).model
    fluid = [
        np.mean([fluid_velocity(model, height, z)[0] for z in places])
        for height, places in zip(run.history.pad_height, run.positions[:, :, 2], strict=True)
    ]
    speed = run.history.mean_velocity_x.to_numpy() / model.wall_speed
    return Course(speed, np.array(fluid) / model.wall_speed, run.history.flatness.to_numpy())


def _sentence(particles: np.ndarray, fluid: np.ndarray) -> str:
    n, last = len(particles), particles.shape[1] - 1
    changes = {t: estimate(particles[:, round(t * last)] - particles[:, 0]) for t in PARTS[1:]}
    mean, ratio = particles.mean(axis=0), particles / fluid
    told = ", ".join(f"{interval_text(change, n)} at t/T = {t:g}" for t, change in changes.items())
    course = (
        f"Mean v_x/V_pad is {uncertain(*estimate(particles[:, 0]))} at first, and changes by {told} (95 % "
        f"intervals, n = {n}); its mean is highest, {mean.max():.3f}, at t/T = {mean.argmax() / last:.2g}"
    )
    lag = float(np.abs(1.0 - ratio.mean(axis=0)).max())
    gain = estimate(ratio[:, -1] - ratio[:, 0])
    why = (
        f"At all times they move with the fluid at their heights, within {lag:.1g} of it, so that mean v_x "
        "tells how high they ride under the pad and not what is in their way"
        if lag < SAME
        else f"They move slower or faster than the fluid at their heights by up to {lag:.2g} of it"
    )
    return f"{course}: {_verdict(changes, n)}. {why}; v_x/u changes by {uncertain(*gain)} from first to last."


def _verdict(changes: Mapping[float, Estimate], samples: int) -> str:
    """At which of the times, fixed beforehand, particles are faster or slower than at first."""
    told = {t: change.value for t, change in changes.items() if clear(change, samples, len(changes))}
    faster = ", ".join(f"{t:g}" for t, d in told.items() if d > 0)
    slower = ", ".join(f"{t:g}" for t, d in told.items() if d < 0)
    if faster and slower:
        return f"particles are faster at t/T = {faster}, as the paper says, and slower at {slower}"
    if faster:
        return f"particles are faster at t/T = {faster}, as the paper says"
    if slower:
        return f"particles are slower at t/T = {slower}, contrary to the paper"
    return "at none of these times a change is told from none; the paper says that particles become faster"
