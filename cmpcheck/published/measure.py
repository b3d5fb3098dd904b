"""What came out of a scene: restitution, spin, rebound, depth, force and duration, member by member.

What they have to be is `targets.py`.
"""

from __future__ import annotations

import numpy as np

from cmpcheck.published.benchmark import Benchmark
from cmpcheck.published.scene import PHASES, After, Scene, separation
from reference.exact.oblique import INERTIA

Measured = dict[tuple[str, int], np.ndarray]  # (quantity, member) -> (PHASES,)


def measure(benchmark: Benchmark, scene: Scene, after: After) -> Measured:
    """Every quantity of every member, in each copy.

    Raises ValueError for numbers that are not finite, and where two bodies still touch.
    """
    for name in ("position", "velocity", "spin"):
        if not np.isfinite(getattr(after, name)).all():
            raise ValueError(f"{name}: not every number is finite")
    gap, before = separation(scene, after.position), separation(scene, scene.position)
    if gap.min() <= 0.0:
        raise ValueError(f"{np.sum(gap <= 0.0)} of {len(gap)} particles still touch at the end of the run")
    n = (1 + scene.pairs) * PHASES
    out: Measured = {}
    for member in range(len(gap) // n):
        rows = slice(member * n, (member + 1) * n, 1 + scene.pairs)
        part = _measure_member(benchmark, scene, after, gap, before, rows, member)
        out |= {(key, member): values for key, values in part.items()}
    return out


def _measure_member(
    benchmark: Benchmark, scene: Scene, after: After, gap: np.ndarray, before: np.ndarray, rows: slice, k: int
) -> dict[str, np.ndarray]:
    v, v_0, kind = after.velocity[rows], scene.velocity[rows], benchmark.sweep.kind
    if scene.pairs:
        partner = slice(rows.start + 1, rows.stop, rows.step)
        approach = v_0[:, 0] - scene.velocity[partner][:, 0]
        leaving = after.velocity[partner][:, 0] - v[:, 0]
    else:
        approach, leaving = -v_0[:, 2], v[:, 2]
    found = {"restitution": leaving / approach}
    if kind == "normal":
        time = scene.steps * scene.time_step
        found["deepest_approach"] = after.deepest[rows]
        found["largest_force"] = after.force[rows]
        found["contact_duration"] = time - before[rows] / approach - gap[rows] / leaving
    elif kind == "spin":
        found["tangential_velocity"] = np.hypot(v[:, 1], v[:, 2])
        found["spin"] = after.spin[rows][:, 2]
    elif kind != "restitution":
        r, tangential = scene.radius, v_0[:, 0]
        spin = after.spin[rows][:, 1]
        along = v[:, 0] - (r * spin if benchmark.rebound == "contact" else 0.0)
        found["tangential_restitution"] = v[:, 0] / tangential
        found["spin"] = spin
        found["normalised_spin"] = r * spin / (benchmark.friction * approach)
        found["rebound_angle"] = np.degrees(np.arctan2(along, leaving))
        # torque's impulse over the impulse of friction times r
        found["friction_arm"] = INERTIA * r * spin / (tangential - v[:, 0])
    return found
