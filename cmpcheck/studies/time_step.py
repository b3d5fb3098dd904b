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

from cmpcheck.results import Chart, Column, StudyResult
from cmpcheck.studies.sampling import changed, held, samples_of
from cmpcheck.studies.sweep import Found, Setting, curve, sweep, sweep_table
from reference import simulate
from reference.case import Case, load_case

CASE, EXAMPLE = "polish_pair", "polish"
GAMMAS = (0.04, 0.02, 0.01, 0.005, 0.0025, 0.00125)
SLOW_GAMMAS = (0.01, 0.005, 0.0025, 0.00125, 0.000625)
EXAMPLE_GAMMAS = GAMMAS[:4]  # 10 s a sample at 0.01
SAMPLES = {"quick": 3, "full": 8}
EXAMPLE_SAMPLES = {"quick": 0, "full": 3}
HEIGHT = 1.2e-6  # m: an abrasive does not pass between an asperity and a pad held here
SLOW = {"removal": {"acceleration": 10.0}, "case": {"duration": 250e-6}}
SAME_FLATNESS, SAME_RELATIVE = 0.01, 0.03  # differences that matter to nobody
SAME_ERRORS = 2.0  # standard errors: a smaller difference is not told from none
EVERY, NEW = "every impact", "new contacts only"
SHOWN = (("removals", "1", "removals"), ("removed volume", "m3", "removed_volume"))
AGAIN = 2.5  # steps since the last removal by the same particle


class Block(NamedTuple):
    """One setting with one rule, at every step."""

    name: str
    rule: str
    found: list[Found]

    def converged(self, *quantities: str) -> float | None:
        """The largest gamma from which on no change of these matters; None if only the finest is left."""
        fine = None
        for one in reversed(self.found[:-1]):
            if not all(_same(one, quantity) for quantity in quantities):
                break
            fine = float(one.setting.cells[2])
        return fine

    @property
    def order(self) -> float | None:
        """The p of differences ∝ dt^p of the removed volume; None unless three are told from none."""
        told = [
            (float(one.setting.cells[3]), abs(change.value))
            for one in self.found
            for change in [one.difference["removed_volume"]]
            if abs(change.value) > SAME_ERRORS * change.standard_error
        ]
        if len(told) < 3:
            return None
        steps, changes = np.log(told).T
        return float(np.polyfit(steps, changes, 1)[0])

    @property
    def change(self) -> float:
        """The largest relative change of removals between a step and the half of it."""
        counts = [one.mean["removals"].value for one in self.found]
        return max(abs(a / b - 1.0) for a, b in itertools.pairwise(counts))


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
    head = [
        Column("setting"),
        Column("removing"),
        Column("gamma"),
        Column("time step", "s"),
        Column("2 U dt/tau", "m/s"),
    ]
    held_blocks = blocks[4:6]
    return StudyResult(
        name="time_step",
        title="The time step, and which impacts remove",
        varied="γ of the time step Δt = γ d/V_pad, and whether a particle that stays in contact goes on "
        "removing. Changes are to the finest step of the same setting and rule, by seed. The pad is held "
        f"at {HEIGHT * 1e6:g} µm, where no abrasive passes over an asperity; at A = 10 it takes 40 times "
        "as many impacts to clear one away as at A = 400.",
        samples=samples_of(case, n) + (f" {samples_of(example, few)}" if few else ""),
        tables=(
            sweep_table(
                "Polishing at several time steps, ± standard error", head,
                [one for block in blocks for one in block.found], "the finest",
                {"again": Column("struck again within 2 steps", "%")},
            ),
        ),
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
    """The history at the end, and the share of removals (%) that follow one of the same particle at once."""
    run = simulate(case)
    removals = run.contacts[run.contacts["removed_volume"] > 0.0].sort_values(["i", "time"])
    since = removals.groupby("i")["time"].diff()
    step = run.times[-1] / run.provenance["steps"]
    again = 100.0 * float((since <= AGAIN * step).mean()) if len(removals) else 0.0
    return pd.concat([run.history.iloc[-1], pd.Series({"again": again})])


def _block(name: str, case: Case, new_only: bool, gammas: Sequence[float], samples: int) -> Block:
    rule = NEW if new_only else EVERY
    diameter, speed = case.particles.mean_diameter, case.pad.speed  # type: ignore[union-attr]
    density = case.material[case.particles.material].density  # type: ignore[union-attr]
    relaxation = density * diameter**2 / (18.0 * case.fluid.viscosity)  # type: ignore[union-attr]
    settings = []
    for gamma in gammas:
        step = gamma * diameter / speed
        changes: dict[str, Any] = {"numerics": {"gamma": gamma}, "removal": {"new_contacts_only": new_only}}
        cells = (name, rule, gamma, step, 2.0 * speed * step / relaxation)
        settings.append(Setting(cells, changed(case, **changes), last_with_repeats))
    return Block(name, rule, sweep(settings, len(settings) - 1, samples))


def _same(one: Found, quantity: str) -> bool:
    """Whether a difference to the finest step does not matter, or is not told from none."""
    change = one.difference[quantity]
    limit = SAME_FLATNESS if quantity == "flatness" else SAME_RELATIVE
    return abs(change.value) <= max(limit, SAME_ERRORS * change.standard_error)


def _sentence(blocks: Sequence[Block]) -> str:
    listed = "; ".join(f"{block.name}, {block.rule}: {_standing(block)}" for block in blocks)
    error = max(one.difference["flatness"].standard_error for block in blocks for one in block.found)
    return (
        f"{listed[0].upper()}{listed[1:]}. Converged means that Π is within {SAME_FLATNESS:g} of the finest "
        f"step, and removals and volume within {100 * SAME_RELATIVE:.0f} %, or within two standard errors "
        f"(of Π at most {error:.3f}).{_advice(blocks)}"
    )


def _standing(block: Block) -> str:
    texts = []
    for what, quantities in (("Π", ("flatness",)), ("removals and volume", ("removals", "removed_volume"))):
        gamma = block.converged(*quantities)
        texts.append(f"{what} not converged" if gamma is None else f"{what} converged from γ = {gamma:g} on")
    order = "" if block.order is None else f", volume of order {block.order:.1f}"
    change = f"at most {100 * block.change:.0f} % more or less at half the step"
    return f"{texts[0]}, {texts[1]}{order} ({change})"


def _advice(blocks: Sequence[Block]) -> str:
    """Where Pi converges with new contacts only, and not or at smaller steps with every impact."""
    every = {block.name: block for block in blocks if block.rule == EVERY}
    advice = ""
    for block in blocks:
        gamma, before = block.converged("flatness"), every[block.name].converged("flatness")
        if block.rule == NEW and gamma is not None and (before or 0.0) < gamma:
            still, earlier = (100 * b.change for b in (block, every[block.name]))
            advice += (
                f" {block.name[0].upper()}{block.name[1:]}: removal.new_contacts_only = true makes Π "
                f"converge from γ = {gamma:g} on; halving the step changes the removals by up to "
                f"{still:.0f} %, {earlier:.0f} % with every impact."
            )
    return advice
