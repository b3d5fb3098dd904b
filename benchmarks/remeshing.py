"""What reading a lowered surface again costs LIGGGHTS: `python -m benchmarks.remeshing`, to remeshing.md.

Samples of `polish_pair` as the study `remeshing` runs them, on surfaces of more and more nodes; what comes
out of them is the business of that study.
"""

from __future__ import annotations

import os
import platform
from pathlib import Path
from statistics import median
from time import perf_counter

from cmpcheck.engines import make_engine
from cmpcheck.engines.liggghts_library import available, version
from cmpcheck.engines.protocol import Resolution
from cmpcheck.studies.remeshing import CONTACT, STEPS, small_case
from reference.ensemble import sample_case
from reference.process import build_setup

NODES = (10, 20, 40)
DURATION = "4 us"
SAMPLES = 3
OUTPUT = Path(__file__).with_name("remeshing.md")


def sample(nodes: int, k: int) -> tuple[int, float, float]:
    """One sample: readings, seconds of one, and their share of the run's wall time."""
    case = small_case("quick").replaced({"case": {"duration": DURATION}, "surface": {"nodes": nodes}})
    setup = build_setup(sample_case(case, k))
    begin = perf_counter()
    run = make_engine("liggghts").run(setup, Resolution(CONTACT / STEPS, CONTACT, "soft"))
    wall = perf_counter() - begin
    count, seconds = (run.provenance[f"surface_read_{what}"] for what in ("again", "seconds"))
    return count, seconds / max(count, 1), seconds / wall


def main() -> None:
    """Run all sizes and write the table."""
    found, reason = available()
    if not found:
        raise SystemExit(f"LIGGGHTS is missing: {reason}")
    sample(NODES[0], SAMPLES)  # compiles and loads
    lines = [
        "# Reading a lowered surface again",
        "",
        f"`python -m benchmarks.remeshing`: LIGGGHTS {version()}, Python {platform.python_version()}, "
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}. Samples 0 to "
        f"{SAMPLES - 1} of `polish_pair`, {DURATION}, soft contacts of {CONTACT * 1e9:g} ns; medians.",
        "",
        "| nodes | triangles | readings | one takes (ms) | per triangle (us) | share of the run |",
        "|---|---|---|---|---|---|",
    ]
    for nodes in NODES:
        counts, times, shares = zip(*(sample(nodes, k) for k in range(SAMPLES)), strict=True)
        triangles = 2 * nodes**2
        lines.append(
            f"| {nodes} x {nodes} | {triangles} | {median(counts):g} | {1e3 * median(times):.3g} "
            f"| {1e6 * median(times) / triangles:.3g} | {100 * median(shares):.0f} % |"
        )
        print(lines[-1], flush=True)
    OUTPUT.write_text("\n".join(lines) + "\n", "utf-8")


if __name__ == "__main__":
    main()
