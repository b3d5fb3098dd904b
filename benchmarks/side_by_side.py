"""All engines on one shear in one run, at N = 73, 5000 and 50 000: `engines.py` in a few minutes.

The surface is flat.  At N = 50 000 LIGGGHTS has it as a plane only: a mesh would have 2.2 million triangles,
which it visits at every step (`NOTES.md`), and as cmpcheck drives it, it creates atoms one by one.  With
asperities: `engines.md`.
"""

from __future__ import annotations

from statistics import median
from typing import Any

from benchmarks import engines, engines_page
from benchmarks.engines_findings import findings
from benchmarks.measurement import digits

STEPS, LARGE = {73: 50_000, 5_000: 1_500}, 50_000  # of the soft engines in a run
REPEATS, LARGE_STEPS = 3, 200
WITH_MESH = ("liggghts", "liggghts_observed")


def measure(quick: bool) -> dict[str, Any]:
    """`particle_steps_per_s` {engine: {N: value}}, over the flat surface and on one rank, and every run.

    `problem` says which runs have failed, or have not ended as the reference's: they have no speed.
    """
    cells = []
    for count, steps in {73: 100}.items() if quick else STEPS.items():
        cells += engines.measure((count,), 1 if quick else REPEATS, surfaces=("flat",), steps=steps)
    large = [way for way in engines.all_ways() if way.key not in WITH_MESH]
    if not quick:
        cells += engines.measure((LARGE,), 1, large, ("flat",), LARGE_STEPS)
    problems = [str(cell) for cell in cells if cell.problem]
    return {
        "problem": "; ".join(problems),
        "particle_steps_per_s": engines_page.speeds(cells),
        "side_by_side": {
            "labels": {cell.way.key: cell.way.label for cell in cells},
            "missing": {cell.way.label: cell.way.missing for cell in cells if cell.way.missing},
            "runs": engines_page.rows(cells), "findings": findings(cells),
        },
    }  # fmt: skip


def lines(results: dict[str, Any]) -> list[str]:
    """The section of the page."""
    speeds, found = results["particle_steps_per_s"], results["side_by_side"]
    sizes = sorted({int(n) for one in speeds.values() for n in one})
    best = {n: max(one.get(str(n), 0.0) for one in speeds.values()) for n in sizes}
    text = [
        "Million particle-steps per second on one core, flat surface, `decks/shear.toml`, medians. In "
        "brackets the speed over that of the fastest. All ends were held against the reference's. "
        "At N = 50 000 LIGGGHTS has no mesh (2.2 million triangles) and is not driven by cmpcheck, which "
        "creates atoms one by one; there each was run once, and the reference, at its own long step, makes "
        "so few steps that its start is in them. The reference is its plain stepper.",
        "",
        "| engine |" + "".join(f" N = {n} |" for n in sizes),
        "|---|" + "---:|" * len(sizes),
    ]
    for key, one in sorted(speeds.items(), key=lambda item: -item[1].get(str(sizes[0]), 0.0)):
        cells = "".join(
            f" {digits(one[str(n)] / 1e6, 3)} ({one[str(n)] / best[n]:.2g}) |" if str(n) in one else " |"
            for n in sizes
        )
        text.append(f"| {found['labels'].get(key, key)} |{cells}")
    two = [one for one in found["runs"] if one["ranks"] == 2 and one["particle_steps_per_s"]]
    if two:
        speeds_of_two = [
            f"{found['labels'][one['engine']]}, N = {one['N']}: "
            f"{digits(median(one['particle_steps_per_s']) / 1e6, 3)}"
            for one in two
        ]
        text += ["", f"On two ranks: {'; '.join(speeds_of_two)}."]
    text += [f"\n{label} was not run: {reason}" for label, reason in found["missing"].items()]
    return [*text, "", *(f"- {line}" for line in found["findings"])]
