"""The fast stepper against the plain one where chaos parts their trajectories: the same statistics?

The pad is at rest and the surface as good as frozen, so that no feedback hides an error in the impacts; Pi(t)
alone would not see one.  That both follow each other to round-off until then is shown in tests.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd

from cmpcheck.results import Column, StudyResult, Table
from cmpcheck.studies.sampling import estimate, half_width, held, sample_rows, samples_of, standing
from reference import simulate
from reference.case import Case, load_case

CASE = "polish_full"
SAMPLES = {"quick": 8, "full": 96}  # 32 leave open whether a difference of 2 % is chance
DURATION = {"quick": 0.2e-3, "full": 1.5e-3}  # s
PAD_HEIGHT = 1.2e-6  # m
FROZEN = 1e-9  # acceleration: a removal takes off a billionth
LIMIT = 0.04  # of the plain stepper's mean
SEED = 20_000  # fresh: no other study's
SPEEDS = (0.05, 0.1, 0.2, 0.4, np.inf)  # m/s, bins of approach speeds; the first is the case's threshold
QUANTITIES = ("removing hits", "removed volume, µm³", "sum of depths, µm")


def case_of(profile: str, stepper: str) -> Case:
    """The case with a pad at rest over a frozen surface."""
    (plain,) = load_case(CASE).variants()
    return held(
        plain,
        PAD_HEIGHT,
        case={"duration": DURATION[profile], "outputs": 2, "seed": SEED},
        removal={"acceleration": FROZEN},
        numerics={"stepper": stepper, "ledger_speed": SPEEDS[0]},
    )


def bins() -> list[str]:
    """Names of the bins of approach speeds."""
    return [
        f"impacts at {low:g} m/s or more" if high == np.inf else f"impacts at {low:g} to {high:g} m/s"
        for low, high in pairwise(SPEEDS)
    ]


def observe(case: Case) -> pd.Series:
    """Removing hits, volume, depths and the histogram of approach speeds on the surface, of one sample."""
    run = simulate(case)
    last = run.history.iloc[-1]
    impacts = run.contacts.loc[run.contacts["kind"] == "surface", "approach_speed"]
    counts, _ = np.histogram(impacts, SPEEDS)
    found = [last["removals"], 1e18 * last["removed_volume"], 1e6 * last["depth_sum"], *counts]
    return pd.Series(dict(zip((*QUANTITIES, *bins()), map(float, found), strict=True)))


def study(profile: str, runs: Path) -> StudyResult:
    """Differences of the fast stepper from the plain one, sample by sample."""
    n = SAMPLES[profile]
    plain, fast = (sample_rows(case_of(profile, stepper), n, observe) for stepper in ("plain", "fast"))
    changes = {
        name: estimate((fast[name] - plain[name]) / plain[name].mean())
        for name in plain.columns
        if plain[name].mean() > 0.0
    }
    verdicts = {name: standing([change], n, LIMIT) for name, change in changes.items()}
    widths = {name: half_width(change, n) for name, change in changes.items()}
    rows = tuple(
        (name, estimate(plain[name]), change, widths[name], verdicts[name])
        for name, change in changes.items()
    )
    judged = [name for name in QUANTITIES if name in verdicts]
    apart = [name for name, verdict in verdicts.items() if verdict == "different"]
    main = ", ".join(
        f"{name} {100 * changes[name].value:+.2f} ± {100 * widths[name]:.2f} %" for name in judged
    )
    sentence = f"Fast against plain, differences paired by seed with 95 % intervals: {main}. " + (
        f"They differ in {', '.join(apart)}."
        if apart
        else f"{sum(v == 'converged' for v in verdicts.values())} of {len(verdicts)} quantities, the bins of "
        f"the approach speeds among them, agree within {LIMIT:.0%} for certain; none differs."
    )
    return StudyResult(
        name="stepper",
        title="The fast stepper",
        varied="The stepper: the same samples by the plain one, the answer key, and by the fast one; "
        f"pad at rest at {1e6 * PAD_HEIGHT:g} µm, surface frozen, {1e3 * DURATION[profile]:g} ms.",
        samples=samples_of(case_of(profile, "plain"), n),
        tables=(
            Table(
                "Fast against plain, paired by seed",
                (
                    Column("quantity"), Column("plain, per sample"), Column("difference, of its mean"),
                    Column("half of its 95 % interval"), Column(f"within {LIMIT:.0%}"),
                ),
                rows,
            ),
        ),
        sentence=sentence,
    )  # fmt: skip
