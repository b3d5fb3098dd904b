"""The contacts of one instant: who overlaps and approaches, the impulse that each gives, and its ledger row.

Impulses of simultaneous contacts are added.  The equations are those of `contact.py`, `drag.py` and
`removal.py`; positions and velocities are only read: moving is `timestep.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference import ledger as col
from reference.compiled import formula, inlined, kernel
from reference.contact import (
    compression_impulse,
    effective_modulus,
    friction_impulse_per_slip,
    impact_duration,
    mean_load,
    pair_normal_impulse,
    surface_normal_impulse,
)
from reference.drag import drag_factor, fluid_velocity
from reference.heightfield import lower_node, remove_volume, surface_contact
from reference.neighbors import minimum_image
from reference.removal import cap
from reference.state import DEPOSIT_NODE_DEPTH, DEPOSIT_NONE, FLOW_NONE

SEARCH_MARGIN = 0.25  # of the radius: how much further than R the surface is searched


class Work(NamedTuple):
    """Arrays that a step fills, for N particles."""

    impulse: np.ndarray  # (N, 3), of all contacts, N s
    blows: np.ndarray  # (N,), sum of the magnitudes of the contacts' impulses, N s
    gained: np.ndarray  # (N,), mass picked up, kg
    simultaneous: np.ndarray  # (N,), energy lost beyond what each contact would take by itself, J
    drag: np.ndarray  # (N, 3), impulse of the fluid, N s
    velocity: np.ndarray  # (N, 3), at the end of the step, m/s
    trial: np.ndarray  # (N, 3), r^k of the paper's iteration, not wrapped, m
    clearance: np.ndarray  # (N,), travel until the surface can be touched, m
    descent: np.ndarray  # (1,), speed at which the pad comes down, m/s


@kernel
def empty_work(n):
    """The arrays of a step for `n` particles, all zero."""
    return Work(
        np.zeros((n, 3)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3)),
        np.zeros((n, 3)), np.zeros(n), np.zeros(1),
    )  # fmt: skip


@formula
def simultaneous_loss(mass, gained, product, energy):
    """Energy that a contact takes beyond its own loss because its particle is struck by others too, in J.

    A particle that receives J and picks up g at rest loses L(J, g) = m v^2/2 - (m v + J)^2/(2 (m + g)).  With
    A and G of the contacts booked before, L(A + J, G + g) - L(A, G) - L(J, g) is this, as long as no two of
    them bring mass: `gained` is G + g (kg), `product` A.J, and `energy` what the contacts without mass (A
    when J brings it, J when A has) would give by themselves, A.v + A^2/(2 m) or J.v + J^2/(2 m).

    >>> simultaneous_loss(2.0, 0.0, 4.0, 0.0)
    -2.0
    """
    return (gained * energy - product) / (mass + gained)


@formula
def duration_of(model, mass, radius, modulus, speed):
    """The model's delta t: the case's constant, or Hertz's."""
    if model.impact_duration > 0.0:
        return model.impact_duration
    return impact_duration(mass, radius, modulus, speed)


@formula
def drag_on(model, pad_height, z, vx, vy, vz, diameter):
    """External force E on a particle: the drag (Eqs 20-22), three components in N."""
    if model.flow == FLOW_NONE:
        return 0.0, 0.0, 0.0
    ux, uy, uz = fluid_velocity(model, pad_height, z)
    wx, wy, wz = ux - vx, uy - vy, uz - vz
    k = drag_factor(math.sqrt(wx * wx + wy * wy + wz * wz), diameter, model.fluid_density, model.viscosity)
    return k * wx, k * wy, k * wz


@formula
def drag_on_particle(model, pad_height, p, i):
    """External force E on particle i, three components in N."""
    x, v = p.position[i], p.velocity[i]
    return drag_on(model, pad_height, x[2], v[0], v[1], v[2], p.diameter[i])


