"""A process that runs checks in a guarded copy of the sources: one request a line in, one answer a line out.

Started by `children.py` as `python -m cmpcheck.sensitivity.worker FOLDER`, inside the copy.  Answers go to
the standard output as it was at the start; what LAMMPS or anything else prints goes to standard error.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any

from cmpcheck.sensitivity.checks import Baseline, bad_rows
from cmpcheck.sensitivity.mutants import Mutant

MUTANTS, BASELINE, TREE = "mutants.json", "baseline", "tree"


def write_mutants(folder: Path, mutants: list[Mutant]) -> None:
    """Leave the list that numbers refer to in the folder of the workers."""
    text = json.dumps([asdict(mutant) for mutant in mutants], indent=1)
    (folder / MUTANTS).write_text(text, "utf-8")


def read_mutants(folder: Path) -> list[Mutant]:
    """The list that numbers refer to."""
    entries = json.loads((folder / MUTANTS).read_text("utf-8"))
    return [Mutant(**entry | {"cases": tuple(entry["cases"])}) for entry in entries]


def answer(request: dict[str, Any], folder: Path, mutants: list[Mutant]) -> list[dict[str, Any]]:
    """What one request asks for: a study without errors is made and kept, or the bad rows are found."""
    baseline, labels = Baseline(folder / BASELINE), [tuple(label) for label in request["labels"]]
    if request["do"] == "baseline":
        for label in labels:
            baseline.make(label, request["engine"])
        return []
    number = request["number"]
    mutant = None if number is None else mutants[number]
    size = 0.0 if mutant is None else request["size"]
    profiles = {one.profile for one in mutants} if mutant is None else {mutant.profile}
    rows = bad_rows(
        mutant, -1 if number is None else number, size, labels, baseline, folder / TREE,
        "full" if "full" in profiles else "quick",
    )  # fmt: skip
    return [asdict(row) for row in rows]


def serve(folder: Path, requests: IO[str], answers: IO[str]) -> None:
    """Answer requests until there are no more."""
    mutants = read_mutants(folder)
    for line in requests:
        begin = time.perf_counter()
        reply: dict[str, Any] = {"rows": [], "problem": ""}
        try:
            reply["rows"] = answer(json.loads(line), folder, mutants)
        except Exception as problem:  # the caller decides what it means
            traceback.print_exc()
            reply["problem"] = " ".join(f"{type(problem).__name__}: {problem}".split())
        reply["seconds"] = time.perf_counter() - begin
        answers.write(json.dumps(reply) + "\n")
        answers.flush()


def main() -> None:
    """Serve on the standard streams, in the tree that is the current folder."""
    import cmpcheck

    folder = Path(sys.argv[1])
    if folder / TREE not in Path(cmpcheck.__file__).parents:
        raise SystemExit(f"{cmpcheck.__file__} is not in {folder / TREE}")
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    serve(folder, sys.stdin, answers)


if __name__ == "__main__":
    main()
