"""How many pairs of samples are run, from the spread that a pilot had, and what they can tell.

The pilot is a few samples with numbers of their own, run once, whose spreads stand in the case file: n is
fixed before the samples that are judged.  Power itself is `statistics/power.py`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from cmpcheck.display import superscript
from cmpcheck.observables import OBSERVABLES, TIMES, Pairs
from cmpcheck.results import Planning
from cmpcheck.statistics import (
    detectable_difference,
    fewest_pairs,
    power_of_equivalence,
    sample_size,
)
from cmpcheck.statistics.power import EXTRA_PAIRS
from reference.case import Case
from reference.toml_source import MISSING

QUANTITIES = TIMES + len(OBSERVABLES) - 1  # judged together: flatness at several times, the others at the end
FEWEST = {"quick": fewest_pairs(QUANTITIES), "full": 24}  # pairs; see `fewest_sentence`
ASSURANCE = 0.8  # that the spread is at most what is assumed
DETECTION_POWER = 0.8


def fewest_sentence() -> str:
    """Why the quick profile runs as many pairs as it does.

    >>> fewest_sentence()[:58]
    'With 9 pairs one of 8 quantities alone can be called diffe'
    """
    n = FEWEST["quick"]
    p = QUANTITIES * 2.0 ** (2 - n)
    return (
        f"With {n} pairs one of {QUANTITIES} quantities alone can be called different; with {n - 1} never: "
        f"the smallest p-value of {n - 1} sign flips, 2{superscript(2 - n)}, times {QUANTITIES} is {p:.3g}, "
        "above 0.05."
    )


def pilot_spreads(case: Case, engine: str) -> tuple[int, dict[str, float]]:
    """Number of pairs of the pilot and its standard deviations by quantity, from `[engine.NAME.pilot]`.

    (0, {}) without a pilot.  Raises CaseError where an entry is missing or makes no sense.
    """
    path, table = f"engine.{engine}.pilot", case.engine.get(engine, {}).get("pilot")
    if table is None:
        return 0, {}
    values = {}
    for key in ("pairs", *(o.quantity for o in OBSERVABLES)):
        if key not in table:
            raise case.error(f"{path}.{key}", MISSING, "required in a pilot, but missing")
        values[key] = case.quantity(table[key], "", f"{path}.{key}")
        if not values[key] > 0.0:
            raise case.error(f"{path}.{key}", table[key], "allowed: > 0")
    pairs = values.pop("pairs")
    if pairs < 3 or pairs != int(pairs):
        raise case.error(f"{path}.pairs", table["pairs"], "allowed: 3, 4, ...")
    return int(pairs), values


def upper_limit(spread: float, pairs: int) -> float:
    """What the true standard deviation is below with probability ASSURANCE, for normal differences.

    >>> round(upper_limit(1.0, 12), 2)
    1.25
    """
    return spread * math.sqrt((pairs - 1) / float(stats.chi2.ppf(1.0 - ASSURANCE, pairs - 1)))


def pairs_to_run(case: Case, engine: str, profile: str, margins: dict[str, float]) -> int:
    """How many pairs the profile runs; `full` as many as the power calculation asks for, 24 at least.

    Parameters: margins by quantity, in the measure of the pilot's spreads.
    Raises CaseError where the pilot in the case file makes no sense.
    """
    pairs, spreads = pilot_spreads(case, engine)
    needed = [sample_size(upper_limit(s, pairs), margins[quantity]) for quantity, s in spreads.items()]
    return max([FEWEST[profile], *(needed if profile == "full" else [])])


def plan(case: Case, engine: str, found: list[Pairs]) -> list[Planning]:
    """The power calculation of every quantity, beside the spread that the samples have.

    Without a pilot the samples' own spread is assumed: what they could have told, after the fact.
    """
    pairs, spreads = pilot_spreads(case, engine)
    records = []
    for p in found:
        n, quantity = len(p.reference), p.observable.quantity
        pilot = spreads.get(quantity, math.nan)
        assumed = upper_limit(pilot, pairs) if pairs else p.spread
        source = f"{100 * ASSURANCE:g} % upper limit from {pairs} pilot pairs"
        records.append(
            Planning(
                engine=engine,
                quantity=quantity,
                relative=p.observable.relative,
                margin=p.margin,
                pilot=pilot,
                assumed=assumed,
                source=source if pairs else "these pairs; no pilot",
                needed=sample_size(assumed, p.margin),
                pairs=n,
                power=power_of_equivalence(assumed, p.margin, max(n - EXTRA_PAIRS, 2)),
                detectable=detectable_difference(assumed, n, DETECTION_POWER),
                found=p.spread,
                largest=max(float(np.abs(p.differences(frame)).max()) for frame in p.frames),
            )
        )
    return records
