"""What does accelerating the removal do to flatness?  The bias that the case `table_1` states.

`python -m benchmarks.acceleration` runs `table_1` at several accelerations A with equal seeds, for some sets
of parameters, and writes the paired differences of the final flatness to `acceleration.md` here.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

import reference
from reference.case import Case, load_case
from reference.ensemble import run_samples

SAMPLES, ACCELERATIONS = 6, (100, 200, 400, 800)
SETS = {
    "paper's Fig. 5: 1 m/s, N = 73, 0.9 um, 0.1": (1.0, 73, 0.9e-6, 0.1),
    "0.03 D: 2 m/s, N = 73, 0.6 um, 0.16": (2.0, 73, 0.6e-6, 0.16),
    "0.03 D, faster: 4 m/s, N = 73, 0.6 um, 0.16": (4.0, 73, 0.6e-6, 0.16),
}
OUTPUT = Path(__file__).with_name("acceleration.md")


def accelerated(case: Case, factor: float) -> Case:
    """The same process, its T = 1 s divided by A and the removal of each impact multiplied by it."""
    assert case.removal is not None
    duration = case.case.duration * case.removal.acceleration / factor
    header = case.case.model_copy(update={"duration": duration})
    return case.model_copy(
        update={"case": header, "removal": case.removal.model_copy(update={"acceleration": float(factor)})}
    )


def final_flatness(case: Case) -> float:
    return float(reference.simulate(case).history["flatness"].iloc[-1])


def rows_of(name: str, values: tuple[float, ...]) -> list[str]:
    case, rows, least = load_case("table_1"), [], np.zeros(0)
    assert case.optimise is not None
    string = case.replaced({gene.key: v for gene, v in zip(case.optimise.gene, values, strict=True)})
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the kernel lets other threads run
        for factor in ACCELERATIONS:
            found = np.array(run_samples(accelerated(string, factor), range(SAMPLES), final_flatness, pool))
            least = least if len(least) else found
            difference = found - least
            error, bias_error = (x.std(ddof=1) / math.sqrt(SAMPLES) for x in (found, difference))
            bias = "" if factor == ACCELERATIONS[0] else f"{difference.mean():+.3f} ± {bias_error:.3f}"
            rows.append(f"| {name} | {factor} | {found.mean():.3f} ± {error:.3f} | {bias} |")
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    text = [
        "# Flatness at several accelerations",
        "",
        f"Π(T) of `table_1`, A T = 1 s, q = 2: mean and standard error of {SAMPLES} samples, and of the "
        f"differences to A = {ACCELERATIONS[0]}, sample by sample with equal seeds. Written by "
        "`python -m benchmarks.acceleration`.",
        "",
        "| parameters | A | Π(T) | difference |",
        "|---|---:|---:|---:|",
        *(row for name, values in SETS.items() for row in rows_of(name, values)),
        "",
    ]
    OUTPUT.write_text("\n".join(text), "utf-8")


if __name__ == "__main__":
    main()
