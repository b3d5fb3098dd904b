"""How often the statistical part calls equal engines different: reference against reference, other seeds.

Both sides of a trial are samples of the reference, drawn from a pool without replacement.  The judgement is
that of `ensembles.py`: every observable, at every time, as one family.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import stats

from cmpcheck.observables import OBSERVABLES, Pairs, margins, over_time
from cmpcheck.planning import FEWEST
from cmpcheck.pool import run_tasks
from cmpcheck.sensitivity.store import Store
from cmpcheck.statistics import Equivalence, control_family, paired_difference
from reference.case import load_case
from reference.ensemble import sample_case
from reference.simulation import simulate

Progress = Callable[[str, int, int], None]

CASE, ENGINE, ALPHA = "polish_pair", "lammps", 0.05
KIND, POOL = "false-alarms", "pool"
PAIRS = FEWEST["quick"]
TRIALS = 200
# In `full` no two trials share a sample, so that they are independent; in `quick` they share a small pool.
SAMPLES = {"quick": 160, "full": 2 * PAIRS * TRIALS}
RESAMPLES = {"quick": 999, "full": 9999}
FIRST = 10_000  # number of the first sample: those below are judged, or were pilots
CHUNK = 20
CONFIDENCE = 0.95


def keep(store: Store, profile: str, jobs: int, progress: Progress) -> None:
    """Run the pool, then the trials."""
    pool = make_pool(store, SAMPLES[profile], jobs, progress)
    if store.get(KIND, profile) is not None:
        return
    resamples, draws = RESAMPLES[profile], draws_of(len(next(iter(pool.values()))), profile == "full")
    tasks = [(pool, part, k, resamples) for k, part in enumerate(np.array_split(draws, max(4 * jobs, 1)))]
    found: dict[int, list[dict[str, bool]]] = {}
    progress("false alarms", 0, TRIALS)
    for task, future in run_tasks(_trials, tasks, jobs):
        found[task[2]] = future.result()
        progress("false alarms", sum(map(len, found.values())), TRIALS)
    trials = [trial for k in sorted(found) for trial in found[k]]
    store.put(KIND, profile, summary(trials, profile))


def make_pool(store: Store, samples: int, jobs: int, progress: Progress) -> dict[str, np.ndarray]:
    """Every observable of the samples over time, (samples, T) each, by its name."""
    chunks = list(range(0, samples, CHUNK))
    missing = [first for first in chunks if store.get(POOL, str(first)) is None]
    progress("reference samples", samples - CHUNK * len(missing), samples)
    for first, future in run_tasks(_samples, missing, jobs):
        store.put(POOL, str(first), future.result())
        progress("reference samples", CHUNK * store.count(POOL), samples)
    parts = [store.get(POOL, str(first)) for first in chunks]
    return {
        o.quantity: np.array([row for part in parts for row in part[o.quantity]])[:samples]
        for o in OBSERVABLES
    }


def _samples(first: int) -> dict[str, Any]:
    """A chunk of samples at the step of an ordinary run."""
    (case,) = load_case(CASE).variants()
    found: dict[str, list[list[float]]] = {o.quantity: [] for o in OBSERVABLES}
    for k in range(first, first + CHUNK):
        run = simulate(sample_case(case, FIRST + k))
        for o in OBSERVABLES:
            found[o.quantity].append(over_time(run, o).tolist())
    return found | {"times": run.times.tolist()}


def draws_of(samples: int, independent: bool) -> np.ndarray:
    """The samples of each trial, (TRIALS, 2 PAIRS): disjoint, and `independent` of each other."""
    rng = np.random.default_rng(1)
    if independent:
        return rng.permutation(samples)[: 2 * PAIRS * TRIALS].reshape(TRIALS, 2 * PAIRS)
    return np.array([rng.permutation(samples)[: 2 * PAIRS] for _ in range(TRIALS)])


def judge(
    pool: dict[str, np.ndarray], ours: Sequence[int], theirs: Sequence[int], resamples: int
) -> list[Equivalence]:
    """The verdicts of one comparison, in the order of observables and times."""
    (case,) = load_case(CASE).variants()
    limits, times = margins(case, ENGINE), np.arange(next(iter(pool.values())).shape[1], dtype=float)
    verdicts = []
    for o in OBSERVABLES:
        values = pool[o.quantity]
        pairs = Pairs(o, limits[o.quantity], times, values[list(ours)], values[list(theirs)])
        verdicts += [
            paired_difference(pairs.differences(frame), pairs.margin, ALPHA, resamples=resamples)
            for frame in pairs.frames
        ]
    return control_family(verdicts)


def _trials(task: tuple[dict[str, np.ndarray], np.ndarray, int, int]) -> list[dict[str, bool]]:
    pool, draws, _, resamples = task
    trials = []
    for draw in draws:
        verdicts = judge(pool, draw[:PAIRS], draw[PAIRS:], resamples)
        trials.append({
            "resolved": any(v.resolved for v in verdicts),
            "different": any(v.verdict == "different" for v in verdicts),
            "equivalent": all(v.verdict == "equivalent" for v in verdicts),
        })  # fmt: skip
    return trials


def summary(trials: Sequence[dict[str, bool]], profile: str) -> dict[str, Any]:
    """Rates with their Clopper-Pearson intervals.

    >>> trial = {"resolved": True, "different": False, "equivalent": False}
    >>> summary([trial] * 4, "quick")["resolved"]["rate"]
    1.0
    """

    def rate(name: str) -> dict[str, float]:
        count = sum(trial[name] for trial in trials)
        interval = stats.binomtest(count, len(trials)).proportion_ci(CONFIDENCE, method="exact")
        return {
            "count": count,
            "rate": count / len(trials),
            "low": float(interval.low),
            "high": float(interval.high),
        }

    return {
        "case": CASE, "alpha": ALPHA, "trials": len(trials), "pairs": PAIRS, "samples": SAMPLES[profile],
        "independent": profile == "full", "resamples": RESAMPLES[profile], "confidence": CONFIDENCE,
        **{name: rate(name) for name in ("resolved", "different", "equivalent")},
    }  # fmt: skip
