"""The fast stepper with many particles: cost over their number, equally dense, in one thread and in more.

The layer of `polish_pair` at larger N, with pairs, drag, surface, pad and removal. Each measurement is a
process of its own: of all N the same steps, in calls of the kernel as long as those of a run if there are as
many, after as many that warm up and do not count. The plain stepper makes the same steps, in one thread, up
to 1e5 particles. `python -m benchmarks.crowd STEPPER N` is one measurement.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

from benchmarks.scaling import BASE, GOAL, resident
from cmpcheck.components.steppers import crowded
from reference.fast.stepper import advance_fast
from reference.fast.swarm import MANY
from reference.fast.threads import most_threads, use_threads
from reference.ledger import empty_ledger
from reference.process import build_setup
from reference.schemes import Numerics
from reference.simulation import LEAST_STEPS, PARTICLE_STEPS, ledger_room
from reference.state import Setup
from reference.timestep import DONE, LEDGER_FULL, P, new_progress
from reference.timestep import advance as advance_plain

SIZES = (1_000, 10_000, 100_000, 1_000_000)
STEPS = 512  # measured, after as many that are not: particles meet more often as time goes on
REPEATS, MOST_REPEATED = 3, 100_000  # measurements of the fast stepper, and particles; of more there is one
MOST_PLAIN = 100_000  # particles


def one_size(stepper: str, count: int) -> dict[str, Any]:
    """Seconds of a particle-step, bytes that the steps needed at most, and a digest of where they led to."""
    advance = {"fast": advance_fast, "plain": advance_plain}[stepper]
    if stepper == "fast":
        use_threads(most_threads())  # all, also where fewer would be faster
    march(advance, build_setup(crowded(count if count < MANY else MANY, {})), 1, 1)  # compiles
    before = resident("VmRSS")
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", "ascii")  # the largest set from now on
    setup = build_setup(crowded(count, {}))
    calls = STEPS // min(STEPS, max(LEAST_STEPS, PARTICLE_STEPS // count))
    times, contacts = march(advance, setup, 2 * calls, STEPS // calls)
    state = setup.state
    digest = hashlib.sha256(state.position.tobytes() + state.velocity.tobytes() + state.heights.tobytes())
    return {
        "stepper": stepper, "N": count, "s": sum(times[calls:]) / calls, "bytes": resident("VmHWM") - before,
        "contacts": contacts, "digest": digest.hexdigest(),
    }  # fmt: skip


def march(advance: Any, setup: Setup, calls: int, steps: int) -> tuple[list[float], float]:
    """Seconds of a particle-step in each of the calls, and contacts in one; moves the setup's state."""
    state, count = setup.state, len(setup.state.mass)
    numerics = Numerics(setup.time_step, False, 1e-6, 8, False, False, setup.case.numerics.ledger_speed)
    scalars, rows, times = new_progress(), empty_ledger(ledger_room(count)), []
    scalars[P.step], scalars[P.pad_height] = setup.time_step, state.pad_height
    for call in range(calls):
        begin, end = perf_counter(), (call + 1) * steps
        while scalars[P.steps] < end:
            status = advance(
                setup.model, numerics, scalars, end * setup.time_step, int(end - scalars[P.steps]),
                state.particles, state.heights, rows,
            )  # fmt: skip
            if status == LEDGER_FULL and scalars[P.rows] == 0:
                rows = empty_ledger(2 * len(rows))
            elif status not in (DONE, LEDGER_FULL):
                raise RuntimeError(f"status {status} at step {scalars[P.steps]:.0f}")
            scalars[P.rows] = 0
        times.append((perf_counter() - begin) / steps / count)
    return times, scalars[P.contacts] / scalars[P.steps] / count


