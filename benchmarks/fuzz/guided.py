"""Inputs that atheris finds by the paths they take: `python -m benchmarks.fuzz.guided TARGET COUNT FILE`.

The functions that read are instrumented; inputs that reach new branches are kept in a folder beside FILE, and
spoilt further by the mutations of this package or those of libFuzzer; the others are good ones, spoilt.
Counts and findings go to FILE, which is written again and again since libFuzzer ends the process.  Needs the
extra `fuzz`.
"""

from __future__ import annotations

import importlib
import inspect
import json
import random
import sys
from collections import Counter
from pathlib import Path
from typing import Any

LONGEST = 60_000  # bytes of an input
WRITE_EVERY = 500  # inputs
AFRESH = 0.6  # of the inputs start from a good one: most that are kept are refused by their first lines
READERS = [  # whose functions are instrumented; compiled kernels cannot be
    "reference.case", "reference.case_rules", "reference.case_sections", "reference.case_optimise",
    "reference.toml_source", "reference.units", "reference.checkpoint", "reference.recording",
    "reference.spool",
    "cmpcheck.trajectories.digits", "cmpcheck.trajectories.dumps", "cmpcheck.trajectories.frames",
    "cmpcheck.trajectories.judged", "cmpcheck.trajectories.meshes", "cmpcheck.trajectories.starts",
    "cmpcheck.trajectories.tables", "cmpcheck.trajectories.units", "cmpcheck.trajectories.velocities",
    "cmpcheck.deck", "cmpcheck.engines.lammps_setup", "cmpcheck.summary", "cmpcheck.optimise.store",
]  # fmt: skip


def instrument() -> int:
    """Let atheris see the branches of the readers; how many functions those are."""
    import atheris

    count = 0
    for name in READERS:
        module = importlib.import_module(name)
        classes = [
            part for part in vars(module).values() if inspect.isclass(part) and part.__module__ == name
        ]
        for owner in (module, *classes):
            for part in list(vars(owner).values()):
                part = inspect.unwrap(getattr(part, "__func__", part))
                if inspect.isfunction(part) and part.__module__ == name:
                    atheris.instrument_func(part)
                    count += 1
    return count


def main() -> None:
    target, count, file = sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])
    import atheris

    from benchmarks.fuzz import mutations, seeds, targets

    instrument()
    corpus = file.parent / f"corpus-{target}"
    corpus.mkdir(parents=True, exist_ok=True)
    good = seeds.SEEDS[target]()
    for k, data in enumerate(good):
        (corpus / f"seed-{k:03}").write_bytes(data)
    counts: Counter[str] = Counter()
    findings: list[dict[str, Any]] = []

    def one(data: bytes) -> None:
        try:
            counts[targets.tried(target, data)] += 1
        except targets.Finding as found:
            counts["finding"] += 1
            if len(findings) < 50:
                findings.append({"what": str(found), "input": data[:LONGEST].hex()})
        if sum(counts.values()) % WRITE_EVERY == 0 or sum(counts.values()) >= count:
            file.write_text(json.dumps({"counts": counts, "findings": findings}), "utf-8")

    def mutate(data: bytes, longest: int, seed: int) -> bytes:
        rng = random.Random(seed)
        if rng.random() < AFRESH:
            return mutations.spoilt(rng.choice(good), rng, most=3)[:longest]
        spoilt = atheris.Mutate(data, longest) if rng.random() < 0.3 else mutations.spoilt(data, rng)
        return bytes(spoilt[:longest])

    flags = [f"-runs={count}", "-seed=1", f"-max_len={LONGEST}", "-verbosity=0", "-len_control=0"]
    atheris.Setup([sys.argv[0], *flags, str(corpus)], one, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
