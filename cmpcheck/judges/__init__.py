"""Which judge a case needs, told from its structure, so that a user's own case is judged like ours."""

from __future__ import annotations

import contextlib

from cmpcheck.judges.drag import DragJudge
from cmpcheck.judges.dragged import DraggedPairJudge
from cmpcheck.judges.pad import PadJudge
from cmpcheck.judges.pair import PairJudge
from cmpcheck.judges.protocol import Judge, Measured
from cmpcheck.judges.struck import StruckJudge
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.judges.train import TrainJudge
from cmpcheck.judges.wall import WallJudge
from reference.case import CaseError
from reference.exact import NoTouch
from reference.state import DEPOSIT_NONE, FLOW_COUETTE, FLOW_NONE, FLOW_UNIFORM, Setup

__all__ = ["Judge", "Measured", "judge_of"]


def judge_of(setup: Setup) -> Judge:
    """The judge of a setup.  Raises CaseError for a kind of case that nothing is known about."""
    try:
        judge = _judge_of(setup)
    except ValueError as problem:  # of a closed form that has no solution
        raise CaseError(f"{setup.case.name}: nothing happens that could be compared: {problem}") from None
    if judge is None:
        raise CaseError(
            f"{setup.case.name}: no comparison is known for this kind of case; allowed: two spheres "
            "without a wall, one sphere and a wall (with a uniform flow: a flat one), a sphere that "
            "falls on one that rests on a wall, a sphere between a flat wall and a pad, "
            "spheres in a flow away from walls, a swarm without either"
        )
    return judge


def _judge_of(setup: Setup) -> Judge | None:
    model, particles = setup.model, len(setup.state.mass)
    explicit = bool(setup.case.particle)
    drags, wall, flat = model.flow != FLOW_NONE, model.has_surface, not setup.state.heights.any()
    if model.has_pad:
        alone = explicit and particles == 1 and flat and not drags and model.deposit == DEPOSIT_NONE
        return PadJudge(setup) if alone else None
    if explicit and particles == 2 and not wall and model.flow == FLOW_UNIFORM and model.has_pairs:
        with contextlib.suppress(NoTouch):
            return DraggedPairJudge(setup)
    if explicit and ((drags and not wall) or model.flow == FLOW_COUETTE):
        return DragJudge(setup)
    if explicit and particles == 2 and not wall:
        return PairJudge(setup)
    if explicit and particles == 1 and wall and not drags:
        return WallJudge(setup)
    if explicit and particles == 1 and wall and flat and model.flow == FLOW_UNIFORM:
        return TrainJudge(setup)
    if explicit and particles == 2 and wall and not drags and model.has_pairs:
        return StruckJudge(setup)
    return SwarmJudge(setup) if not drags and not wall else None
