"""Inputs from a seed, blind: `python -m benchmarks.fuzz.plain TARGET COUNT [SEED [FILE]]`.

The k-th input of a seed is the same on every machine, so that a finding is repeated by its number.
"""

from __future__ import annotations

import json
import random
import sys
from collections import Counter
from pathlib import Path

from benchmarks.fuzz.mutations import spoilt
from benchmarks.fuzz.seeds import SEEDS
from benchmarks.fuzz.targets import Finding, tried


def draw(target: str, seed: int, k: int) -> bytes:
    """Input k of a seed: a good one, spoilt."""
    rng = random.Random(f"{target} {seed} {k}")
    found = SEEDS[target]()
    return spoilt(rng.choice(found), rng)


def run(target: str, count: int, seed: int = 0) -> tuple[Counter[str], dict[int, str]]:
    """How many were taken and refused, and the findings by the number of their input."""
    counts: Counter[str] = Counter()
    findings: dict[int, str] = {}
    good = SEEDS[target]()
    for k in range(count):
        rng = random.Random(f"{target} {seed} {k}")
        try:
            counts[tried(target, spoilt(rng.choice(good), rng))] += 1
        except Finding as found:
            counts["finding"] += 1
            findings[k] = str(found)
    return counts, findings


def main() -> None:
    target, count, *rest = sys.argv[1:]
    counts, findings = run(target, int(count), int(rest[0]) if rest else 0)
    for k, what in findings.items():
        print(f"{target} {k}: {what}")
    print(dict(counts))
    if rest[1:]:
        found = [{"what": what, "input": k} for k, what in findings.items()]
        Path(rest[1]).write_text(json.dumps({"counts": counts, "findings": found}), "utf-8")


if __name__ == "__main__":
    main()
