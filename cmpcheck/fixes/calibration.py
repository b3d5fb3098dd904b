"""Spring and dashpot of a soft contact: which damping gives a restitution, which spring a duration; force.

The contact force never attracts: F = max(0, k x - c v_n) with overlap x.  It ends when the force vanishes,
before the overlap does; both relations below are for that end.
"""

from __future__ import annotations

import math

from scipy.optimize import brentq

from reference.compiled import formula


def _half_phase(z: float) -> float:
    """omega0 t_c/2 = acos(z)/sqrt(1 - z^2) and its continuation beyond critical damping, z > 1."""
    if abs(z - 1.0) < 1e-6:
        return 1.0 - (z - 1.0) / 3.0  # the next term is 2 (z - 1)^2/15: below rounding here
    if z < 1.0:
        return math.acos(z) / math.sqrt((1.0 - z) * (1.0 + z))
    return math.acosh(z) / math.sqrt((z - 1.0) * (z + 1.0))


def damping_ratio(restitution: float) -> float:
    """Damping ratio z of a non-attractive spring and dashpot that rebounds with this restitution.

    Solves exp(-2 z acos(z)/sqrt(1 - z^2)) = e, that is exp(-z (pi - 2 asin z)/sqrt(1 - z^2)) = e; critical
    damping (z = 1) gives e = exp(-2), and below it acosh replaces acos.
    Raises ValueError for e outside (0, 1]: e = 0 would need infinite damping.

    >>> damping_ratio(1.0)
    0.0
    >>> round(damping_ratio(math.exp(-2.0)), 12)
    1.0
    """
    if not 0.0 < restitution <= 1.0:
        raise ValueError(
            f"restitution = {restitution}: a soft contact can have 0 < e <= 1 (the impulse form also e = 0)"
        )
    if restitution == 1.0:
        return 0.0
    target = -math.log(restitution)
    high = 1.0
    while 2.0 * high * _half_phase(high) < target:
        high *= 2.0
    return float(brentq(lambda z: 2.0 * z * _half_phase(z) - target, 0.0, high, xtol=1e-15, rtol=1e-15))


def spring(restitution: float, contact_duration: float) -> tuple[float, float]:
    """Spring and dashpot per unit mass, (omega0^2, 2 z omega0) in 1/s2 and 1/s.

    With k = m omega0^2 and c = 2 z m omega0 every isolated contact lasts `contact_duration` (s) and rebounds
    with `restitution`.

    >>> omega_square, damping = spring(1.0, math.pi)
    >>> round(omega_square, 12), damping
    (1.0, 0.0)
    """
    if not contact_duration > 0.0:
        raise ValueError(f"contact_duration = {contact_duration} s: must be positive")
    z = damping_ratio(restitution)
    omega0 = 2.0 * _half_phase(z) / contact_duration
    return omega0 * omega0, 2.0 * z * omega0


@formula
def eased(damping, lag):
    """What lowers a dashpot's force: for `lag` (s) it acts on the velocity that it is taken from."""
    return 1.0 / (1.0 + damping * lag)


@formula
def spring_dashpot(spring, damping, ease, mass, overlap, v_n):
    """Force k x - c v_n at the time of the overlap, in N, from the v_n that would be there without it.

    `ease` is what `eased` gives.
    """
    return ease * (mass * (spring * overlap - damping * v_n))
