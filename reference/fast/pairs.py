"""Contacts of pairs, up to LANES of one step together, as vector instructions.

The equations are those of `collisions.pair_impulse`, in terms of the effective mass m* and of the relative
acceleration a = E_i/m_i - E_j/m_j alone; tests hold the two against each other.

A batch is one flat array, LANES numbers for each quantity of `Batch`: at distances that the compiler knows
it sees that nothing overlaps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.collisions import drag_on
from reference.compiled import inner, part
from reference.contact import HERTZ
from reference.fast.near import FACTS, F
from reference.neighbors import nearest_image
from reference.state import FLOW_COUETTE

LANES, REGISTER = 16, 4  # contacts of a batch, and doubles in a vector register
# bits(q^(-1/5)) is nearly this minus bits(q)/5, within 3.2 %; each of Newton's steps takes e to 3 e^2
ROOT_BITS = int((1.2 * 1023 - 0.059) * 2.0**52)


class Batch(NamedTuple):
    """Where in a batch the first lane of a quantity is; i and j are the particles of a contact."""

    nx: int = 0 * LANES  # way from i to j, m; then the unit vector
    ny: int = 1 * LANES
    nz: int = 2 * LANES
    vx: int = 3 * LANES  # v_j - v_i, m/s
    vy: int = 4 * LANES
    vz: int = 5 * LANES
    ax: int = 6 * LANES  # E_i/m_i - E_j/m_j, m/s2
    ay: int = 7 * LANES
    az: int = 8 * LANES
    per_mass: int = 9 * LANES  # 1/m* = 1/m_i + 1/m_j, 1/kg
    rigid: int = 10 * LANES  # R E*^2, m Pa2
    m_eff: int = 11 * LANES  # m*, kg
    separation: int = 12 * LANES  # component of v along n, m/s
    hertz: int = 13 * LANES  # R E*^2 v/m*^2
    duration: int = 14 * LANES  # s
    jx: int = 15 * LANES  # impulse that i receives, N s
    jy: int = 16 * LANES
    jz: int = 17 * LANES


B = Batch()


@inner
def batch():
    """Room for one batch."""
    return np.ones(len(B) * LANES)


@part
def fill_up(c, met):
    """Have the lanes that are left of the last vector register repeat the first; return how many are used."""
    lanes = (met + REGISTER - 1) // REGISTER * REGISTER
    for k in range(met, lanes):
        for row in range(B.m_eff // LANES):
            c[row * LANES + k] = c[row * LANES]
    return lanes


@part
def approach(c, lanes):
    """Unit vectors, effective masses, speeds of separation, and what Hertz's duration depends on."""
    for k in range(lanes):
        dx, dy, dz = c[B.nx + k], c[B.ny + k], c[B.nz + k]
        per_distance = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
        nx, ny, nz = dx * per_distance, dy * per_distance, dz * per_distance
        per_mass = c[B.per_mass + k]
        separation = c[B.vx + k] * nx + c[B.vy + k] * ny + c[B.vz + k] * nz
        c[B.nx + k], c[B.ny + k], c[B.nz + k] = nx, ny, nz
        c[B.m_eff + k], c[B.separation + k] = 1.0 / per_mass, separation
        c[B.hertz + k] = -c[B.rigid + k] * separation * per_mass * per_mass


@part
def guess_durations(bits, lanes):
    """q^(-1/5) within some percent, from the bits of q: there Newton's iteration starts."""
    for k in range(lanes):
        bits[B.duration + k] = ROOT_BITS - int(0.2 * bits[B.hertz + k])


@part
def durations(c, lanes):
    """Durations 2.87 q^(-1/5), q = R E*^2 v/m*^2 > 0: `impact_duration`, s."""
    for k in range(lanes):
        y, x = c[B.duration + k], 0.2 * c[B.hertz + k]
        for _ in range(4):
            square = y * y
            y *= 1.2 - x * (square * square * y)
        c[B.duration + k] = HERTZ * y


@part
def impulses(c, lanes, restitution, static_friction, dynamic_friction, dt):
    """Impulses that the first particles receive."""
    for k in range(lanes):
        within = c[B.duration + k]
        c[B.jx + k], c[B.jy + k], c[B.jz + k] = impulse_on_first(
            restitution, static_friction, dynamic_friction, c[B.m_eff + k], within if within < dt else dt,
            c[B.separation + k], c[B.nx + k], c[B.ny + k], c[B.nz + k], c[B.vx + k], c[B.vy + k], c[B.vz + k],
            c[B.ax + k], c[B.ay + k], c[B.az + k],
        )  # fmt: skip