def measure(quick: bool) -> dict[str, Any]:
    """`crowd`: for each N and number of threads seconds of a particle-step; whether all ended the same."""
    sizes = SIZES[:-2] if quick else SIZES
    asked: dict[tuple[int, int], list[dict[str, Any]]]
    asked = {(threads, count): [] for threads in sorted({1, most_threads()}) for count in sizes}
    for turn in range(REPEATS):
        for (threads, count), made in asked.items():
            if turn == 0 or count <= MOST_REPEATED:
                made.append(run("fast", count, threads))
    runs = [middle(made) for made in asked.values()]
    plain = [run("plain", count, 1) for count in sizes if count <= MOST_PLAIN]
    alone = [one["s"] for one in runs if one["threads"] == 1 and one["N"] >= BASE]
    ends = {(one["N"], one["digest"]) for one in runs}
    several = most_threads() > 1
    return {
        "crowd": {
            "runs": runs, "plain": plain, "spread": max(alone) / min(alone),
            "same_to_the_bit": len(ends) == len(runs) / 2 if several else None,
            "bytes_per_particle": runs[-1]["bytes"] / runs[-1]["N"],
        }
    }  # fmt: skip


def middle(made: list[dict[str, Any]]) -> dict[str, Any]:
    """Measurements of the same thing as one: the median of the time, the largest memory, and all digests."""
    return made[0] | {
        "s": median(one["s"] for one in made), "bytes": max(one["bytes"] for one in made),
        "digest": "/".join(sorted({one["digest"] for one in made})),
    }  # fmt: skip


def run(stepper: str, count: int, threads: int) -> dict[str, Any]:
    """`one_size` in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.crowd", stepper, str(count)], capture_output=True, text=True,
        cwd=Path(__file__).parents[1], check=True, stdin=subprocess.DEVNULL,
        env=os.environ | {"NUMBA_NUM_THREADS": str(threads)},
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout) | {"threads": threads}
    print(found, flush=True)
    return found


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    found = results["crowd"]
    by_size: dict[int, dict[int, float]] = {}
    for one in found["runs"]:
        by_size.setdefault(one["N"], {})[one["threads"]] = one["s"]
    threads = sorted({one["threads"] for one in found["runs"]})
    same = {True: "All numbers of threads led to the same bits.", None: "There was one core only.",
            False: "**Numbers of threads led to different bits.**"}[found["same_to_the_bit"]]  # fmt: skip
    plain = {one["N"]: one["s"] for one in found["plain"]}
    base = by_size[min(by_size, key=lambda n: abs(n - BASE))][1]
    text = [
        "`polish_pair` with more particles at the same density: pairs, drag, surface, pad and removal; the "
        f"fast stepper, below N = {MANY} its loop for few, with what each call of it takes to begin; {STEPS} "
        f"steps after as many, medians of {REPEATS} measurements in turns, above N = {MOST_REPEATED} one. "
        f"In one thread their cost varies by a factor of {found['spread']:.2f} from N = {BASE} on (goal: "
        f"{GOAL:g} at most). {same} The plain stepper, in one thread, was asked up to "
        f"N = {MOST_PLAIN}; how many times as fast the fast one is, is in one thread too. "
        f"Memory: {found['bytes_per_particle']:.0f} bytes per particle, surface and ledger included.",
        "",
        "| N | " + " | ".join(f"ns per particle-step, {k} thread{'s' * (k > 1)}" for k in threads)
        + f" | over that at N = {BASE} | threads: times as fast | plain stepper, ns | fast: times as fast |",
        "|---:|" + "---:|" * (len(threads) + 4),
    ]  # fmt: skip
    for n, cost in sorted(by_size.items()):
        columns = " | ".join(f"{1e9 * cost[k]:.1f}" for k in threads)
        beside = f"{1e9 * plain[n]:.1f} | {plain[n] / cost[1]:.1f}" if n in plain else "|"
        text.append(
            f"| {n} | {columns} | {cost[1] / base:.2f} | {cost[1] / cost[threads[-1]]:.2f} | {beside} |"
        )
    return text


if __name__ == "__main__":
    print(json.dumps(one_size(sys.argv[1], int(sys.argv[2]))))
