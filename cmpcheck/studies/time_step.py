"""Convergence in the time step: flatness, removals and volume against gamma, under both rules of removal.

A particle wedged between pad and flank, pressed by the flow, is struck at every second step for as long as it
stays: the number of those impacts is set by the step.  With `removal.new_contacts_only` they remove nothing.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from cmpcheck.display import uncertain
from cmpcheck.observables import TIMES, judged_frames
from cmpcheck.results import Chart, Column, Estimate, StudyResult, Table
from cmpcheck.statistics import relative_differences
from cmpcheck.studies.sampling import (
    CONVERGED,
    DIFFERENT,
    changed,
    clear,
    estimate,
    held,
    samples_of,
    standing,
)
from cmpcheck.studies.sweep import RELATIVE, Found, Setting, curve, sweep, sweep_table
from reference import simulate
from reference.case import Case, load_case
from reference.process import build_setup, pressed_speed

CASE, EXAMPLE = "polish_pair", "polish"
GAMMAS = (0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125)
SLOW_GAMMAS = (0.01, 0.005, 0.0025, 0.00125, 0.000625)
EXAMPLE_GAMMAS = GAMMAS[:4]  # 10 s a sample at 0.01
SAMPLES = {"quick": 3, "full": 16}
EXAMPLE_SAMPLES = {"quick": 0, "full": 3}
HEIGHT = 1.2e-6  # m: an abrasive does not pass between an asperity and a pad held here
SLOW = {"removal": {"acceleration": 10.0}, "case": {"duration": 250e-6}}
SAME_FLATNESS, SAME_RELATIVE = 0.01, 0.03  # differences that matter to nobody
FLATNESS, AMOUNTS = "Π", "removals and volume"
FLATNESS_AT = [f"flatness {k}/{TIMES}" for k in range(1, TIMES + 1)]  # of the duration
EVERY, NEW = "every impact", "new contacts only"
SHOWN = (("removals", "1", "removals"), ("removed volume", "m3", "removed_volume"))
AGAIN = 2.5  # steps since the last removal by the same particle


class Block(NamedTuple):
    """One setting with one rule, at every step, coarsest first; `found` has a column for Pi at each time."""

    name: str
    rule: str
    found: list[Found]

    @property
    def samples(self) -> int:
        """Seeds."""
        return len(self.found[-1].rows)

    def flatness_changes(self, one: Found) -> list[Estimate]:
        """Changes of Pi to the finest step at the times at which it is judged, by seed."""
        finest = self.found[-1].rows
        return [estimate(one.rows[column] - finest[column]) for column in FLATNESS_AT]

    def standing(self, one: Found, what: str) -> str:
        """Whether Pi, or removals and volume, are at this step what they are at the finest."""
        if what == FLATNESS:
            return standing(self.flatness_changes(one), self.samples, SAME_FLATNESS)
        return standing([one.difference[q] for q in RELATIVE], self.samples, SAME_RELATIVE)

    def converged(self, what: str) -> tuple[Found | None, Found | None]:
        """The coarsest step from which on all are converged, and the next coarser; None if there is none."""
        fine = None
        for one in reversed(self.found[:-1]):
            if self.standing(one, what) != CONVERGED:
                return fine, one
            fine = one
        return fine, None

    @property
    def order(self) -> float | None:
        """The p of differences ∝ dt^p of the removed volume; None unless three are told from none."""
        told = [
            (float(one.setting.cells[3]), abs(change.value))
            for one in self.found[:-1]
            for change in [one.difference["removed_volume"]]
            if clear(change, self.samples)
        ]
        if len(told) < 3:
            return None
        steps, changes = np.log(told).T
        return float(np.polyfit(steps, changes, 1)[0])

    @property
    def change(self) -> Estimate:
        """The largest relative change of removals when a step is halved."""
        counts = [one.rows["removals"] for one in self.found]
        changes = [estimate(relative_differences(b, a)) for a, b in itertools.pairwise(counts)]
        return max(changes, key=lambda change: abs(change.value))


def study(profile: str, runs: Path) -> StudyResult:
    """Flatness, removals and volume against the time step, with both rules of removal."""
    (case,), (example,) = load_case(CASE).variants(), load_case(EXAMPLE).variants()
    n, few = SAMPLES[profile], EXAMPLE_SAMPLES[profile]
    a = case.removal.acceleration if case.removal else 1.0
    at = f"pad held at {HEIGHT * 1e6:g} µm"
    settings = {
        f"pad descends, A = {a:g}": (case, GAMMAS),
        f"{at}, A = {a:g}": (held(case, HEIGHT), GAMMAS),
        f"{at}, A = 10": (held(case, HEIGHT, **SLOW), SLOW_GAMMAS),
    }
    blocks = [
        _block(name, setting, new, gammas, n)
        for name, (setting, gammas) in settings.items()
        for new in (False, True)
    ]
    if few:
        blocks.append(_block(f"{EXAMPLE}, pad descends, A = 100", example, False, EXAMPLE_GAMMAS, few))
    held_blocks = blocks[4:6]
    return StudyResult(
        name="time_step",
        title="The time step, and which impacts remove",
        varied="γ of the time step Δt = γ d/V_pad, and whether a particle that stays in contact goes on "
        "removing. Changes are to the finest step of the same setting and rule, by seed. The pad is held "
        f"at {HEIGHT * 1e6:g} µm, where no abrasive passes over an asperity; at A = 10 it takes 40 times "
        "as many impacts to clear one away as at A = 400.",
        samples=samples_of(case, n) + (f" {samples_of(example, few)}" if few else ""),
        tables=_tables(blocks),
        sentence=_sentence(blocks),
        charts=tuple(
            Chart(
                f"{what.capitalize()} against the time step, {held_blocks[0].name}, ± standard error",
                Column("time step", "s"), Column(what, unit),
                tuple(curve(block.rule, block.found, quantity, 3) for block in held_blocks), logarithmic=True,
            )
            for what, unit, quantity in SHOWN
        ),
    )  # fmt: skip


def last_with_repeats(case: Case) -> pd.Series:
    """The history at the end, and two more.

    Pi at the times at which it is judged, and the share of removals (%) that follow one of the same particle
    at once.
    """
    run = simulate(case)
    removals = run.contacts[run.contacts["removed_volume"] > 0.0].sort_values(["i", "time"])
    since = removals.groupby("i")["time"].diff()
    step = run.times[-1] / run.provenance["steps"]
    again = 100.0 * float((since <= AGAIN * step).mean()) if len(removals) else 0.0
    flat = run.history["flatness"].iloc[judged_frames(len(run.history))].set_axis(FLATNESS_AT)
    return pd.concat([run.history.iloc[-1], flat, pd.Series({"again": again})])


def _block(name: str, case: Case, new_only: bool, gammas: Sequence[float], samples: int) -> Block:
    rule = NEW if new_only else EVERY
    settings = []
    for gamma in gammas:
        changes: dict[str, Any] = {"numerics": {"gamma": gamma}, "removal": {"new_contacts_only": new_only}}
        fine = changed(case, **changes)
        setup = build_setup(fine)
        cells = (name, rule, gamma, setup.time_step, pressed_speed(setup, setup.time_step))
        settings.append(Setting(cells, fine, last_with_repeats))
    return Block(name, rule, sweep(settings, len(settings) - 1, samples))


def _tables(blocks: Sequence[Block]) -> tuple[Table, Table]:
    """All steps, and what they say on convergence."""
    head = (
        Column("setting"),
        Column("removing"),
        Column("gamma"),
        Column("time step", "s"),
        Column("2 U dt/tau", "m/s"),
    )
    steps = sweep_table(
        "Polishing at several time steps, ± standard error", head,
        [one for block in blocks for one in block.found], "the finest",
        {"again": Column("struck again within 2 steps", "%")},
    )  # fmt: skip
    times = tuple(Column(f"at {k}/{TIMES} T") for k in range(1, TIMES + 1))
    said: list[tuple[str | float | Estimate, ...]] = [
        (
            *one.setting.cells[:3], *block.flatness_changes(one),
            *(block.standing(one, what) for what in (FLATNESS, AMOUNTS)),
        )
        for block in blocks
        for one in block.found[:-1]
    ]  # fmt: skip
    judged = Table(
        "Change of Π from the finest step at the times at which it is judged, ± standard error, and answers",
        (*head[:3], *times, Column("Π is"), Column("removals and volume are")),
        tuple(said),
    )
    return steps, judged


def _sentence(blocks: Sequence[Block]) -> str:
    listed = "; ".join(f"{block.name}, {block.rule}: {_standing(block)}" for block in blocks)
    return (
        f"{listed[0].upper()}{listed[1:]}. Converged means that Π at each of {TIMES} equally spaced times is "
        f"within {SAME_FLATNESS:g} of the finest step, and removals and volume within "
        f"{100 * SAME_RELATIVE:.0f} %, as upper bounds; different, that it is farther off, as lower bound "
        f"(both Student's, one-sided, 95 %); not decided, neither: more seeds would tell.{_advice(blocks)}"
    )


def _standing(block: Block) -> str:
    texts = []
    for what in (FLATNESS, AMOUNTS):
        fine, coarser = block.converged(what)
        text = "not shown to converge" if fine is None else f"converged from γ = {_gamma(fine):g} on"
        if coarser is not None:
            text += f" (at {_gamma(coarser):g} {block.standing(coarser, what)}, n = {block.samples})"
        texts.append(f"{what} {text}")
    order = "" if block.order is None else f", volume of order {block.order:.1f}"
    return f"{', '.join(texts)}{order}; at half the step removals change by {_percent(block.change)} at most"


def _advice(blocks: Sequence[Block]) -> str:
    """Where Pi converges with new contacts only, and differs there or at smaller steps with every impact."""
    every = {block.name: block for block in blocks if block.rule == EVERY}
    advice = ""
    for block in blocks:
        fine, other = block.converged(FLATNESS)[0], every[block.name]
        if block.rule == EVERY or fine is None:
            continue
        gamma = _gamma(fine)
        below = [one for one in other.found[:-1] if _gamma(one) <= gamma]
        if any(other.standing(one, FLATNESS) == DIFFERENT for one in below):
            fall = 1.0 - float(block.found[-1].rows[FLATNESS_AT[-1]].mean())
            still, before = _percent(block.change), _percent(other.change)
            advice += (
                f" {block.name[0].upper()}{block.name[1:]}: with removal.new_contacts_only = true Π, which "
                f"falls by {fall:.2g} in all, is converged from γ = {gamma:g} on, where with every impact it "
                f"is not; halving the step changes the removals by up to {still}, {before} with every impact."
            )
    return advice


def _gamma(one: Found) -> float:
    return float(one.setting.cells[2])


def _percent(share: Estimate) -> str:
    return f"({uncertain(*(100.0 * part for part in share))}) %"
