"""How much faster is `cmpcheck optimise` on two processes than on one?

`python -m benchmarks.optimise` runs the first four generations of `polish_design` on one and on two processes
in turn, from the start of the processes to the last sample, and writes the ratio to `optimise.md` here.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from cmpcheck.optimise.evaluation import Evaluator
from cmpcheck.optimise.problem import Problem
from cmpcheck.optimise.search import MAIN, search
from cmpcheck.optimise.store import Store
from cmpcheck.optimise.workers import LocalProcesses
from reference.case import Case, load_case

REPEATS, GENERATIONS = 2, 4
OUTPUT = Path(__file__).with_name("optimise.md")


def short_case() -> Case:
    case = load_case("polish_design")
    assert case.optimise is not None
    return case.model_copy(update={"optimise": case.optimise.model_copy(update={"generations": GENERATIONS})})


def measure(jobs: int) -> tuple[float, float, list]:
    """Wall-clock time of the search, the share of it in which a process ran samples, and what was found."""
    problem = Problem(short_case())
    with tempfile.TemporaryDirectory() as folder:
        store = Store.create(Path(folder), problem.case, True)
        begin = time.perf_counter()
        with LocalProcesses(jobs) as workers:
            search(problem, Evaluator(problem, store, workers))
            taken = time.perf_counter() - begin
        asked = store.asked(MAIN)
        busy = store.totals()[1] / (jobs * taken)
        store.close()
    return taken, busy, asked


def main() -> None:
    times: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
    results = []
    for _ in range(REPEATS):
        for jobs, list_of_times in times.items():
            taken, busy, asked = measure(jobs)
            list_of_times.append((taken, busy))
            results.append(asked)
    assert all(asked == results[0] for asked in results), "the result depends on the number of processes"
    (one, busy_one), (two, busy_two) = min(times[1]), min(times[2])
    print(times)
    samples = sum(one.found.samples for one in results[0])
    text = [
        "# Two processes against one",
        "",
        f"The first {GENERATIONS} generations of `polish_design`, {samples} samples, the start of the "
        f"processes included; shortest of {REPEATS} runs each, in turn. Written by",
        "`python -m benchmarks.optimise`.",
        "",
        "| processes | speed | time in samples | speed with a core for each |",
        "|---:|---:|---:|---:|",
        f"| 1 | 1.00 | {100 * busy_one:.0f} % | 1.00 |",
        f"| 2 | {one / two:.2f} | {100 * busy_two:.0f} % | {2 * busy_two / busy_one:.2f} |",
        "",
        "Time in samples is the share of the time in which a process ran a sample; the rest is start,",
        "writing and waiting for the last samples of a generation. The last column follows from it; it holds",
        "where other programs take part of the cores. Both gave the same result to the bit.",
        "",
    ]
    OUTPUT.write_text("\n".join(text), "utf-8")
    print(OUTPUT.read_text("utf-8"))


if __name__ == "__main__":
    main()
