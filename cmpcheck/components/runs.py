"""Short runs of the reference that no case compares: the paper's scheme, and the books of polishing."""

from __future__ import annotations

import contextlib
import tempfile
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np

from cmpcheck.components.row import EPS, ROUNDING, count, row, worst
from cmpcheck.results import Comparison
from reference import exact
from reference.balances import balances
from reference.case import Case, load_case
from reference.exact.adaptive import iterate
from reference.process import build_setup, relaxation_time
from reference.simulation import SimulationError, simulate, simulate_setup

SHORTEST = 0.05  # of the largest step: the shortest that one rejection leads to
# Starts against the flow, over its speed.  Where the sphere comes to rest the step shrinks; from the second
# start so much that Phi of what follows is above its cap of 2
STARTS = ((1.0, "adaptive steps through rest"), (0.53, "adaptive steps that grow as fast as they may"))


def changed(name: str, **sections: dict[str, Any]) -> Case:
    """The first variant of a case that ships, with other entries in some of its sections."""
    (case, *_) = load_case(name).variants()
    parts = {key: getattr(case, key).model_copy(update=entries) for key, entries in sections.items()}
    return case.model_copy(update=parts)


def checks() -> list[Comparison]:
    """Adaptive steps in a flow and on a wall; the first microseconds of polishing, by both deposits."""
    paper = {"scheme": "fixed_point", "time_step": 100e-9}
    flow = changed("drag_relaxation", numerics=paper, case={"outputs": 2})
    wall = changed("bounce_train", numerics=paper, case={"duration": 1.2e-6, "outputs": 2})
    short = {"duration": 10e-6, "outputs": 2}
    return [
        _first_step(load_case("drag_relaxation")),
        *_struck_in_flow(load_case("pair_drag")),
        *_adaptive(flow, 0.0, "adaptive steps in a flow"),
        *(found for start, place in STARTS for found in _adaptive(flow, start, place)),
        *_swarm(),
        _resumed(changed("polish_pair", case={"duration": 2e-6, "outputs": 5})),
        *_books(wall, "adaptive steps on a wall"),
        *_books(changed("polish_pair", case=short), "polishing by depth"),
        *_books(changed("polish_pair", case=short, removal={"deposit": "volume"}), "polishing by volume"),
    ]


def _first_step(case: Case) -> Comparison:
    """The way of a sphere in one step in a uniform flow at Re <= 1: dt v', with the velocity after the drag.

    Implicit Euler is what the iterates of the paper's scheme tend to; at q = dt/tau = 0.02 sixty are enough.
    """
    setup = build_setup(case)
    state, model, step = setup.state, setup.model, setup.time_step
    run = simulate_setup(replace(setup, end_time=step, output_times=np.array([0.0, step])))
    flow = np.array([model.flow_x, model.flow_y, model.flow_z])
    way = step * iterate(state.velocity[0], flow, step / relaxation_time(setup), 60)
    rounding = EPS * float(np.abs(run.positions).max()) / float(np.abs(way).max())
    return worst(
        "way", "37-39", run.positions[1, 0] - run.positions[0, 0], way, "m", ROUNDING + rounding,
        "rounding, 1000 eps, and that of positions", "the first step in a flow",
    )  # fmt: skip


def _struck_in_flow(case: Case) -> list[Comparison]:
    """One step of two spheres that touch already: what drag adds to impulse and friction, to rounding."""
    setup = build_setup(case)
    model, state, step = setup.model, setup.state, setup.time_step
    radii, normal = state.diameter / 2, np.array([0.6, 0.48, 0.64])
    apart = float(radii.sum()) * (1.0 - 1e-9) * normal
    touching = replace(state, position=np.array([state.position[0], state.position[0] + apart]))
    run = simulate_setup(
        replace(setup, state=touching, end_time=step, output_times=np.array([0.0, step])),
    )
    flow = np.array([model.flow_x, model.flow_y, model.flow_z])
    hit = exact.impact_in_flow(
        tuple(state.mass), tuple(radii), touching.position, state.velocity, flow, model.viscosity,
        model.impact_duration, model.restitution, model.dynamic_friction,
    )  # fmt: skip
    found = run.contacts.iloc[0]
    place, friction = "struck in a flow", float(np.linalg.norm(hit.friction_impulse))
    pairs = [("normal_impulse", "9", hit.normal_impulse), ("friction_impulse", "14-17", friction)]
    return [
        worst(name, equations, np.array([found[name]]), np.array([value]), "N s", variant=place)
        for name, equations, value in pairs
    ]


