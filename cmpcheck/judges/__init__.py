"""Which judge a case needs, told from its structure, so that a user's own case is judged like ours."""

from __future__ import annotations

from cmpcheck.judges.drag import DragJudge
from cmpcheck.judges.pair import PairJudge
from cmpcheck.judges.protocol import Judge, Measured
from cmpcheck.judges.swarm import SwarmJudge
from cmpcheck.judges.train import TrainJudge
from cmpcheck.judges.wall import WallJudge
from reference.case import CaseError
from reference.state import FLOW_COUETTE, FLOW_NONE, FLOW_UNIFORM, Setup

__all__ = ["Judge", "Measured", "judge_of"]


def judge_of(setup: Setup) -> Judge:
    """The judge of a setup.  Raises CaseError for a kind of case that nothing is known about."""
    model, particles = setup.model, len(setup.state.mass)
    explicit = bool(setup.case.particle)
    drags, wall = model.flow != FLOW_NONE, model.has_surface
    if not model.has_pad:
        if explicit and ((drags and not wall) or model.flow == FLOW_COUETTE):
            return DragJudge(setup)
        if explicit and particles == 2 and not wall:
            return PairJudge(setup)
        if explicit and particles == 1 and wall and not drags:
            return WallJudge(setup)
        if (
            explicit
            and particles == 1
            and wall
            and model.flow == FLOW_UNIFORM
            and not setup.state.heights.any()
        ):
            return TrainJudge(setup)
        if not drags and not wall:
            return SwarmJudge(setup)
    raise CaseError(
        f"{setup.case.name}: no comparison is known for this kind of case; allowed: two spheres without a "
        "wall, one sphere and a wall (with a uniform flow: a flat one), spheres in a flow away from walls, "
        "a swarm without either"
    )
