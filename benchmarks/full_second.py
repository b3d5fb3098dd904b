"""What the paper's example costs: a whole second of polishing, 1.1e8 steps of 73 particles on one core.

The fast stepper runs it, in parts. Between them the plain one, which takes a quarter of an hour or more,
makes 1 % of its steps from where the fast one is by then; the rest is extrapolated, and said to be.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.shear_reference import step_on
from benchmarks.steppers import FAST, PLAIN, case_of
from reference.case import Case, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup, State

FULL, ACCELERATED = "polish_full", "polish"
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the second: the middles of five equal parts of it
SAMPLE = 0.01  # of all steps
OUTPUTS = 20  # of each part


def fast_case(quick: bool) -> Case:
    """The whole second by the fast stepper; quick: the accelerated case, a hundredth of it."""
    case = case_of(ACCELERATED if quick else FULL, FAST)
    assert case is not None
    return case


def beginning(setup: Setup, share: float) -> Setup:
    """So much of a setup's time."""
    end = share * setup.end_time
    return replace(setup, end_time=end, output_times=np.linspace(0.0, end, OUTPUTS + 1))


def ended(run: Run, start: State) -> State:
    """The state at the end of a run, its time from 0."""
    assert run.surface is not None
    particles = start.particles._replace(
        position=run.positions[-1], velocity=run.velocities[-1], mass=run.masses[-1]
    )
    return State(0.0, *particles, run.surface.z, float(run.history["pad_height"].iloc[-1]))


def measure(quick: bool) -> dict[str, Any]:
    """`polish_full`: wall time of the second by the fast stepper, and what the plain one would take."""
    full, setup = build_setup(load_case(FULL)), build_setup(fast_case(quick))
    steps = round(full.end_time / full.time_step)
    most = round(SAMPLE * (0.1 if quick else 1.0) * steps / len(PLACES))
    simulate_setup(beginning(setup, 1e-3))  # compiles
    step_on(full, full.time_step, 1)
    curve, windows, made, wall, state = [(0.0, 0.0)], [], 0, 0.0, setup.state
    for before, place in zip((0.0, *PLACES), (*PLACES, 1.0), strict=True):
        part = beginning(replace(setup, state=state), place - before)
        begin = perf_counter()
        run = simulate_setup(part)
        wall += perf_counter() - begin
        curve.append((place, wall))
        made, state = made + int(run.provenance["steps"]), ended(run, state)
        if place in PLACES:
            taken, count, _ = step_on(replace(full, state=state), full.time_step, most)
            windows.append(
                {"place": place, "pad_height_m": state.pad_height, "step_s": taken / count, "steps": count}
            )
            print(windows[-1], f"the fast one has taken {wall:.1f} s", flush=True)
    step = float(np.mean([one["step_s"] for one in windows]))  # the places stand for equal parts
    return {
        "polish_full": {
            "wall_s": wall * steps / made, "cores": 1, "gamma": full.case.numerics.gamma, "acceleration": 1,
            "stepper": FAST, "how": "extrapolated" if quick else "measured", "steps": steps,
            "particles": len(full.state.mass),
            "steppers": {
                PLAIN: {
                    "wall_s": step * steps, "how": "extrapolated", "step_s": step, "windows": windows,
                    "sampled": sum(one["steps"] for one in windows) / steps,
                },
                FAST: {
                    "wall_s": wall * steps / made, "how": "extrapolated" if quick else "measured",
                    "step_s": wall / made, "sampled": made / steps,
                    "curve": [(share, taken * steps / made) for share, taken in curve],
                },
            },
        }
    }  # fmt: skip


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    found = results["polish_full"]
    text = [
        f"`{FULL}`: T = 1 s at A = 1, γ = {found['gamma']:g}, N = {found['particles']}, "
        f"{found['steps']:.3g} steps on one core.",
        "",
        "| stepper | wall time (s) | how | µs/step | share of the steps that was made |",
        "|---|---:|---|---:|---:|",
    ]
    for name, one in found["steppers"].items():
        text.append(
            f"| {name} | {one['wall_s']:.0f} | {one['how']} | {1e6 * one['step_s']:.3g} | "
            f"{one['sampled']:.2%} |"
        )
    text += ["", "The plain stepper's sample, from where the fast one was:"]
    text += ["", "| t/T | pad height (µm) | µs/step |", "|---:|---:|---:|"]
    for one in found["steppers"][PLAIN]["windows"]:
        text.append(f"| {one['place']} | {1e6 * one['pad_height_m']:.2f} | {1e6 * one['step_s']:.2f} |")
    return text