@inlined
def pair_impulse(model, dt, m_i, m_j, d_i, d_j, modulus, normal_ij, velocity_ij, separation, on_i, on_j):
    """What j gives to i in a contact: (jx, jy, jz, normal, friction, lost, duration, within, external).

    Paper: Eqs. (9), (12)-(19).  `velocity_ij` = v_j - v_i, of which `separation` < 0 is the part along n_ij;
    `modulus` is E*, `on_i` and `on_j` the drag (N).  Returns impulses in N s, the kinetic energy lost in J,
    the model's duration and the part of it within the step in s, and E_in/m_i - E_jn/m_j in m/s2.
    """
    nx, ny, nz = normal_ij
    vx, vy, vz = velocity_ij
    eix, eiy, eiz = on_i
    ejx, ejy, ejz = on_j
    m_eff, r_eff = m_i * m_j / (m_i + m_j), 0.5 * d_i * d_j / (d_i + d_j)
    delta_t = duration_of(model, m_eff, r_eff, modulus, -separation)
    e_in, e_jn = eix * nx + eiy * ny + eiz * nz, ejx * nx + ejy * ny + ejz * nz
    normal = pair_normal_impulse(
        m_i, m_j, -separation, 0.0, model.restitution,
        compression_impulse(e_in, delta_t, dt, model.restitution),
        compression_impulse(e_jn, delta_t, dt, model.restitution),
    )  # fmt: skip
    sx, sy, sz = vx - separation * nx, vy - separation * ny, vz - separation * nz  # Eq 13
    within = min(delta_t, dt)
    wx = sx - ((eix - e_in * nx) / m_i - (ejx - e_jn * nx) / m_j) * within
    wy = sy - ((eiy - e_in * ny) / m_i - (ejy - e_jn * ny) / m_j) * within
    wz = sz - ((eiz - e_in * nz) / m_i - (ejz - e_jn * nz) / m_j) * within
    slip = math.sqrt(wx * wx + wy * wy + wz * wz)
    factor = friction_impulse_per_slip(m_i, m_j, slip, normal, model.static_friction, model.dynamic_friction)
    fx, fy, fz = factor * wx, factor * wy, factor * wz
    jx, jy, jz = fx - normal * nx, fy - normal * ny, fz - normal * nz  # Eq 19
    friction = factor * slip
    lost = (fx * sx + fy * sy + fz * sz) - normal * separation
    lost -= (normal * normal + friction * friction) / (2.0 * m_eff)
    return jx, jy, jz, normal, friction, lost, delta_t, within, e_in / m_i - e_jn / m_j


@kernel
def record_pair_contact(
    time, i, j, touch, normal_ij, approach_speed, normal, friction, lost, duration, within, external, out
):
    """Fill ledger row `out` with the contact of particles i and j; see `pair_impulse`."""
    out[:] = 0.0
    out[col.TIME], out[col.KIND], out[col.I], out[col.J] = time, col.KIND_PAIR, i, j
    out[col.X], out[col.Y], out[col.Z] = touch
    out[col.NX], out[col.NY], out[col.NZ] = normal_ij
    out[col.APPROACH_SPEED], out[col.NORMAL_IMPULSE] = approach_speed, normal
    out[col.FRICTION_IMPULSE], out[col.ENERGY_LOST] = friction, lost
    out[col.DURATION], out[col.LOAD], out[col.CONTACT_TIME] = duration, normal / duration, within
    out[col.EXTERNAL_FORCE] = external


@kernel
def collide_pairs(model, dt, time, pad_height, pairs, p, work, rows, row):
    """Add the impulses of all colliding pairs to `work`; return the next free ledger row.

    Paper: Eqs. (9), (12)-(19); contact where |r_ij| < (d_i + d_j)/2 and v_in > v_jn.  `p` are the Particles.
    """
    impulse, blows, simultaneous = work.impulse, work.blows, work.simultaneous
    for pair in range(pairs.shape[0]):
        i, j = pairs[pair, 0], pairs[pair, 1]
        dx = minimum_image(p.position[j, 0] - p.position[i, 0], model.length_x)
        dy = minimum_image(p.position[j, 1] - p.position[i, 1], model.length_y)
        dz = minimum_image(p.position[j, 2] - p.position[i, 2], model.length_z)
        square = dx * dx + dy * dy + dz * dz
        d_i, d_j = p.diameter[i], p.diameter[j]
        reach = 0.5 * (d_i + d_j)
        if square >= reach * reach or square == 0.0:
            continue
        distance = math.sqrt(square)
        nx, ny, nz = dx / distance, dy / distance, dz / distance
        vx = p.velocity[j, 0] - p.velocity[i, 0]
        vy = p.velocity[j, 1] - p.velocity[i, 1]
        vz = p.velocity[j, 2] - p.velocity[i, 2]
        separation = vx * nx + vy * ny + vz * nz
        if separation >= 0.0:
            continue
        on_i = drag_on_particle(model, pad_height, p, i)
        on_j = drag_on_particle(model, pad_height, p, j)
        m_i, m_j = p.mass[i], p.mass[j]
        jx, jy, jz, normal, friction, lost, delta_t, within, external = pair_impulse(
            model, dt, m_i, m_j, d_i, d_j, effective_modulus(p.modulus[i], p.modulus[j]),
            (nx, ny, nz), (vx, vy, vz), separation, on_i, on_j,
        )  # fmt: skip
        product_i = impulse[i, 0] * jx + impulse[i, 1] * jy + impulse[i, 2] * jz
        product_j = -(impulse[j, 0] * jx + impulse[j, 1] * jy + impulse[j, 2] * jz)
        simultaneous[i] += simultaneous_loss(m_i, 0.0, product_i, 0.0)
        simultaneous[j] += simultaneous_loss(m_j, 0.0, product_j, 0.0)
        size = abs(jx) + abs(jy) + abs(jz)
        blows[i] += size
        blows[j] += size
        for axis, given in enumerate((jx, jy, jz)):
            impulse[i, axis] += given
            impulse[j, axis] -= given
        x, reach_i = p.position[i], 0.5 * d_i
        touch = (x[0] + reach_i * nx, x[1] + reach_i * ny, x[2] + reach_i * nz)
        record_pair_contact(
            time, i, j, touch, (nx, ny, nz), -separation, normal, friction, lost, delta_t, within, external,
            rows[row],
        )  # fmt: skip
        row += 1
    return row


