"""The fast stepper beside the plain one, the answer key, for as long as they can be told from chaos."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmpcheck.components.row import EPS, count, row
from cmpcheck.components.runs import changed
from cmpcheck.results import Comparison
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate_setup
from reference.state import Setup
from reference.timestep import ROUNDINGS

CASE_OF = "polish_pair"
STEPS = 1000
SEED = 11  # of the nudges
VARIANT = "polishing by both steppers"


def checks() -> list[Comparison]:
    """Positions, velocities, removal and contacts of the first steps of polishing under a low pad.

    A step rounds each component less than ROUNDINGS times, by eps of its size (`timestep.round_off`), as
    nudging the start by eps does once, and what is rounded later has less time to grow.  Two right programs
    so differ by less than 2 ROUNDINGS times the steps times what a nudged twin of the plain one does.
    """
    setup = build_setup(changed(CASE_OF, pad={"initial_height": 1.2e-6}))
    end = STEPS * setup.time_step
    setup = replace(setup, end_time=end, output_times=np.array([0.0, end]))
    plain, fast, twin = (simulate_setup(one) for one in (setup, _fast(setup), _nudged(setup)))
    runs = (plain, fast, twin)
    period = setup.model.length_x
    return [
        _apart("fast_position", "m", period, [run.positions for run in runs], period),
        _apart("fast_velocity", "m/s", np.abs(plain.velocities).max(), [run.velocities for run in runs]),
        _apart("fast_height", "m", _z(plain).max(), [_z(run) for run in runs]),
        *(
            count(
                f"fast_{name}", "", fast.history[name].iloc[-1], plain.history[name].iloc[-1],
                "as many as the plain one finds", VARIANT,
            )
            for name in ("contacts", "removals")
        ),
    ]  # fmt: skip


def _z(run: Run) -> np.ndarray:
    assert run.surface is not None
    return run.surface.z


def _apart(
    quantity: str, unit: str, size: float, found: Sequence[np.ndarray], period: float = np.inf
) -> Comparison:
    """The largest difference of the fast from the plain one, beside the twin's; `size` is that of its eps."""
    plain, fast, twin = found

    def largest(values: np.ndarray) -> float:
        away = np.abs(values - plain)
        return float(np.minimum(away, np.abs(period - away)).max())

    bound = 2.0 * ROUNDINGS * STEPS * max(largest(twin), EPS * float(size))
    reason = f"2 x {ROUNDINGS} roundings x {STEPS} steps, times what rounding the start makes of it"
    return row(quantity, "", largest(fast), 0.0, bound, reason, unit, variant=VARIANT)


def _fast(setup: Setup) -> Setup:
    numerics = setup.case.numerics.model_copy(update={"stepper": "fast"})
    return replace(setup, case=setup.case.model_copy(update={"numerics": numerics}))


def _nudged(setup: Setup) -> Setup:
    """The same with positions and velocities changed by one unit in the last place."""
    rng, state = np.random.default_rng(SEED), setup.state

    def nudge(values: np.ndarray) -> np.ndarray:
        return values * (1.0 + EPS * rng.choice([-1, 1], values.shape))

    return replace(
        setup, state=replace(state, position=nudge(state.position), velocity=nudge(state.velocity))
    )
