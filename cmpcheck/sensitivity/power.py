"""How small a difference the statistical comparisons find: detected fraction over its size, and the cost.

Differences have the shape of those between samples of the reference (the pool of `false_alarms.py`) and the
spread that the pilot of `polish_pair` measured between the engines; a shift is added to them.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from cmpcheck.engines import make_engine
from cmpcheck.ensembles import resolutions
from cmpcheck.observables import OBSERVABLES, judged_frames, margins
from cmpcheck.planning import FEWEST, pilot_spreads, upper_limit
from cmpcheck.pool import run_tasks
from cmpcheck.sensitivity.false_alarms import ALPHA, CASE, ENGINE, FIRST, SAMPLES, Progress, make_pool
from cmpcheck.sensitivity.store import Store
from cmpcheck.statistics import control_family, paired_difference, sample_size
from reference.case import load_case
from reference.ensemble import sample_case
from reference.process import build_setup

KIND = "power"
EFFECTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0)  # true difference over the margin
TRIALS, RESAMPLES = 200, 999
OTHERS = 7  # quantities beside the one that differs in the family of eight; they have no difference


def keep(store: Store, jobs: int, progress: Progress) -> None:
    """The curves of every observable with few and with many pairs, and the cost of a pair."""
    pool = make_pool(store, SAMPLES["full"], jobs, progress)
    sizes = pair_numbers()
    tasks = [(pool[o.quantity], o.quantity, n) for o in OBSERVABLES for n in sizes]
    left = [task for task in tasks if store.get(KIND, f"{task[1]} {task[2]}") is None]
    progress("power", len(tasks) - len(left), len(tasks))
    for task, future in run_tasks(_curve, left, jobs):
        store.put(KIND, f"{task[1]} {task[2]}", future.result())
        progress(
            "power", len(tasks) - sum(store.get(KIND, f"{t[1]} {t[2]}") is None for t in tasks), len(tasks)
        )
    if store.get("cost", "pair") is None:
        store.put("cost", "pair", _cost())


def pair_numbers() -> list[int]:
    """The quick profile's pairs, and as many as the full profile runs: what the widest spread needs."""
    return [FEWEST["quick"], max(FEWEST["full"], *(row["needed"] for row in needed_pairs()))]


def needed_pairs() -> list[dict[str, Any]]:
    """For each observable, the spread of its paired differences and the pairs for a power of 90 %."""
    (case,) = load_case(CASE).variants()
    pairs, spreads = pilot_spreads(case, ENGINE)
    limits = margins(case, ENGINE)
    return [
        {
            "quantity": quantity, "spread": spread, "assumed": upper_limit(spread, pairs),
            "margin": limits[quantity], "needed": sample_size(upper_limit(spread, pairs), limits[quantity]),
        }
        for quantity, spread in spreads.items()
    ]  # fmt: skip


def standard_differences(values: np.ndarray) -> np.ndarray:
    """Differences of disjoint samples at the last judged time, with mean 0 and standard deviation 1.

    Parameters: values (n, T) of one observable.
    """
    last = values[:, judged_frames(values.shape[1])[-1]]
    half = len(last) // 2
    d = last[:half] - last[half : 2 * half]
    return (d - d.mean()) / d.std()


def _curve(task: tuple[np.ndarray, str, int]) -> dict[str, Any]:
    """Fractions of trials that find a difference, call it different, or call it equivalent, by its size."""
    values, quantity, n = task
    (case,) = load_case(CASE).variants()
    margin, spread = margins(case, ENGINE)[quantity], pilot_spreads(case, ENGINE)[1][quantity]
    shapes, rng = standard_differences(values), np.random.default_rng(n)
    points = []
    for effect in EFFECTS:
        counts = dict.fromkeys(("resolved", "different", "equivalent"), 0)
        for _ in range(TRIALS):
            d = spread * rng.choice(shapes, n) + effect * margin
            alone = paired_difference(d, margin, ALPHA, resamples=RESAMPLES)
            # of a family in which nothing else differs: p-values of equal engines are uniform
            others = [replace(alone, p_different=float(p)) for p in rng.random(OTHERS)]
            verdict = control_family([alone, *others])[0]
            counts["resolved"] += verdict.resolved
            counts["different"] += verdict.verdict == "different"
            counts["equivalent"] += verdict.verdict == "equivalent"
        points.append({"effect": effect, **{name: count / TRIALS for name, count in counts.items()}})
    return {
        "quantity": quantity, "pairs": n, "margin": margin, "spread": spread, "trials": TRIALS,
        "points": points,
    }  # fmt: skip


def _cost() -> dict[str, float]:
    """Seconds that one sample takes in each engine, at the steps of the comparison."""
    (case,) = load_case(CASE).variants()
    fine, _, soft = resolutions(case, ENGINE, "impulse")
    setup, seconds = build_setup(sample_case(case, FIRST)), {}
    for name, resolution in (("reference", fine), (ENGINE, soft)):
        engine = make_engine(name)
        if engine.info().available:
            engine.run(setup, resolution)  # compiles
            begin = time.perf_counter()
            engine.run(setup, resolution)
            seconds[name] = round(time.perf_counter() - begin, 2)
    return seconds