@kernel
def record_surface_impact(model, pad_height, time, i, hit, position, velocity, mass, diameter, modulus, out):
    """Fill ledger row `out` with all of an impact but its impulse: approach, load, and what it removes.

    Paper: Eqs. (30), (34)-(36).  `hit` is (nx, ny, nz, qx, qy, qz).  Every engine calls this once for each
    impact, at its first step of overlap and approach.
    """
    nx, ny, nz, qx, qy, qz = hit
    v_n = velocity[0] * nx + velocity[1] * ny + velocity[2] * nz
    ex, ey, ez = drag_on(model, pad_height, position[2], velocity[0], velocity[1], velocity[2], diameter)
    e_n = ex * nx + ey * ny + ez * nz
    radius = 0.5 * diameter
    delta_t = duration_of(model, mass, radius, effective_modulus(modulus, model.surface_modulus), -v_n)
    load = mean_load(mass, v_n, model.restitution, e_n, delta_t)
    out[:] = 0.0
    out[col.TIME], out[col.KIND], out[col.I], out[col.J] = time, col.KIND_SURFACE, i, -1
    out[col.X], out[col.Y], out[col.Z] = qx, qy, qz
    out[col.NX], out[col.NY], out[col.NZ] = nx, ny, nz
    out[col.APPROACH_SPEED], out[col.DURATION], out[col.LOAD] = -v_n, delta_t, load
    out[col.EXTERNAL_FORCE] = e_n
    if model.deposit != DEPOSIT_NONE and -v_n >= model.threshold_velocity:
        x_p, depth, volume = cap(load, radius, model.poisson_ratio, model.yield_stress)
        out[col.YIELD_RADIUS], out[col.DEPTH] = x_p, depth
        out[col.REMOVED_VOLUME], out[col.REMOVED_MASS] = volume, volume * model.surface_density


@kernel
def touched_before(heights, spacing, position, velocity, dt, radius):
    """Whether a particle overlapped the surface one step dt before, at r - dt v, where it came from.

    A particle pressed into a corner is struck at every step, or every second one, as long as it stays there:
    how often is a matter of the step, not of the model.  See the study `time_step`.  Any facet counts: for a
    sphere that slides over a plateau into a flank the flank is no new contact.
    """
    x, y, z = (
        position[0] - dt * velocity[0],
        position[1] - dt * velocity[1],
        position[2] - dt * velocity[2],
    )
    return surface_contact(heights, spacing, x, y, z, radius)[0]


@inlined
def strike_surface(
    model, dt, time, pad_height, i, hit, position, velocity, mass, diameter, modulus, heights, out
):
    """Fill ledger row `out` with an impact on the surface and its impulse.

    Paper: Eqs. (29)-(31), (34)-(36).  `hit` is (nx, ny, nz, qx, qy, qz).
    """
    record_surface_impact(
        model, pad_height, time, i, hit, position, velocity, mass, diameter, modulus, out
    )  # fmt: skip
    radius, v_n = 0.5 * diameter, -out[col.APPROACH_SPEED]
    removes = out[col.REMOVED_VOLUME] > 0.0
    look_back = removes and model.new_contacts_only
    if look_back and touched_before(heights, model.spacing, position, velocity, dt, radius):
        out[col.YIELD_RADIUS : col.REMOVED_MASS + 1] = 0.0
    ext = compression_impulse(out[col.EXTERNAL_FORCE], out[col.DURATION], dt, model.restitution)
    normal = surface_normal_impulse(mass, v_n, model.restitution, ext)
    picked_up = out[col.REMOVED_MASS] if model.mass_pickup else 0.0
    out[col.NORMAL_IMPULSE], out[col.CONTACT_TIME] = normal, min(out[col.DURATION], dt)
    out[col.ENERGY_LOST] = impact_energy_lost(mass, picked_up, velocity, v_n, normal)


