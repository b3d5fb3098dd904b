"""Samples of the polishing example per minute on one core and on two, and what the paper's Table 1 costs.

Each core is a process that lives on, as in `cmpcheck optimise`; its start and its compiling are not timed.
What a table costs at other accelerations and on other numbers of cores is arithmetic from these times, and
shown as such.
"""

from __future__ import annotations

import math
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from statistics import median
from time import perf_counter
from typing import Any

from benchmarks.acceleration import accelerated, final_flatness
from benchmarks.steppers import case_of, steppers
from reference.case import Case, load_case
from reference.ensemble import sample_case

CORES, CLUSTERS, ACCELERATIONS = (1, 2), (1, 2, 32, 1000), (1, 100, 400)
PER_CORE, REPEATS = 2, 2  # samples of each core in one measurement
HOURS = 3600.0


def short(case: Case, share: float) -> Case:
    """The beginning of a case."""
    return case.replaced({"case.duration": case.case.duration * share})


def sample(task: tuple[Case, int]) -> float:
    """Flatness at the end of one sample."""
    case, k = task
    return final_flatness(sample_case(case, k))


def per_minute(case: Case, cores: int, samples: int) -> float:
    """Samples per minute on so many processes."""
    with ProcessPoolExecutor(cores, multiprocessing.get_context("spawn")) as pool:
        warm = short(case, 1e-3)
        list(pool.map(sample, [(warm, k) for k in range(8 * cores)], chunksize=4))
        begin = perf_counter()
        list(pool.map(sample, [(case, k) for k in range(samples)]))
        return 60.0 * samples / (perf_counter() - begin)


def table_sample(factor: float, stepper: str, repeats: int) -> float:
    """Seconds of a sample of `table_1` at an acceleration, one core."""
    case = case_of("table_1", stepper)
    assert case is not None
    case, times = accelerated(case, factor), []
    final_flatness(short(case, 1e-3))
    for k in range(repeats):
        begin = perf_counter()
        sample((case, k))
        times.append(perf_counter() - begin)
    return median(times)


def table_size() -> tuple[int, int, int]:
    """Strings in the first generation and in each later one, and samples of each at least.

    Parents keep the cost that they have, so only the others are new.
    """
    optimise = load_case("table_1").optimise
    assert optimise is not None
    return optimise.population, optimise.population - optimise.parents, optimise.minimum_samples


def table_hours(seconds: float, cores: int, efficiency: float) -> float:
    """Hours of the whole table: generation after generation, its samples side by side on the cores.

    In a generation ceil(strings x samples/cores) samples come one after another; `efficiency` is that of two
    cores.  More samples than the least, where the mean has not settled, come on top.
    """
    first, later, samples = table_size()
    optimise = load_case("table_1").optimise
    assert optimise is not None
    rounds = math.ceil(first * samples / cores) + (optimise.generations - 1) * math.ceil(
        later * samples / cores
    )
    return rounds * seconds / (1.0 if cores == 1 else efficiency) / HOURS


def measure(quick: bool) -> dict[str, Any]:
    """`samples_per_minute` {cores: value} with the fastest stepper here, and `table_1`."""
    stepper = steppers()[-1]
    case = case_of("polish", stepper)
    assert case is not None
    share = 0.02 if quick else 1.0  # of a sample
    rates = {
        cores: median(per_minute(short(case, share), cores, PER_CORE * cores) * share for _ in range(REPEATS))
        for cores in CORES
    }
    efficiency = rates[2] / (2.0 * rates[1])
    measured = {400: table_sample(400 / share, stepper, 1 if quick else 3) / share}
    measured[100] = 4.0 * measured[400] if quick else table_sample(100, stepper, 3)
    seconds = {factor: measured.get(factor, measured[100] * 100 / factor) for factor in ACCELERATIONS}
    return {
        "samples_per_minute": {str(cores): rate for cores, rate in rates.items()},
        "table_1": {
            "stepper": stepper, "efficiency_of_two": efficiency,
            "sample_s": {str(factor): seconds[factor] for factor in ACCELERATIONS},
            "measured": [] if quick else sorted(measured),
            "hours": {
                str(factor): {str(n): table_hours(seconds[factor], n, efficiency) for n in CLUSTERS}
                for factor in ACCELERATIONS
            },
        },
    }  # fmt: skip


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    table, (first, later, samples) = results["table_1"], table_size()
    rates = results["samples_per_minute"]
    text = [
        f"`polish`, A = 100, the {table['stepper']} stepper: "
        + ", ".join(
            f"{rate:.1f} samples per minute on {n} core{'s' * (n != '1')}" for n, rate in rates.items()
        )
        + f"; two cores do {100 * table['efficiency_of_two']:.0f} % of twice the work of one.",
        "",
        f"`table_1` has {first} strings in its first generation and {later} new ones in each later one, "
        "each of "
        f"{samples} samples or more. Seconds of a sample on one core "
        + (
            f"are measured at A = {', '.join(map(str, table['measured']))}, medians of 3, and follow from "
            "A = 100 elsewhere"
            if table["measured"] else "follow from a short piece of one"
        )
        + "; the hours are arithmetic: in each generation ceil(strings × samples/cores) samples, one after "
        "another, over the efficiency of two cores (1 on one). A cluster has not been tried.",
        "",
        "| A | a sample (s) |" + "".join(f" {n} core{'s' * (n > 1)} (h) |" for n in CLUSTERS),
        "|---:|---:|" + "---:|" * len(CLUSTERS),
    ]  # fmt: skip
    for factor in map(str, ACCELERATIONS):
        hours = "".join(f" {table['hours'][factor][str(n)]:.3g} |" for n in CLUSTERS)
        text.append(f"| {factor} | {table['sample_s'][factor]:.3g} |{hours}")
    return text
