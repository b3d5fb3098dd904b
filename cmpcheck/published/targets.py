"""What must come out of each member of a sweep: closed forms, contact laws integrated, published points.

The formulas are `reference/exact`; here is which of them holds where, and how well each is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from cmpcheck.convergence import Extrapolation, exact
from cmpcheck.published.benchmark import Benchmark, Points
from cmpcheck.published.scene import Contact, normal_speeds, tangential_speeds
from reference.exact import hertz, pair_collision
from reference.exact.oblique import Law, Rebound, oblique_impact, sliding, sliding_angle

# LIGGGHTS turns a sphere by friction at the arm r - d/2, the middle of the overlap; LAMMPS at a wall at r.
SHORTENING = {"lammps": 0.0, "liggghts": 0.5}
INTEGRATED = 1e-7  # of the scale: `oblique_impact` meets the sliding closed form within a hundredth of it


@dataclass(frozen=True)
class Target:
    """One value to compare with."""

    place: str  # appended to the member's name; "" for the only one
    limit: Extrapolation


def law_of(benchmark: Benchmark, contact: Contact, engine: str) -> Law:
    """The contact law as an engine states it."""
    normal, shear = contact.normal / contact.mass, contact.shear / contact.mass
    return Law(
        normal, shear, contact.model == "hertz", contact.friction, contact.restitution, benchmark.radius,
        SHORTENING[engine],
    )  # fmt: skip


def slides(benchmark: Benchmark, contact: Contact, member: int) -> bool:
    """Whether a rigid sphere slides until it leaves."""
    normal, tangential = normal_speeds(benchmark)[member], tangential_speeds(benchmark)[member]
    angle = math.degrees(math.atan2(tangential, normal))
    return angle >= sliding_angle(contact.friction, contact.restitution)


@cache
def integrated(law: Law, normal: float, tangential: float) -> Rebound:
    """The impact by the law; see `oblique_impact`."""
    return oblique_impact(law, normal, tangential)


def rebound_values(benchmark: Benchmark, rebound: Rebound, member: int) -> dict[str, float]:
    """The quantities of an oblique impact that publications state; spin in rad/s, rebound in degrees."""
    normal, tangential = float(normal_speeds(benchmark)[member]), float(tangential_speeds(benchmark)[member])
    along = rebound.contact if benchmark.rebound == "contact" else rebound.tangential * tangential
    return {
        "tangential_restitution": rebound.tangential,
        "spin": rebound.surface_speed / benchmark.radius,
        "normalised_spin": rebound.surface_speed / (benchmark.friction * normal),
        "rebound_angle": math.degrees(math.atan2(along, rebound.normal * normal)),
    }


def impact_targets(benchmark: Benchmark, contact: Contact) -> dict[str, Target]:
    """Extremes of an elastic normal impact: Hertz's, or those of a spring."""
    found = contact.impact(contact.speed)
    values = {
        "deepest_approach": found.deepest,
        "largest_force": found.force,
        "contact_duration": found.duration,
        "restitution": contact.restitution,
    }
    return {key: Target("", exact(value)) for key, value in values.items()}


def oblique_target(
    benchmark: Benchmark, contact: Contact, engine: str, quantity: str, member: int, scale: float
) -> Target:
    """The closed form of sliding to the end, and below it the contact law integrated."""
    normal, tangential = float(normal_speeds(benchmark)[member]), float(tangential_speeds(benchmark)[member])
    law = law_of(benchmark, contact, engine)
    by_law = integrated(law, normal, tangential)
    value = rebound_values(benchmark, by_law, member)[quantity]
    arm = ", friction at the arm r - d/2" if law.shortening else ""
    if not slides(benchmark, contact, member):
        reason = f"contact law of the engine integrated{arm}"
        return Target("law", Extrapolation(value, INTEGRATED * scale, None, True, reason, "nothing"))
    rigid = sliding(normal, tangential, contact.friction, contact.restitution)
    closed = rebound_values(benchmark, rigid, member)[quantity]
    # int |F_n| dt exceeds (1 + e) m v where the dashpot pulls at the end, and friction is mu |F_n| there too
    fastest, e = hertz.fastest_return(contact.restitution), contact.restitution
    pull = 2.0 * (fastest - e) / (1.0 + e)
    share = abs(1.0 - closed) if quantity == "tangential_restitution" else abs(closed)
    if law.shortening and quantity != "tangential_restitution":
        straight = rebound_values(
            benchmark, integrated(law_of(benchmark, contact, "lammps"), normal, tangential), member
        )
        closed += value - straight[quantity]
    reason = f"closed form of sliding{arm}; its part {pull:.1g} that the dashpot pulls"
    uncertainty = pull * share + INTEGRATED * scale
    return Target("sliding", Extrapolation(closed, uncertainty, None, True, reason, "nothing"))


def published_target(points: Points, index: int) -> Target:
    """A published point with its digitisation floor."""
    known = points.uncertainty(index)
    reason = f"digitisation floor {known:.2g}"
    value = points.values[index]
    return Target("published", Extrapolation(value, known, None, True, reason, "the original numbers"))


def spinless_restitution(benchmark: Benchmark, contact: Contact) -> np.ndarray:
    """e_t of each member by the paper's model, Eqs 14-18: a wall is a sphere of endless mass, none spins.

    It sticks, v_t' = 0, where the impulse for that is within friction, and else slides:
    e_t = 1 - mu (1 + e) v_n/v_t.
    """
    heavy = 1e12 * contact.mass  # misses the limit by 1e-12
    found = []
    for normal, tangential in zip(normal_speeds(benchmark), tangential_speeds(benchmark), strict=True):
        hit = pair_collision(
            contact.mass, heavy, [tangential, 0.0, -normal], [0.0, 0.0, 0.0], [0.0, 0.0, -1.0],
            contact.restitution, contact.friction,
        )  # fmt: skip
        e_t = float(hit.velocity_i[0]) / tangential
        found.append(e_t if e_t > 1e-9 else 0.0)  # it sticks, but for the mass of the wall
    return np.array(found)