@kernel
def collide_surface(model, dt, time, pad_height, p, heights, clearance, rows, row):
    """Fill a ledger row for each impact on the surface; return the next free one.

    Paper: Eqs. (29)-(31); contact where the surface is nearer than R or the centre below it, and v.n < 0.
    The material itself is taken off by `commit_removal`, once the step is accepted.  `clearance` (N,) is how
    far each particle may travel before it can touch: only those that have none left are searched.
    """
    for i in range(p.position.shape[0]):
        if clearance[i] > 0.0:
            continue
        radius, x = 0.5 * p.diameter[i], p.position[i]
        found, overlap, nx, ny, nz, qx, qy, qz, _ = surface_contact(
            heights, model.spacing, x[0], x[1], x[2], (1.0 + SEARCH_MARGIN) * radius
        )
        overlap -= SEARCH_MARGIN * radius
        if not found or overlap <= 0.0:
            clearance[i] = -overlap if found else SEARCH_MARGIN * radius
            continue
        v = p.velocity[i]
        if v[0] * nx + v[1] * ny + v[2] * nz >= 0.0:
            continue
        strike_surface(
            model, dt, time, pad_height, i, (nx, ny, nz, qx, qy, qz), x, v, p.mass[i], p.diameter[i],
            p.modulus[i], heights, rows[row],
        )  # fmt: skip
        row += 1
    return row


@formula
def impact_energy_lost(mass, gained, velocity, v_n, normal_impulse):
    """Kinetic energy lost by a particle that receives J along n and picks up mass at rest, in J."""
    square = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    after = mass * mass * square + 2.0 * mass * v_n * normal_impulse + normal_impulse**2
    return 0.5 * mass * square - after / (2.0 * (mass + gained))


@kernel
def collide_pad(model, time, pad_height, descent, p, rows, row):
    """Fill a ledger row for each impact on the descending pad, a frictionless plane at `pad_height`.

    Paper: Section 4 leaves the pad's contact open; here J = (1+e_pad) m (v_z + V_z), downwards, with
    the speed V_z = `descent` (m/s) of the pad at this step.
    """
    for i in range(p.position.shape[0]):
        x, v = p.position[i], p.velocity[i]
        approach = v[2] + descent
        if x[2] + 0.5 * p.diameter[i] <= pad_height or approach <= 0.0:
            continue
        normal = surface_normal_impulse(p.mass[i], -approach, model.pad_restitution)
        out = rows[row]
        out[:] = 0.0
        out[col.TIME], out[col.KIND], out[col.I], out[col.J] = time, col.KIND_PAD, i, -1
        out[col.X], out[col.Y], out[col.Z], out[col.NZ] = x[0], x[1], pad_height, -1.0
        out[col.APPROACH_SPEED], out[col.NORMAL_IMPULSE] = approach, normal
        out[col.ENERGY_LOST] = impact_energy_lost(p.mass[i], 0.0, v, -v[2], normal)
        row += 1
    return row


@kernel
def deliver(model, p, work, rows, first, last):
    """Add what impacts on surface and pad, ledger rows first ... last - 1, give to particles to `work`."""
    impulse, velocity = work.impulse, p.velocity
    for row in range(first, last):
        i, normal, mass = int(rows[row, col.I]), rows[row, col.NORMAL_IMPULSE], p.mass[int(rows[row, col.I])]
        jx, jy, jz = normal * rows[row, col.NX], normal * rows[row, col.NY], normal * rows[row, col.NZ]
        ax, ay, az = impulse[i, 0], impulse[i, 1], impulse[i, 2]
        energy = -rows[row, col.ENERGY_LOST]
        if rows[row, col.KIND] == col.KIND_SURFACE:
            energy = ax * velocity[i, 0] + ay * velocity[i, 1] + az * velocity[i, 2]
            energy += 0.5 * (ax * ax + ay * ay + az * az) / mass
            if model.mass_pickup:
                work.gained[i] += rows[row, col.REMOVED_MASS]
        product = ax * jx + ay * jy + az * jz
        work.simultaneous[i] += simultaneous_loss(mass, work.gained[i], product, energy)
        work.blows[i] += abs(jx) + abs(jy) + abs(jz)
        impulse[i, 0] = ax + jx
        impulse[i, 1] = ay + jy
        impulse[i, 2] = az + jz


@formula
def lower_surface(model, heights, x, y, depth, volume):
    """Take the material of one impact off the surface by the case's deposit rule, times A."""
    if model.deposit == DEPOSIT_NODE_DEPTH:
        lower_node(heights, model.spacing, x, y, model.acceleration * depth)
    else:
        remove_volume(heights, model.spacing, x, y, model.acceleration * volume)


@kernel
def commit_removal(model, heights, rows, first, last):
    """Lower the surface by the impacts of ledger rows first ... last - 1; return whether it changed."""
    changed = False
    for row in range(first, last):
        out = rows[row]
        if out[col.REMOVED_VOLUME] > 0.0:
            lower_surface(model, heights, out[col.X], out[col.Y], out[col.DEPTH], out[col.REMOVED_VOLUME])
            changed = True
    return changed
