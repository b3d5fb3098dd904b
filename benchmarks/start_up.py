"""How long the command takes to start, and a comparison the first time and the second.

`cmpcheck --help` is started several times in a row.  `cmpcheck compare` runs with a new folder for compiled
code, and then once more with the same one: the difference is what compiling costs.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

REPEATS = 7
HELP_GOAL, WARM_GOAL = 0.5, 2.0  # s; times as fast as cold
TIMEOUT = 1800.0  # s


def seconds(arguments: list[str], codes: tuple[int, ...] = (0,), **variables: str) -> float:
    """Wall-clock time of a command of cmpcheck, with these environment variables.

    Raises RuntimeError when it ends with another exit code.
    """
    begin = perf_counter()
    done = subprocess.run(
        [sys.executable, "-m", "cmpcheck", *arguments], capture_output=True, text=True, timeout=TIMEOUT,
        env=os.environ | variables, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    taken = perf_counter() - begin
    if done.returncode not in codes:
        raise RuntimeError(
            f"cmpcheck {' '.join(arguments)} ended with {done.returncode}: {done.stderr[-500:]}"
        )
    return taken


def measure(quick: bool) -> dict[str, Any]:
    """`start_up`: seconds of the help, and of a comparison cold and warm."""
    seconds(["--help"])  # from the disk into memory
    help_times = [seconds(["--help"]) for _ in range(REPEATS)]
    cases = ["wall_bounce"] if quick else []
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as name:
        folder = Path(name)
        cache = str(folder / "compiled")
        times = [
            seconds(["compare", *cases, "--out", str(folder / word)], (0, 1), NUMBA_CACHE_DIR=cache)
            for word in ("cold", "warm")
        ]
    return {
        "start_up": {
            "help_s": median(help_times), "help_times_s": help_times, "compare": cases or "all cases",
            "compare_cold_s": times[0], "compare_warm_s": times[1], "warm_over_cold": times[0] / times[1],
        }
    }  # fmt: skip


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    found = results["start_up"]
    what = " ".join(["cmpcheck compare", *(found["compare"] if isinstance(found["compare"], list) else [])])
    return [
        "| | seconds | goal |",
        "|---|---:|---|",
        f"| `cmpcheck --help`, median of {len(found['help_times_s'])} | {found['help_s']:.2f} "
        f"| {HELP_GOAL:g} s at most |",
        f"| `{what}`, nothing compiled yet | {found['compare_cold_s']:.0f} | |",
        f"| the same again | {found['compare_warm_s']:.0f} | {WARM_GOAL:g} times as fast at least: "
        f"{found['warm_over_cold']:.1f} |",
    ]
