"""What LAMMPS's trajectories are made of: positions and velocities of one and the same instant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cmpcheck.components.row import EPS, row
from cmpcheck.engines.lammps import LammpsEngine
from cmpcheck.engines.protocol import Resolution
from cmpcheck.results import Comparison
from cmpcheck.study import contact_settings
from reference.case import load_case
from reference.process import build_setup

CASE_OF = "drag_relaxation"
STEPS = 16


def checks(in_process: bool = False) -> list[Comparison]:
    """The sampled velocities of a sphere in a flow against its sampled positions; none without LAMMPS.

    Velocity Verlet moves by r(n+1) - r(n) = dt v(n+1/2), and v(n) lies midway between v(n-1/2) and v(n+1/2):
    both differ from it by dt/2 times the acceleration of step n.  So v(n) = (r(n+1) - r(n-1))/(2 dt) to
    rounding, whatever the force is.  A velocity of half a step before would be off by dt/2 times the
    acceleration, which no comparison in the limit of small steps can see.
    Rounding: LAMMPS rounds two positions on the way and the trajectory two in its unit, each by eps/2 of the
    largest, and their difference is divided by 2 dt; velocities and times round by a few eps.
    """
    engine = LammpsEngine(in_process=in_process)
    if not engine.info().available:
        return []
    case = load_case(CASE_OF)
    duration, steps_per_contact = contact_settings(case, engine.name)
    step = duration / steps_per_contact
    times = step * np.arange(STEPS + 1)
    setup = replace(build_setup(case), output_times=times, end_time=float(times[-1]))
    run = engine.run(setup, Resolution(step, duration))
    expected = (run.positions[2:] - run.positions[:-2]) / (2.0 * step)
    found = run.velocities[1:-1]
    k = np.unravel_index(int(np.argmax(np.abs(found - expected))), found.shape)
    rounding = EPS * (float(np.abs(run.positions).max()) / step + 8.0 * float(np.abs(found).max()))
    return [
        replace(
            row(
                "sampled_velocity", "", float(found[k]), float(expected[k]), rounding,
                "rounding of positions, eps L/dt, and 8 eps of velocities", "m/s",
                variant="sampled at each step",
            ),
            engine=engine.name,
        )
    ]  # fmt: skip
