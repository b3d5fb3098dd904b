"""Polishing on finer nodes: the same surface, refined, under both deposit rules.

The refined surface is the same to rounding: nodes are put on the middles of edges and of diagonals.  What
changes is where removal goes: `node_depth` lowers a node, that is a smaller area the finer the nodes are.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from cmpcheck.results import Column, StudyResult
from cmpcheck.studies.sampling import (
    FINE_GAMMA,
    changed,
    clear,
    half_width,
    interval_text,
    samples_of,
    step_text,
)
from cmpcheck.studies.sweep import Found, Setting, sweep, sweep_table
from reference.case import Case, load_case
from reference.process import build_setup
from reference.simulation import simulate_setup

CASE = "polish_pair"
SAMPLES = {"quick": 3, "full": 12}
REFINEMENTS = (1, 2, 4)  # how often finer than the case's n = 20 nodes
VOLUME_FACTOR = 4500.0  # volume takes so much less off than node_depth at n = 20


def refined(heights: np.ndarray) -> np.ndarray:
    """The same periodic surface with twice as many nodes along x and y, heights (2 n_x, 2 n_y).

    >>> refined(np.array([[0.0, 0.0], [0.0, 4.0]]))[2, 1:4].tolist()
    [2.0, 4.0, 2.0]
    """
    right, above = np.roll(heights, -1, axis=0), np.roll(heights, -1, axis=1)
    beyond = np.roll(right, -1, axis=1)  # the diagonal of a square runs from (i, j) to (i+1, j+1)
    fine = np.empty((2 * heights.shape[0], 2 * heights.shape[1]))
    fine[::2, ::2] = heights
    fine[1::2, ::2] = 0.5 * (heights + right)
    fine[::2, 1::2] = 0.5 * (heights + above)
    fine[1::2, 1::2] = 0.5 * (heights + beyond)
    return fine


def last_on_refined(case: Case, finer: int) -> pd.Series:
    """The history at the end of a run whose surface has been refined by a power of two."""
    setup = build_setup(case)
    heights = setup.state.heights
    for _ in range(int(np.log2(finer))):
        heights = refined(heights)
    setup = replace(
        setup,
        state=replace(setup.state, heights=heights),
        model=setup.model._replace(spacing=setup.model.spacing / finer),
    )
    return simulate_setup(setup).history.iloc[-1]


def study(profile: str, runs: Path) -> StudyResult:
    """Flatness, removals and volume on one surface with nodes at three spacings."""
    (plain,) = load_case(CASE).variants()
    case = changed(plain, numerics={"gamma": FINE_GAMMA})
    assert case.removal is not None
    assert case.surface.nodes is not None
    n, a = SAMPLES[profile], case.removal.acceleration
    groups = {
        "node_depth, A as it is": lambda k: {"deposit": "node_depth", "acceleration": a},
        "node_depth, A ∝ n²": lambda k: {"deposit": "node_depth", "acceleration": a * k**2},
        "volume": lambda k: {"deposit": "volume", "acceleration": a * VOLUME_FACTOR},
    }
    found: list[list[Found]] = []
    for name, removal in groups.items():
        settings = []
        for k in REFINEMENTS:
            nodes, part = k * case.surface.nodes, removal(k)
            cells = (name, float(nodes), case.surface.size / nodes, part["acceleration"])
            settings.append(Setting(cells, changed(case, removal=part), partial(last_on_refined, finer=k)))
        found.append(sweep(settings, 0, n))
    return StudyResult(
        name="spacing",
        title="The spacing of the nodes",
        varied="The number of nodes n along each side. The surface is the same in all rows, that of the "
        "case with nodes added on it; what changes is where removal goes. node_depth lowers the nearest "
        f"node, whose share of the area goes as 1/n²; volume, here with an A {VOLUME_FACTOR:g} times as "
        f"large for a similar Π(T), takes a volume off the struck triangle. {step_text(case, plain)}",
        samples=samples_of(case, n),
        tables=(
            sweep_table(
                "One surface with nodes at three spacings, ± standard error",
                [Column("deposit"), Column("n"), Column("spacing", "m"), Column("A")],
                [one for group in found for one in group], f"n = {case.surface.nodes}",
            ),
        ),
        sentence=_sentence(found),
    )  # fmt: skip


def _sentence(found: list[list[Found]]) -> str:
    parts, steady = [], []
    for group in found:
        finest = group[-1]
        change, n = finest.difference["flatness"], len(finest.rows)
        parts.append(
            f"{finest.setting.cells[0]}: Π(T) goes from {group[0].mean['flatness'].value:.3f} to "
            f"{finest.mean['flatness'].value:.3f}, a change of {interval_text(change, n)}"
        )
        if not clear(change, n):
            most = abs(change.value) + half_width(change, n)
            steady.append(f"with {finest.setting.cells[0]}, where it may be up to {most:.2g}")
    first, last = (found[0][k].setting.cells[1] for k in (0, -1))
    advice = (
        f"A dependence of Π on the spacing is not told from none {', and '.join(steady)}"
        if steady
        else "Π depends on the spacing under each of these rules, so that the number of nodes belongs to "
        "the model"
    )
    return f"From n = {first:g} to {last:g}: {'; '.join(parts)} (95 % intervals). {advice}."
