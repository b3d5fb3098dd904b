"""Whether a run that is accelerated by A stands for one that is not: Pi(T) against A at equal A T."""

from __future__ import annotations

import itertools
from pathlib import Path

from cmpcheck.results import Chart, Column, StudyResult
from cmpcheck.studies.sampling import (
    FINE_GAMMA,
    changed,
    clear,
    half_width,
    interval_text,
    samples_of,
    step_text,
)
from cmpcheck.studies.sweep import Found, Setting, curve, sweep, sweep_table
from reference.case import load_case

CASE = "polish_pair"
SAMPLES = {"quick": 3, "full": 8}
FACTORS = {"quick": (400.0, 200.0, 100.0), "full": (400.0, 200.0, 100.0, 50.0, 25.0)}  # at 25, 4 s a sample
WHOLE = 0.04  # A T, s


def study(profile: str, runs: Path) -> StudyResult:
    """Flatness, removals and volume against the acceleration factor."""
    (plain,) = load_case(CASE).variants()
    case = changed(plain, numerics={"gamma": FINE_GAMMA})
    n, factors = SAMPLES[profile], FACTORS[profile]
    settings = [
        Setting((a, WHOLE / a), changed(case, removal={"acceleration": a}, case={"duration": WHOLE / a}))
        for a in factors
    ]
    found = sweep(settings, len(settings) - 1, n)
    return StudyResult(
        name="acceleration",
        title="Acceleration of removal",
        varied="A, by which the removal of each impact and the descent of the pad are multiplied, with A "
        f"T = {WHOLE:g} s held; all else as in the case, but for {step_text(case, plain)}",
        samples=samples_of(case, n),
        tables=(
            sweep_table(
                "Polishing at several factors A, ± standard error", [Column("A"), Column("T", "s")], found,
                f"A = {factors[-1]:g}",
            ),
        ),
        sentence=_sentence(found),
        charts=(
            Chart(
                "Flatness at the end against A at equal A T, ± standard error", Column("A"), Column("Π(T)"),
                (curve("Π(T)", found, "flatness", 0),),
            ),
        ),
    )  # fmt: skip


def _sentence(found: list[Found]) -> str:
    """Where Pi(T) first differs, counted from the slowest: beyond that no A stands for it."""
    slowest, n = found[-1], len(found[-1].rows)
    steps = itertools.pairwise(found)
    removals = [after.mean["removals"].value / before.mean["removals"].value for before, after in steps]
    growth = (
        f"Each halving of A multiplies the number of removals by {min(removals):.2f} to {max(removals):.2f}."
    )
    changes = [(one.setting.cells[0], one.difference["flatness"]) for one in reversed(found[:-1])]
    settled = list(itertools.takewhile(lambda change: not clear(change[1], n), changes))
    base = f"A = {slowest.setting.cells[0]:g}"
    parts = []
    if settled:
        most = max(abs(change.value) + half_width(change, n) for _, change in settled)
        parts.append(
            f"From {base} up to A = {settled[-1][0]:g} no change of Π(T) is told from none; it may be up to "
            f"{most:.2g} (95 % intervals, n = {n})"
        )
    if len(settled) < len(changes):
        factor, change = changes[len(settled)]
        parts.append(
            f"At A = {factor:g} Π(T) differs from that at {base}, {slowest.mean['flatness'].value:.3f}, by "
            f"{interval_text(change, n)} (95 % interval), so that a run at this A or above stands for a "
            "slower one only roughly"
        )
    return f"{'. '.join(parts)}. {growth}"