def _adaptive(case: Case, upstream: float, place: str) -> list[Comparison]:
    """Steps taken and rejected, and the velocity that they lead to.

    Parameters: upstream, speed of the start against the flow, over the flow's; 0 for the start of the case.
    """
    setup = build_setup(case)
    model, state = setup.model, setup.state
    flow = np.array([model.flow_x, model.flow_y, model.flow_z])
    velocity = -upstream * flow if upstream else state.velocity[0]
    setup = replace(setup, state=replace(state, velocity=velocity[np.newaxis].copy()))
    expected = exact.adaptive_stokes(
        setup.output_times[1:].tolist(), velocity, flow, relaxation_time(setup), setup.time_step,
        case.numerics.tolerance, case.numerics.iterations,
    )  # fmt: skip
    run = simulate_setup(setup)
    reason = "counted with the iterates in closed form"
    # positions up to L round an increment TOL way by eps L, and Phi with it; no step is below SHORTEST
    way = SHORTEST * setup.time_step * float(np.linalg.norm(velocity))
    rounding = EPS * model.length_x / (case.numerics.tolerance * way)
    return [
        count("steps", "39-43", run.provenance["steps"], expected.accepted, reason, place),
        count("rejected_steps", "42, 43", run.provenance["rejected_steps"], expected.rejected, reason, place),
        worst(
            "velocity", "37-39", run.velocities[-1, 0], expected.velocity, "m/s", rounding,
            "rounding of positions, eps L/(TOL way), in the lengths of the steps", place,
        ),
    ]  # fmt: skip


def _swarm() -> list[Comparison]:
    """Contacts with a list of neighbours that is kept as long as it may be, and with one made every 2 ns."""
    kept, anew = (simulate(changed("swarm", case={"outputs": outputs})) for outputs in (2, 501))
    meetings = [Counter(zip(run.contacts["i"], run.contacts["j"], strict=True)) for run in (kept, anew)]
    missed = (meetings[1] - meetings[0]).total() + (meetings[0] - meetings[1]).total()
    periods = np.array([kept.case.surface.size, kept.case.surface.size, kept.case.surface.height])
    outside = int(((anew.positions < 0.0) | (anew.positions >= periods)).sum())
    return [
        count("missed_contacts", "9", missed, 0, "of either run", "list of neighbours"),
        count("positions_outside", "", outside, 0, "coordinates beyond the periodic box", "swarm"),
    ]


class _Killed(Exception):
    """What ends a run in the middle."""


def _resumed(case: Case) -> Comparison:
    """A run that is killed halfway and goes on is the same to the bit: arrays, contacts and books."""

    def kill(done: float) -> None:
        if done >= 0.5:
            raise _Killed

    whole = simulate(case)
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        with contextlib.suppress(_Killed):
            simulate(case, folder, kill, checkpoint_interval=0.0)
        again = simulate(case, folder, resume=True)
        names = ("times", "positions", "velocities", "masses")
        wrong = sum(not np.array_equal(getattr(whole, name), getattr(again, name)) for name in names)
        wrong += not whole.contacts.equals(again.contacts)
        wrong += not whole.history.equals(again.history)
    return count("changed_records", "", wrong, 0, "of arrays, contacts and history", "killed and resumed")


def _books(case: Case, place: str) -> list[Comparison]:
    """Every balance of a run, each within the bound of its round-off."""
    try:
        run = simulate(case)
    except SimulationError as problem:
        run = problem.run
    removals = int(run.history["removals"].iloc[-1])
    adapts = case.numerics.scheme == "fixed_point"
    tested = removals > 0 and (not adapts or run.provenance["rejected_steps"] > 0)
    rows = [
        row(
            f"balance_of_{balance.name}", EQUATIONS[balance.name], balance.residual, 0.0, balance.bound,
            "bound of the rounding error of the run", balance.unit, variant=place,
        )
        for balance in balances(run)
    ]  # fmt: skip
    return [*rows, count("books_tested", "", tested, 1, "removals, and rejected steps if any can be", place)]


EQUATIONS = {
    "energy": "3-9, 20-31", "momentum_x": "3, 12, 24", "momentum_y": "3, 12, 24", "momentum_z": "3, 12, 24",
    "mass": "36", "removed_mass": "36", "volume": "35, 36",
}  # fmt: skip
