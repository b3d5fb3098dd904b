"""What the paper's example costs: a whole second of polishing, 1.1e8 steps of 73 particles on one core.

A fast stepper runs it. The plain one, which takes a quarter of an hour, makes 1 % of its steps, in windows
under the pad at several heights, with the particles and the surface that the accelerated case has under a
pad there; the rest is extrapolated, and said to be.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.shear_reference import step_on
from benchmarks.steppers import FAST, PLAIN, case_of, steppers
from reference import simulate
from reference.case import Case, load_case
from reference.process import build_setup
from reference.state import Setup

FULL, ACCELERATED = "polish_full", "polish"
PLACES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the second: the middles of five parts of it
SAMPLE = 0.01  # of all steps
POINTS = 40  # of a curve


def windows(quick: bool) -> list[dict[str, float]]:
    """Seconds of a step of the plain stepper at each of the places, and the height of the pad there."""
    case = load_case(FULL)
    setup, faster = build_setup(case), accelerated(quick)
    total = setup.end_time / setup.time_step
    most, found, before = round(SAMPLE * (0.1 if quick else 1.0) * total / len(PLACES)), [], 0.0
    step_on(setup, setup.time_step, 1)  # compiles
    for place in PLACES:
        part = replace(faster, end_time=(place - before) * case.case.duration / faster.model.acceleration)
        _, _, state = step_on(part, faster.time_step)
        faster, before = replace(faster, state=state), place
        seconds, steps, _ = step_on(replace(setup, state=state), setup.time_step, most)
        found.append(
            {"place": place, "pad_height_m": state.pad_height, "step_s": seconds / steps, "steps": steps}
        )
    return found


def accelerated(quick: bool) -> Setup:
    """The setup of the accelerated case, quick: ten times as much so."""
    case = load_case(ACCELERATED)
    assert case.removal is not None
    if quick:
        values = {
            "removal.acceleration": 10 * case.removal.acceleration,
            "case.duration": case.case.duration / 10,
        }
        case = case.replaced(values)
    return build_setup(case)


def timed(case: Case) -> tuple[list[tuple[float, float]], int]:
    """How much was done after how many wall-clock seconds of a simulation, [(share, s)], and its steps."""
    curve, begin = [(0.0, 0.0)], perf_counter()
    run = simulate(case, progress=lambda share: curve.append((share, perf_counter() - begin)))
    return [*curve, (1.0, perf_counter() - begin)], int(run.provenance["steps"])


def measure(quick: bool) -> dict[str, Any]:
    """`polish_full`: wall time of the second by the fastest stepper, and what was measured for it."""
    case = load_case(FULL)
    setup, found = build_setup(case), windows(quick)
    steps = round(setup.end_time / setup.time_step)
    step = float(np.mean([one["step_s"] for one in found]))  # the places stand for equal parts
    entries: dict[str, Any] = {
        PLAIN: {
            "wall_s": step * steps, "how": "extrapolated", "step_s": step, "windows": found,
            "sampled": sum(one["steps"] for one in found) / steps,
        }
    }  # fmt: skip
    if FAST in steppers():
        entries[FAST] = fast(quick, steps)
    best = min(entries, key=lambda name: entries[name]["wall_s"])
    return {
        "polish_full": {
            "wall_s": entries[best]["wall_s"], "cores": 1, "gamma": case.numerics.gamma, "acceleration": 1,
            "stepper": best, "how": entries[best]["how"], "steps": steps, "particles": len(setup.state.mass),
            "steppers": entries,
        }
    }  # fmt: skip


def fast(quick: bool, steps: int) -> dict[str, Any]:
    """The whole second by the fast stepper; quick: the accelerated case, a hundredth of it, extrapolated."""
    case = case_of(ACCELERATED if quick else FULL, FAST)
    assert case is not None
    short = case.replaced({"case.duration": case.case.duration / 1000})
    timed(short)  # compiles
    curve, made = timed(case)
    seconds, thinned = curve[-1][1], curve[:: max(1, len(curve) // POINTS)] + curve[-1:]
    return {
        "curve": [(float(share), taken * steps / made) for share, taken in thinned],
        "wall_s": seconds * steps / made, "how": "extrapolated" if quick else "measured",
        "step_s": seconds / made, "sampled": made / steps,
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
    if FAST not in found["steppers"]:
        text += ["", "This version has no second stepper."]
    text += ["", "The plain stepper's sample:", "", "| t/T | pad height (µm) | µs/step |", "|---:|---:|---:|"]
    for one in found["steppers"][PLAIN]["windows"]:
        text.append(f"| {one['place']} | {1e6 * one['pad_height_m']:.2f} | {1e6 * one['step_s']:.2f} |")
    return text
