"""How the result depends on the threshold of removal, the speed below which an impact removes nothing."""

from __future__ import annotations

from pathlib import Path

from cmpcheck.results import Chart, Column, StudyResult
from cmpcheck.studies.sampling import changed, estimate, interval_text, power, samples_of, step_text
from cmpcheck.studies.sweep import Setting, curve, sweep, sweep_table
from reference.case import load_case

CASE = "polish_pair"
SAMPLES = {"quick": 4, "full": 12}
THRESHOLDS = (0.0125, 0.025, 0.05, 0.1, 0.2)  # m/s
BASE = 2  # the case's own
GAMMA = 0.0008  # 2 U dt/tau of the smallest abrasive, 0.9 of the mean size, stays below the lowest threshold


def study(profile: str, runs: Path) -> StudyResult:
    """Flatness, removals and volume against the threshold velocity."""
    (plain,) = load_case(CASE).variants()
    case = changed(plain, numerics={"gamma": GAMMA})
    n = SAMPLES[profile]
    settings = [Setting((v,), changed(case, removal={"threshold_velocity": v})) for v in THRESHOLDS]
    found = sweep(settings, BASE, n)
    low, high = found[0], found[-1]
    change = estimate(high.rows["flatness"] - low.rows["flatness"])
    by_removals = power(THRESHOLDS, [one.rows["removals"] for one in found])
    by_volume = power(THRESHOLDS, [one.rows["removed_volume"] for one in found])
    sentence = (
        f"From {THRESHOLDS[0]:g} to {THRESHOLDS[-1]:g} m/s, a factor of {THRESHOLDS[-1] / THRESHOLDS[0]:g}, "
        f"the number of removals goes as the threshold to the power {by_removals.text()}, the removed "
        f"volume to the power {by_volume.text()}, and Π(T) from {low.mean['flatness'].value:.2f} to "
        f"{high.mean['flatness'].value:.2f}, a change of {interval_text(change, n)} (95 % intervals): "
    )
    sentence += (
        f"no dependence of the counts is told from none with n = {n}"
        if by_removals.holds(0.0)
        else "the threshold is a parameter of the model, which the paper does not give; counts of removals "
        "mean nothing without it"
        if abs(by_removals.exponent.value) > 2 * abs(by_volume.exponent.value)
        else "counts and volumes depend on it alike"
    )
    sentence += ", and absolute values of Π hold only for the threshold that they were computed with."
    return StudyResult(
        name="threshold",
        title="The threshold of removal",
        varied=f"The threshold velocity; all else as in the case, but for {step_text(case, plain)}",
        samples=samples_of(case, n),
        tables=(
            sweep_table(
                "Polishing at several thresholds, ± standard error", [Column("threshold", "m/s")], found,
                f"{THRESHOLDS[BASE]:g} m/s",
            ),
        ),
        sentence=sentence,
        charts=(
            Chart(
                "Removals against the threshold, ± standard error", Column("threshold", "m/s"),
                Column("removals"), (curve("removals", found, "removals", 0),), logarithmic=True,
            ),
        ),
    )  # fmt: skip
