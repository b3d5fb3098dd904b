"""Bad input: how many spoilt files were read, and what became of them.

`python -m benchmarks.reliability_inputs [--full]` prints the findings.  The quick part draws a few hundred
inputs of each kind from a seed; --full lets atheris look for new paths through the code with more than 1e5
(half an hour), and draws as many from a seed where it is not installed.
"""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.reliability_finding import Finding

COUNTS = {
    "case": 6_000, "table": 18_000, "parquet": 5_000, "dump": 22_000, "series": 8_000, "text": 25_000,
    "deck": 15_000, "folder": 1_500, "store": 2_000, "variables": 200,
}  # fmt: skip
ALONE = "variables"  # goes through LAMMPS, which no fuzzer sees into
QUICK = 40  # times fewer
ALL = 100_000  # inputs that the full run has to try
WHAT = {
    "case": "case files: read, saved and read again, and set up",
    "table": "trajectories in CSV, judged",
    "parquet": "trajectories in Parquet, judged",
    "dump": "trajectories in dumps of LAMMPS, judged",
    "series": "trajectories in series of VTU files, judged",
    "text": "quantities with units",
    "deck": "decks and the flags and variables given to them",
    "folder": "run folders and checkpoints that are gone on from or read, also with their digests made right",
    "store": "files of optimisations that are gone on with",
    "variables": "variables of the decks that ship, run by lmp and by cmpcheck deck, a process each",
}


def findings(full: bool = False) -> Iterator[Finding]:
    """One for each kind of input, as it is done, and how many there were in all."""
    total = 0
    for target, count in COUNTS.items():
        found = _run(target, count if full else count // QUICK, full)
        total += sum(found["counts"].values())
        yield _finding(target, found)
    asked = ALL if full else ALL // QUICK
    yield Finding(
        "bad input: in all", "All of these, in one pass.", f"{total:,} inputs; {asked:,} are asked for",
        total >= asked, {"inputs": f"{total:,}"},
    )  # fmt: skip


def _run(target: str, count: int, full: bool) -> dict[str, Any]:
    """Counts and findings, of a process of its own: a crash would be a finding too."""
    guided = full and target != ALONE and importlib.util.find_spec("atheris") is not None
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        file = Path(folder) / "found.json"
        module = "deck_variables" if target == ALONE else "guided" if guided else "plain"
        words = [*([] if target == ALONE else [target]), str(count), *([] if guided else ["0"]), str(file)]
        done = subprocess.run(
            [sys.executable, "-m", f"benchmarks.fuzz.{module}", *words],
            capture_output=True,
            text=True,
        )
        found: dict[str, Any] = {"counts": {}, "findings": []}
        if file.exists():
            found = json.loads(file.read_text("utf-8"))
        corpus = len(list(Path(folder).glob("corpus-*/*")))
    if sum(found["counts"].values()) < count:
        found["findings"].append({"what": f"the process ended ({done.returncode}): {done.stderr[-300:]}"})
    return found | {"corpus": corpus, "guided": guided, "seconds": time.perf_counter() - begin}


def _finding(target: str, found: dict[str, Any]) -> Finding:
    counts, bad = found["counts"], found["findings"]
    total = sum(counts.values())
    how = f"atheris, which kept {found['corpus']} of them" if found["guided"] else "drawn from a seed"
    said = "; ".join(dict.fromkeys(entry["what"][:200] for entry in bad[:5]))
    return Finding(
        f"bad input: {target}",
        f"{WHAT[target]}; {how}",
        said or "each was taken, or refused in one line; no traceback, no hang, no wrong agreement",
        not bad and total > 0,
        {"inputs": f"{total:,}", "taken": f"{counts.get('taken', 0):,}",
         "refused": f"{counts.get('refused', 0):,}", "time": f"{found['seconds']:.0f} s"},
    )  # fmt: skip


def main() -> None:
    for finding in findings(full="--full" in sys.argv[1:]):
        print(finding.line(), flush=True)


if __name__ == "__main__":
    main()
