"""Contacts of pairs, all of one step together: durations as vector instructions, impulses in short form.

The equations are those of `collisions.pair_impulse`, in terms of the effective mass m* and of the relative
acceleration a = E_i/m_i - E_j/m_j alone; tests hold the two against each other.
"""

from __future__ import annotations

import math

from reference.collisions import drag_on
from reference.compiled import inlined
from reference.contact import HERTZ
from reference.fast.sweep import vectorised
from reference.state import FLOW_COUETTE

# bits(q^(-1/5)) is nearly this minus bits(q)/5, within 3.2 %; each of Newton's steps takes e to 3 e^2
ROOT_BITS = int((1.2 * 1023 - 0.059) * 2.0**52)


@vectorised
def hertz_durations(q, bits, result, guess, count):
    """Durations 2.87 q^(-1/5) of the first `count` contacts, q = R E*^2 v/m*^2 > 0: `impact_duration`, s.

    `bits` are those of q, seen as integers, `guess` those of `result`: there Newton's iteration starts.
    """
    for k in range(count):
        guess[k] = ROOT_BITS - int(0.2 * bits[k])
    for k in range(count):
        y, x = result[k], 0.2 * q[k]
        for _ in range(4):
            square = y * y
            y *= 1.2 - x * (square * square * y)
        result[k] = HERTZ * y


@inlined
def impulse_on_first(
    restitution,
    static_friction,
    dynamic_friction,
    m_eff,
    within,
    separation,
    nx,
    ny,
    nz,
    vx,
    vy,
    vz,
    ax,
    ay,
    az,
):
    """Impulse (three components, N s) that particle i receives from j.

    Paper: Eqs. (9), (13)-(19).  `within` (s) is the part of the duration that lies in the step, `separation`
    < 0 the component of v = v_j - v_i along n_ij, and a = E_i/m_i - E_j/m_j.
    """
    a_n = ax * nx + ay * ny + az * nz
    pushed = a_n * within
    normal = max(0.0, m_eff * (pushed - (1.0 + restitution) * separation))
    along = separation - pushed
    wx, wy, wz = vx - within * ax - along * nx, vy - within * ay - along * ny, vz - within * az - along * nz
    slip = math.sqrt(wx * wx + wy * wy + wz * wz)
    factor = m_eff
    if m_eff * slip > static_friction * normal:
        factor = dynamic_friction * normal / slip
    return factor * wx - normal * nx, factor * wy - normal * ny, factor * wz - normal * nz


@inlined
def acceleration(model, nonlinear, shear, pad_height, drag, mass, radius, z, vx, vy, vz):
    """External force on a particle over its mass, E/m with `collisions.drag_on`, three components in m/s2."""
    if nonlinear:
        ex, ey, ez = drag_on(model, pad_height, z, vx, vy, vz, 2.0 * radius)
        return ex / mass, ey / mass, ez / mass
    rate = drag / mass
    if model.flow == FLOW_COUETTE:
        return rate * (shear * z - vx), -rate * vy, -rate * vz
    return rate * (model.flow_x - vx), rate * (model.flow_y - vy), rate * (model.flow_z - vz)
