"""Cost and memory per particle over the number of particles, at constant density, in the reference.

The layer of `neighbors.py`: drag and contacts of pairs, one listing of neighbors every ten steps. Memory is
the largest resident set of a process of its own that makes the steps, over what it had before:
`python -m benchmarks.scaling N` is one.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from benchmarks.neighbors import STEPS, D, lattice, seconds, steps_of
from reference.neighbors import neighbor_pairs

SIZES, BASE = (100, 1_000, 10_000, 100_000, 1_000_000), 1_000
GOAL = 1.5  # largest cost per particle-step over the smallest, from BASE on


def one_size(count: int) -> dict[str, float]:
    """Particles, seconds of a particle-step, and bytes that this process needed at most for the steps."""
    prepared(SIZES[0])  # compiles
    before = resident("VmRSS")
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", "ascii")  # the largest set from now on
    n, task = prepared(count)
    step = seconds(task) / STEPS / n
    return {"N": n, "s": step, "bytes": resident("VmHWM") - before}


def prepared(count: int) -> tuple[int, Callable[[], None]]:
    """Particles, and STEPS steps of them, which have been made once."""
    position, periods = lattice(count, 2)
    task = steps_of(position, periods, len(neighbor_pairs(position, 1.5 * D, periods)))
    task()
    return len(position), task


def resident(name: str) -> float:
    """Resident set of this process, now (VmRSS) or the largest (VmHWM), bytes; NaN where Linux is not."""
    try:
        lines = Path("/proc/self/status").read_text("ascii").splitlines()
    except OSError:
        return math.nan
    return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith(name))


def measure(quick: bool) -> dict[str, Any]:
    """`scaling`: seconds of a particle-step and bytes, for each N; memory per particle at the largest."""
    runs = []
    for count in SIZES[:-1] if quick else SIZES:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.scaling", str(count)], capture_output=True, text=True,
            cwd=Path(__file__).parents[1], check=True, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        runs.append(json.loads(done.stdout))
        print(runs[-1], flush=True)
    large = [one["s"] for one in runs if one["N"] >= BASE]
    return {
        "scaling": {
            "runs": runs, "spread": max(large) / min(large),
            "bytes_per_particle": runs[-1]["bytes"] / runs[-1]["N"],
        }
    }  # fmt: skip


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    found = results["scaling"]
    base = min(found["runs"], key=lambda one: abs(one["N"] - BASE))
    text = [
        "A layer one particle deep, equally dense, drag and contacts of pairs, one core (`neighbors.py`). "
        "From "
        f"N = {BASE} on the cost of a particle-step varies by a factor of {found['spread']:.2f} (goal: "
        f"{GOAL:g} at most). Memory: {found['bytes_per_particle']:.0f} bytes per particle, list of "
        "neighbors and "
        "a contact ledger of this test, which is long enough for every particle and step, included.",
        "",
        f"| N | ns per particle-step | over that at N = {base['N']} |",
        "|---:|---:|---:|",
    ]
    return text + [
        f"| {one['N']} | {1e9 * one['s']:.1f} | {one['s'] / base['s']:.2f} |" for one in found["runs"]
    ]


if __name__ == "__main__":
    print(json.dumps(one_size(int(sys.argv[1]))))
