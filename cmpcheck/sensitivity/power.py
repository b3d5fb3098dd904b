"""How small a difference the statistical comparisons find: detected fraction over its size, and the cost.

A comparison is one observable at one time: `ensembles.py` judges flatness at several.  Differences have the
shape of those between samples of the reference (the pool of `false_alarms.py`) and the spread that the pilot
of `polish_pair` measured between the engines; a shift is added to them.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from cmpcheck.engines import make_engine
from cmpcheck.ensembles import resolutions
from cmpcheck.observables import OBSERVABLES, TIMES, Observable, judged_frames, margins
from cmpcheck.planning import FEWEST, QUANTITIES, pairs_to_run, pilot_spreads, upper_limit
from cmpcheck.pool import run_tasks
from cmpcheck.sensitivity.false_alarms import ALPHA, CASE, ENGINE, FIRST, SAMPLES, Progress, make_pool
from cmpcheck.sensitivity.store import Store
from cmpcheck.statistics import control_family, paired_difference, sample_size
from reference.case import load_case
from reference.ensemble import sample_case
from reference.process import build_setup

KIND, COST = "power", "cost"
EFFECTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0)  # true difference over the margin
TRIALS, RESAMPLES = 400, 999
OTHERS = QUANTITIES - 1  # beside the one that differs, in its family; they have no difference
COSTED = 3  # samples whose cost is measured


def keep(store: Store, jobs: int, progress: Progress) -> None:
    """The curves of every comparison with few and with many pairs, and the cost of a pair."""
    pool = make_pool(store, SAMPLES["full"], jobs, progress)
    tasks = [(pool[o.quantity], o.quantity, k, n) for o, k in compared() for n in pair_numbers().values()]

    def done(task: tuple[np.ndarray, str, int, int]) -> bool:
        return store.get(KIND, _name(*task[1:])) is not None

    left = [task for task in tasks if not done(task)]
    progress("power", len(tasks) - len(left), len(tasks))
    for task, future in run_tasks(_curve, left, jobs):
        store.put(KIND, _name(*task[1:]), future.result())
        progress("power", sum(map(done, tasks)), len(tasks))
    if store.get(COST, "pair") is None:
        store.put(COST, "pair", _cost())


def kept(store: Store) -> dict[str, Any]:
    """What `keep` has found so far: curves in the order of comparisons, pairs by profile, cost of a pair."""
    curves = [
        found
        for o, k in compared()
        for n in pair_numbers().values()
        if (found := store.get(KIND, _name(o.quantity, k, n))) is not None
    ]
    return {"curves": curves, "pairs": pair_numbers(), "seconds": store.get(COST, "pair")} if curves else {}


def _name(quantity: str, k: int, n: int) -> str:
    return f"{quantity} {k} of {TIMES} {n}"


def compared() -> list[tuple[Observable, int]]:
    """Every comparison of `ensembles.py`: the observable, and the number k of its time, k T/TIMES.

    >>> [(o.quantity, k) for o, k in compared()][3:6]
    [('flatness', 4), ('flatness', 5), ('removals', 5)]
    """
    return [(o, k) for o in OBSERVABLES for k in ((TIMES,) if o.relative else range(1, TIMES + 1))]


def pair_numbers() -> dict[str, int]:
    """The pairs that each profile of `compare` runs; `full` as many as the widest spread needs."""
    (case,) = load_case(CASE).variants()
    return {profile: pairs_to_run(case, ENGINE, profile, margins(case, ENGINE)) for profile in FEWEST}


def sampled_differences(values: np.ndarray) -> np.ndarray:
    """Differences of disjoint samples at the judged times, with mean 0, over the widest of their spreads.

    Parameters: values (n, T) of one observable.
    Returns: (n // 2, TIMES); the standard deviation is 1 at the time where it is largest.
    """
    judged = values[:, judged_frames(values.shape[1])]
    half = len(judged) // 2
    d = judged[:half] - judged[half : 2 * half]
    return (d - d.mean(axis=0)) / d.std(axis=0).max()


def _curve(task: tuple[np.ndarray, str, int, int]) -> dict[str, Any]:
    """Fractions of trials that find a difference, call it different, or call it equivalent, by its size.

    The pilot's spread is the largest of the judged times (`Pairs.spread`); the pool tells the others.
    """
    values, quantity, k, n = task
    (case,) = load_case(CASE).variants()
    margin, (pairs, spreads) = margins(case, ENGINE)[quantity], pilot_spreads(case, ENGINE)
    shapes, rng = spreads[quantity] * sampled_differences(values)[:, k - 1], np.random.default_rng(n)
    spread = float(shapes.std())
    points = []
    for effect in EFFECTS:
        counts = dict.fromkeys(("resolved", "different", "equivalent"), 0)
        for _ in range(TRIALS):
            d = rng.choice(shapes, n) + effect * margin
            alone = paired_difference(d, margin, ALPHA, resamples=RESAMPLES)
            # of a family in which nothing else differs: p-values of equal engines are uniform
            others = [replace(alone, p_different=float(p)) for p in rng.random(OTHERS)]
            verdict = control_family([alone, *others])[0]
            counts["resolved"] += verdict.resolved
            counts["different"] += verdict.verdict == "different"
            counts["equivalent"] += verdict.verdict == "equivalent"
        points.append({"effect": effect, **{name: count / TRIALS for name, count in counts.items()}})
    return {
        "quantity": quantity, "time": k / TIMES, "pairs": n, "margin": margin, "spread": spread,
        "needed": sample_size(upper_limit(spread, pairs), margin), "trials": TRIALS, "points": points,
    }  # fmt: skip


def _cost() -> dict[str, float]:
    """CPU seconds of one sample in each engine, at the steps of the comparison: the mean of COSTED."""
    (case,) = load_case(CASE).variants()
    fine, _, soft = resolutions(case, ENGINE, "impulse")
    setups = [build_setup(sample_case(case, FIRST + k)) for k in range(COSTED + 1)]
    seconds = {}
    for name, resolution in (("reference", fine), (ENGINE, soft)):
        engine = make_engine(name)
        if engine.info().available:
            engine.run(setups[0], resolution)  # compiles
            begin = time.process_time()
            for setup in setups[1:]:
                engine.run(setup, resolution)
            seconds[name] = round((time.process_time() - begin) / COSTED, 2)
    return seconds
