"""`python -m benchmarks`: run the benchmarks, one after another, and write `results.json` and `RESULTS.md`.

Each piece is a module with one subject, `measure(quick)` and `lines(results)`. What a piece has found is
written as soon as it is there, with the circumstances under its name in `measured`; what was not run stays
as it was.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from types import ModuleType

from benchmarks import (
    crowd,
    fix_overhead,
    full_second,
    record,
    results_page,
    samples,
    scaling,
    side_by_side,
    start_up,
)

# Short ones first.
PIECES: dict[str, ModuleType] = {
    "scaling": scaling,
    "crowd": crowd,
    "fix_overhead": fix_overhead,
    "polish_full": full_second,
    "samples": samples,
    "start_up": start_up,
    "engines": side_by_side,
}
HERE = Path(__file__).parent
QUICK = HERE.parent / "build" / "benchmarks"


def run_piece(name: str, quick: bool, results: Path) -> str:
    """Run one piece and write what it has found; return why it failed, "" if it did not."""
    busy, begin = record.busy_cores(), perf_counter()
    print(f"{name}: {busy:.2f} cores are busy with other things", flush=True)
    try:
        found = PIECES[name].measure(quick)
    except Exception as error:  # of any piece: the others go on
        return f"{type(error).__name__}: {error}"
    problem = str(found.pop("problem", ""))  # of a part of it: what was measured beside it is kept
    known = record.load(results)
    command = f"python -m benchmarks --only {name}" + (" --quick" if quick else "")
    circumstances = record.conditions(command) | {
        "quick": quick, "busy_cores_before": busy, "load": os.getloadavg()[0],
        "took_s": perf_counter() - begin,
    }  # fmt: skip
    record.store(found | {"measured": known.get("measured", {}) | {name: circumstances}}, results)
    return problem


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--only", action="append", choices=PIECES, metavar="NAME", help=", ".join(PIECES))
    parser.add_argument(
        "--quick", action="store_true", help="small and short, to try it; to build/benchmarks"
    )
    parser.add_argument("--out", type=Path, help="folder of results.json and RESULTS.md")
    parser.add_argument("--page", action="store_true", help="measure nothing, write RESULTS.md anew")
    chosen = parser.parse_args(arguments)
    folder = chosen.out or (QUICK if chosen.quick else HERE)
    folder.mkdir(parents=True, exist_ok=True)
    results = folder / "results.json"
    problems = {}
    for name in () if chosen.page else chosen.only or PIECES:
        problem = run_piece(name, chosen.quick, results)
        if problem:
            problems[name] = problem
            print(f"{name} failed: {problem}", file=sys.stderr, flush=True)
        results_page.write(PIECES, problems, folder)
    results_page.write(PIECES, problems, folder)
    print(folder / results_page.PAGE)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