@part
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
    normal = m_eff * (pushed - (1.0 + restitution) * separation)
    normal = normal if normal > 0.0 else 0.0
    along = separation - pushed
    wx, wy, wz = vx - within * ax - along * nx, vy - within * ay - along * ny, vz - within * az - along * nz
    slip = math.sqrt(wx * wx + wy * wy + wz * wz)
    factor = dynamic_friction * normal / slip if m_eff * slip > static_friction * normal else m_eff
    return factor * wx - normal * nx, factor * wy - normal * ny, factor * wz - normal * nz


@part
def acceleration(model, nonlinear, shear, pad_height, rate, mass, radius, z, vx, vy, vz):
    """External force on a particle over its mass, E/m with `collisions.drag_on`, three components in m/s2.

    `rate` is k/m of Stokes's drag, 1/s.
    """
    if nonlinear:
        ex, ey, ez = drag_on(model, pad_height, z, vx, vy, vz, 2.0 * radius)
        return ex / mass, ey / mass, ez / mass
    if model.flow == FLOW_COUETTE:
        return rate * (shear * z - vx), -rate * vy, -rate * vz
    return rate * (model.flow_x - vx), rate * (model.flow_y - vy), rate * (model.flow_z - vz)


@part
def acceleration_in(model, s, nonlinear, shear, pad_height, i):
    """`acceleration` of particle i of the swarm `s`."""
    return acceleration(
        model, nonlinear[i], shear, pad_height, s.rate[i], s.mass[i], s.radius[i], s.z[i], s.vx[i], s.vy[i],
        s.vz[i],
    )  # fmt: skip


@part
def impulses_of_batch(model, dt, c, bits, met):
    """Impulses and durations of the `met` contacts of the batch `c`, whose memory as integers is `bits`."""
    lanes = fill_up(c, met)
    approach(c, lanes)
    if model.impact_duration > 0.0:
        for k in range(lanes):
            c[B.duration + k] = model.impact_duration
    else:
        guess_durations(bits, lanes)
        durations(c, lanes)
    impulses(c, lanes, model.restitution, model.static_friction, model.dynamic_friction, dt)


@part
def next_batch(
    model, fixed, s, lists, nonlinear, shear, pad_height, pair, end, meeting, c, bits
):  # fmt: skip
    """Find the next contacts among the pairs pair ... end - 1, and their impulses: (pair to go on with, met).

    `meeting` gets the numbers of their pairs, the batch `c`, whose memory as integers is `bits`, the rest.
    """
    x, y, z, vx, vy, vz = s.x, s.y, s.z, s.vx, s.vy, s.vz
    narrow, facts = lists.narrow, lists.facts
    met = 0
    while pair < end and met < LANES:  # without branches: whether two touch is hard to foretell
        q = np.uint32(pair)
        i, j = narrow[2 * q], narrow[2 * q + 1]
        dx = x[j] - x[i] + facts[FACTS * q + F.shift_x]
        dy = y[j] - y[i] + facts[FACTS * q + F.shift_y]
        dz = nearest_image(z[j] - z[i], model.length_z, fixed.half_z)
        wx, wy, wz = vx[j] - vx[i], vy[j] - vy[i], vz[j] - vz[i]
        lane = np.uint32(met)
        meeting[lane] = pair
        c[B.nx + lane], c[B.ny + lane], c[B.nz + lane] = dx, dy, dz
        c[B.vx + lane], c[B.vy + lane], c[B.vz + lane] = wx, wy, wz
        touching = dx * dx + dy * dy + dz * dz < facts[FACTS * q + F.reach]
        met += int(touching & (wx * dx + wy * dy + wz * dz < 0.0))
        pair += 1
    if met > 0:
        for k in range(met):
            q = meeting[k]
            i, j = narrow[2 * q], narrow[2 * q + 1]
            ax, ay, az = acceleration_in(model, s, nonlinear, shear, pad_height, i)
            bx, by, bz = acceleration_in(model, s, nonlinear, shear, pad_height, j)
            c[B.ax + k], c[B.ay + k], c[B.az + k] = ax - bx, ay - by, az - bz
            c[B.per_mass + k] = s.per_mass[i] + s.per_mass[j]
            c[B.rigid + k] = facts[FACTS * q + F.rigid]
        impulses_of_batch(model, fixed.dt, c, bits, met)
    return pair, met
