"""Removal in the loop with a wall that is a mesh: LIGGGHTS, whose mesh is read again where it was lowered.

The same samples in the reference, in LAMMPS with the soft form of the Python fix, whose wall is the
heightfield itself, and in LIGGGHTS.  What reading costs is `benchmarks/remeshing.py`; why soft contacts
remove less than impacts in turn is `cmpcheck/soft_study.py`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmpcheck.engines import make_engine
from cmpcheck.results import Column, Estimate, StudyResult, Table
from cmpcheck.soft_study import OBSERVABLES, Durations, run_soft
from cmpcheck.statistics import relative_differences
from cmpcheck.studies.sampling import clear, estimate, interval_text, samples_of
from reference.case import Case, load_case

CASE = "polish_pair"
ENGINES = ("lammps", "liggghts")
SAMPLES = {"quick": 3, "full": 9}
DURATION = {"quick": "10 us", "full": "40 us"}
CONTACT = 12e-9  # s, four times the case's own: a sample takes LIGGGHTS a minute as it is
STEPS = 50  # in a contact


def study(profile: str, runs: Path) -> StudyResult:
    """Flattening, removals, depths and volume of the same samples in three engines.

    Raises RuntimeError when an engine is missing.
    """
    for name in ENGINES:
        info = make_engine(name).info()
        if not info.available:
            raise RuntimeError(info.reason)
    case, n = small_case(profile), SAMPLES[profile]
    level, reference = Durations(CONTACT, CONTACT), make_engine("reference")
    found = {name: run_soft(case, (reference, make_engine(name)), (level,), n) for name in ENGINES}
    numbers = {"reference": found["lammps"].reference}
    numbers |= {f"{name}, soft": ensemble.measured[0] for name, ensemble in found.items()}
    mesh, fix, impacts = (numbers[key] for key in ("liggghts, soft", "lammps, soft", "reference"))
    apart, gap = relative(mesh, fix), relative(mesh, impacts)
    told = [o.quantity.replace("_", " ") for o, d in zip(OBSERVABLES, apart, strict=True) if clear(d, n, 4)]
    sentence = (
        f"With soft contacts of {CONTACT * 1e9:g} ns LIGGGHTS, whose mesh is read again where it was "
        f"lowered, removes {interval_text(_percent(apart[3]), n)} % more volume than LAMMPS, whose wall is "
        f"the heightfield itself, and flattens by {interval_text(_percent(apart[0]), n)} % more (95 % "
        f"intervals, n = {n}); "
    )
    sentence += f"they differ in {', '.join(told)}" if told else "no quantity tells them apart"
    sentence += (
        f".  From impacts in turn both depart as soft contacts do: LIGGGHTS's volume is "
        f"{interval_text(_percent(gap[3]), n)} % from the reference's."
    )
    columns = [Column(o.quantity.replace("_", " "), o.unit) for o in OBSERVABLES]
    return StudyResult(
        name="remeshing",
        title="Removal from a mesh wall, in the loop",
        varied=f"The engine; all else as in {CASE}, but for a duration of {DURATION[profile]} and "
        f"soft contacts with {STEPS} steps in each.",
        samples=samples_of(case, n),
        tables=(
            Table(
                "The same samples in three engines, ± standard error",
                (Column("engine"), *columns),
                tuple((name, *map(estimate, rows.T)) for name, rows in numbers.items()),
            ),
            Table(
                "Differences sample by sample, in % of the mean of the second, ± standard error",
                (Column("engines"), *(Column(f"{column.name} (%)") for column in columns)),
                (
                    ("liggghts against lammps", *map(_percent, apart)),
                    ("liggghts against the reference", *map(_percent, gap)),
                    ("lammps against the reference", *map(_percent, relative(fix, impacts))),
                ),
            ),
        ),
        sentence=sentence,
    )  # fmt: skip


def small_case(profile: str) -> Case:
    """polish_pair as the study runs it."""
    return load_case(CASE).replaced(
        {
            "case": {"duration": DURATION[profile], "outputs": 11},
            "engine.lammps": {"contact_duration": CONTACT, "steps_per_contact": STEPS},
            "engine.liggghts": {"contact_duration": CONTACT, "steps_per_contact": STEPS},
        }
    )


def relative(measured: np.ndarray, reference: np.ndarray) -> list[Estimate]:
    """Differences (n, observables) sample by sample, each in units of the reference's mean."""
    return [estimate(relative_differences(m, r)) for m, r in zip(measured.T, reference.T, strict=True)]


def _percent(found: Estimate) -> Estimate:
    return Estimate(100.0 * found.value, 100.0 * found.standard_error)
