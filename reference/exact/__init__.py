"""Solutions known independently of the model: what the reference and every engine are judged by.

Derived from conservation laws phase by phase, geometry, quadrature, root finding and ODE integration.
Nothing here is imported from the model's files (contact, drag, removal, heightfield, timestep), and
no comparison is made here.  SI floats throughout; vectors have shape (3,).
"""

from reference.exact.adaptive import AdaptiveRun, adaptive_stokes
from reference.exact.collision import (
    NormalImpact,
    PairCollision,
    PairTrajectory,
    Sphere,
    SphereTouch,
    first_touch,
    normal_impact,
    pair_collision,
    pair_trajectory,
)
from reference.exact.deposit import flatness, lowered
from reference.exact.dragged import DraggedCollision, NoTouch, dragged_collision, impact_in_flow
from reference.exact.flow import (
    DragMotion,
    couette_motion,
    drag_coefficient,
    drag_motion,
    fixed_point_ratio,
    implicit_euler_speed,
    stokes_motion,
    stokes_time,
    terminal_slips,
)
from reference.exact.hertz import (
    ElasticImpact,
    damping_ratio,
    fastest_return,
    hertz_impact,
    spring_impact,
)
from reference.exact.indent import (
    Removal,
    cap_depth,
    cap_volume,
    point_load_stress,
    removal,
    tensor_von_mises,
    yield_radius,
)
from reference.exact.oblique import Law, Rebound, oblique_impact, sliding, sliding_angle
from reference.exact.pad import Pad, PadImpact, between_wall_and_pad
from reference.exact.struck import Struck, resting_struck
from reference.exact.touch import (
    SurfaceTouch,
    broken_line,
    drop_onto_heightfield,
    meet_heightfield,
    meet_plane,
)
from reference.exact.train import BounceTrain, arrival, bounce_train
from reference.exact.wall import (
    Wall,
    WallImpact,
    hertz_duration,
    hertz_integral,
    removing_impact,
    wall_impact,
)
from reference.exact.wear import (
    finnie_angle,
    finnie_contact,
    finnie_contact_excess,
    finnie_contact_quadrature,
    finnie_impact,
)

__all__ = [
    "AdaptiveRun",
    "BounceTrain",
    "DragMotion",
    "DraggedCollision",
    "ElasticImpact",
    "Law",
    "NoTouch",
    "NormalImpact",
    "Pad",
    "PadImpact",
    "PairCollision",
    "PairTrajectory",
    "Rebound",
    "Removal",
    "Sphere",
    "SphereTouch",
    "Struck",
    "SurfaceTouch",
    "Wall",
    "WallImpact",
    "adaptive_stokes",
    "arrival",
    "between_wall_and_pad",
    "bounce_train",
    "broken_line",
    "cap_depth",
    "cap_volume",
    "couette_motion",
    "damping_ratio",
    "drag_coefficient",
    "drag_motion",
    "dragged_collision",
    "drop_onto_heightfield",
    "fastest_return",
    "finnie_angle",
    "finnie_contact",
    "finnie_contact_excess",
    "finnie_contact_quadrature",
    "finnie_impact",
    "first_touch",
    "fixed_point_ratio",
    "flatness",
    "hertz_duration",
    "hertz_impact",
    "hertz_integral",
    "impact_in_flow",
    "implicit_euler_speed",
    "lowered",
    "meet_heightfield",
    "meet_plane",
    "normal_impact",
    "oblique_impact",
    "pair_collision",
    "pair_trajectory",
    "point_load_stress",
    "removal",
    "removing_impact",
    "resting_struck",
    "sliding",
    "sliding_angle",
    "spring_impact",
    "stokes_motion",
    "stokes_time",
    "tensor_von_mises",
    "terminal_slips",
    "wall_impact",
    "yield_radius",
]
