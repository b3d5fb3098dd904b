"""The fast stepper beside the plain one, the answer key, for as long as they can be told from chaos.

Each of its loops has rows: that for few particles, and that for many, which takes a minute to compile and is
asked for in the full profile only.  What runs and compares them is used by the tests too.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from cmpcheck.components.row import EPS, count, row
from cmpcheck.components.runs import changed
from cmpcheck.results import Comparison
from reference.case import Case, load_case
from reference.fast.swarm import MANY
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup
from reference.timestep import ROUNDINGS

CASE_OF = "polish_pair"
STEPS, STEPS_OF_MANY = 1000, 800
SEED = 11  # of the nudges
VARIANT, VARIANT_OF_MANY = "polishing by both steppers", "polishing with many particles by both steppers"
LOW = 1.2e-6  # height of the pad, m
COARSER = 4  # times the distance of nodes, then 2 um
FAST_PAD = 3.0  # m/s: some particles reach Re > 1, where drag is not linear
Rows = Counter[tuple[int, int, int, int]]  # of a ledger: step, kind, i and j


def checks() -> list[Comparison]:
    """Rows of the first steps of polishing under a low pad, by the loop for few particles."""
    case = changed(CASE_OF, pad={"initial_height": LOW, "speed": FAST_PAD})
    return _beside(shortened(case, STEPS), STEPS, VARIANT)


def checks_of_many() -> list[Comparison]:
    """Rows of the first steps of polishing with as few particles as the loop for many moves.

    The surface's triangles are larger than particles: several touch one that falls, which it has to see.
    """
    case = crowded(MANY, {"pad": {"initial_height": LOW, "speed": FAST_PAD}}, coarser=COARSER)
    return _beside(shortened(case, STEPS_OF_MANY), STEPS_OF_MANY, VARIANT_OF_MANY)


def crowded(particles: int, changes: dict[str, dict], coarser: int = 1) -> Case:
    """The case with as many particles on a layer as dense, and other entries in some of its sections.

    Nodes of its surface are `coarser` times as far apart.
    """
    (case, *_) = load_case(CASE_OF).variants()
    assert case.particles is not None
    assert case.surface.nodes is not None
    spacing = case.surface.size / case.surface.nodes
    nodes = round(case.surface.nodes * np.sqrt(particles / case.particles.count))
    layer = {
        "particles": {"count": particles},
        "surface": {"size": nodes * spacing, "nodes": nodes // coarser},
    }
    return case.replaced(layer | changes)


def shortened(case: Case, steps: int) -> Setup:
    """The case set up to end after so many steps, with one output on the way."""
    setup = build_setup(case)
    end = steps * setup.time_step
    return replace(setup, end_time=end, output_times=np.array([0.0, 0.4 * end, end]))


def nudged(setup: Setup) -> Setup:
    """The same with positions and velocities changed by one unit in the last place."""
    rng, state = np.random.default_rng(SEED), setup.state

    def nudge(values: np.ndarray) -> np.ndarray:
        return values * (1.0 + EPS * rng.choice([-1, 1], values.shape))

    return replace(
        setup, state=replace(state, position=nudge(state.position), velocity=nudge(state.velocity))
    )


def with_stepper(setup: Setup, stepper: str) -> Setup:
    """The same, run by another stepper."""
    numerics = setup.case.numerics.model_copy(update={"stepper": stepper})
    return replace(setup, case=setup.case.model_copy(update={"numerics": numerics}))


def apart(a: np.ndarray, b: np.ndarray, period: float = np.inf) -> float:
    """The largest difference of two arrays, to the nearest image where they are periodic."""
    away = np.abs(a - b)
    return float(np.minimum(away, np.abs(period - away)).max())


def allowed(steps: int, plain: np.ndarray, twin: np.ndarray, size: float, period: float = np.inf) -> float:
    """By how much two right programs may differ after so many steps.

    A step rounds each component less than ROUNDINGS times, by eps of its size (`timestep.round_off`), as
    nudging the start by eps does once, and what is rounded later has less time to grow.  Two right programs
    so differ by less than 2 ROUNDINGS times the steps times what a nudged twin of the plain one does, which
    can show no less than eps of the `size` of what is compared.
    """
    return 2.0 * ROUNDINGS * steps * max(apart(plain, twin, period), EPS * size)


def _beside(setup: Setup, steps: int, variant: str) -> list[Comparison]:
    """Positions, velocities, masses, removal and contacts, by the plain and by the fast stepper."""
    plain, fast, twin = map(simulate_setup, (setup, with_stepper(setup, "fast"), nudged(setup)))
    period = setup.model.length_x
    reason = f"2 x {ROUNDINGS} roundings x {steps} steps, times what rounding the start makes of it"

    def compared(name: str, unit: str, values: list[np.ndarray], period: float = np.inf) -> Comparison:
        ours, theirs, twins = values
        size = period if np.isfinite(period) else float(np.abs(ours).max())
        bound, found = allowed(steps, ours, twins, size, period), apart(ours, theirs, period)
        return row(f"fast_{name}", "", found, 0.0, bound, reason, unit, variant=variant)

    runs = (plain, fast, twin)
    lists = [_rows(run, setup.time_step) for run in (plain, fast)]
    missed = (lists[0] - lists[1]).total() + (lists[1] - lists[0]).total()
    return [
        compared("position", "m", [run.positions for run in runs], period),
        compared("velocity", "m/s", [run.velocities for run in runs]),
        compared("mass", "kg", [run.masses for run in runs]),
        compared("height", "m", [_z(run) for run in runs]),
        *(
            count(
                f"fast_{name}", "", fast.history[name].iloc[-1], plain.history[name].iloc[-1],
                "as many as the plain one finds", variant,
            )
            for name in ("contacts", "removals")
        ),
        count("fast_ledger", "", missed, 0, "rows of either ledger that the other has not", variant),
    ]  # fmt: skip


def _z(run: Run) -> np.ndarray:
    assert run.surface is not None
    return run.surface.z


def _rows(run: Run, dt: float) -> Rows:
    """Who meets whom in which step."""
    found = run.contacts
    steps = np.rint(found["time"] / dt).astype(int)
    return Counter(zip(steps, found["kind"], found["i"], found["j"], strict=True))
