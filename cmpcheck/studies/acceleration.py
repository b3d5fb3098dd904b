"""Whether a run that is accelerated by A stands for one that is not: Pi(T) against A at equal A T."""

from __future__ import annotations

import itertools
from pathlib import Path

from cmpcheck.display import uncertain
from cmpcheck.results import Chart, Column, StudyResult
from cmpcheck.studies.sampling import changed, samples_of
from cmpcheck.studies.sweep import Found, Setting, curve, sweep, sweep_table
from reference.case import load_case

CASE = "polish_pair"
SAMPLES = {"quick": 3, "full": 12}
FACTORS = (400.0, 200.0, 100.0, 50.0, 25.0)
WHOLE = 0.04  # A T, s
CLEAR = 2.0  # standard errors: a smaller change is not told from none


def study(profile: str, runs: Path) -> StudyResult:
    """Flatness, removals and volume against the acceleration factor."""
    (case,) = load_case(CASE).variants()
    n = SAMPLES[profile]
    settings = [
        Setting((a, WHOLE / a), changed(case, removal={"acceleration": a}, case={"duration": WHOLE / a}))
        for a in FACTORS
    ]
    found = sweep(settings, len(settings) - 1, n)
    return StudyResult(
        name="acceleration",
        title="Acceleration of removal",
        varied="A, by which the removal of each impact and the descent of the pad are multiplied, with A "
        f"T = {WHOLE:g} s held; all else as in the case.",
        samples=samples_of(case, n),
        tables=(
            sweep_table(
                "Polishing at several factors A, ± standard error", [Column("A"), Column("T", "s")], found,
                f"A = {FACTORS[-1]:g}",
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
    last = found[-1]
    steps = itertools.pairwise(found)
    removals = [after.mean["removals"].value / before.mean["removals"].value for before, after in steps]
    growth = (
        f"each halving of A multiplies the number of removals by {min(removals):.2f} to {max(removals):.2f}"
    )
    beyond = [one for one in found[:-1] if _clear(one)]
    if not beyond:
        worst = max(found[:-1], key=lambda one: abs(one.difference["flatness"].value))
        change = uncertain(*worst.difference["flatness"])
        return (
            f"Π(T) does not depend on A within the errors: the largest change from A = {FACTORS[-1]:g} is "
            f"{change}, at A = {worst.setting.cells[0]:g}; {growth}."
        )
    first = found[0]
    settled = [one.setting.cells[0] for one in found[:-1] if not _clear(one)]
    until = (
        f"; up to A = {max(settled):g} it is that of A = {FACTORS[-1]:g} within two standard errors"
        if settled
        else ""
    )
    return (
        f"An accelerated run stands for a slower one only roughly: Π(T) at A = {FACTORS[0]:g} differs from "
        f"that at A = {FACTORS[-1]:g}, {last.mean['flatness'].value:.3f}, by "
        f"{uncertain(*first.difference['flatness'])}{until}; {growth}."
    )


def _clear(one: Found) -> bool:
    change = one.difference["flatness"]
    return abs(change.value) > CLEAR * change.standard_error
