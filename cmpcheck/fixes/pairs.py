"""Native contacts between particles, as the fix sees them (compiled; all particles by tag, on one rank).

LAMMPS computes the contacts; here they are followed from first overlap and approach to their end and written
to the ledger.  The impulse is the sum of LAMMPS's own pair force, so drag and surface do not enter it.
"""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.fixes.contacts import copy_row, is_kept
from cmpcheck.fixes.layout import (
    FIX_FORCE,
    ISOLATED,
    LAG,
    LEDGER_FULL,
    MASS,
    NO_ERROR,
    PAIR_FORCE,
    PAIR_IMPULSE,
    PAIRS_FULL,
    POSITION,
    RADIUS,
    VELOCITY,
)
from reference import ledger as col
from reference.collisions import drag_on, duration_of
from reference.compiled import kernel
from reference.contact import compression_impulse, effective_modulus, pair_normal_impulse
from reference.neighbors import has_moved, minimum_image, neighbor_pairs

SKIN = 0.3  # of the largest radius: pairs within 2 R + SKIN R are listed


@kernel
def update_pairs(c, step, by_tag, position, pairs, listed):
    """List the pairs that may overlap, when a particle has moved half the skin since the last time."""
    periods = np.empty(3)
    periods[0], periods[1], periods[2] = c.model.length_x, c.model.length_y, c.model.length_z
    largest = 0.0
    for i in range(c.particles):
        largest = max(largest, by_tag[i, RADIUS])
        for axis in range(3):
            position[i, axis] = by_tag[i, POSITION + axis]
    if c.pairs >= 0 and not has_moved(position, listed, 0.5 * SKIN * largest, periods):
        return
    found = neighbor_pairs(position, (2.0 + SKIN) * largest, periods)
    if found.shape[0] > pairs.shape[0]:
        c.error, c.error_step, c.error_tag = PAIRS_FULL, step, 1
        return
    c.pairs = found.shape[0]
    for pair in range(c.pairs):
        pairs[pair, 0], pairs[pair, 1] = found[pair, 0], found[pair, 1]
    copy_row(position.ravel(), listed.ravel())


@kernel
def separation(model, a, b):
    """Overlap of two particles (negative: gap) in m, and the normal from a to b."""
    dx = minimum_image(b[POSITION] - a[POSITION], model.length_x)
    dy = minimum_image(b[POSITION + 1] - a[POSITION + 1], model.length_y)
    dz = minimum_image(b[POSITION + 2] - a[POSITION + 2], model.length_z)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    return a[RADIUS] + b[RADIUS] - distance, dx / distance, dy / distance, dz / distance


@kernel
def approach_speed(a, b, nx, ny, nz, with_pair_force):
    """Speed of approach along n at the time of the positions, in m/s, with or without the pair forces."""
    speed = 0.0
    for axis, n in enumerate((nx, ny, nz)):
        a_force, b_force = a[FIX_FORCE + axis], b[FIX_FORCE + axis]
        if with_pair_force:
            a_force += a[PAIR_FORCE + axis]
            b_force += b[PAIR_FORCE + axis]
        va = a[VELOCITY + axis] + a[LAG] * a_force / a[MASS]
        vb = b[VELOCITY + axis] + b[LAG] * b_force / b[MASS]
        speed += (va - vb) * n
    return speed


@kernel
def drag_along(c, p, nx, ny, nz):
    """Component of a particle's drag along n, in N."""
    vx, vy, vz = p[VELOCITY], p[VELOCITY + 1], p[VELOCITY + 2]
    ex, ey, ez = drag_on(c.model, c.pad_height, p[POSITION + 2], vx, vy, vz, 2.0 * p[RADIUS])
    return ex * nx + ey * ny + ez * nz


@kernel
def open_pair(c, time, i, j, a, b, nx, ny, nz, speed, modulus, contact):
    """Start the ledger row of a contact between particles i < j, at its first overlap and approach."""
    model = c.model
    m_i, m_j, r_i, r_j = a[MASS], b[MASS], a[RADIUS], b[RADIUS]
    e_in, e_jn = drag_along(c, a, nx, ny, nz), drag_along(c, b, nx, ny, nz)
    stiffness = effective_modulus(modulus[i], modulus[j])
    duration = duration_of(model, m_i * m_j / (m_i + m_j), r_i * r_j / (r_i + r_j), stiffness, speed)
    impulse = pair_normal_impulse(
        m_i, m_j, speed, 0.0, model.restitution,
        compression_impulse(e_in, duration, math.inf, model.restitution),
        compression_impulse(e_jn, duration, math.inf, model.restitution),
    )  # fmt: skip
    for column in range(contact.size):
        contact[column] = 0.0
    contact[col.TIME], contact[col.KIND], contact[col.I], contact[col.J] = time, col.KIND_PAIR, i, j
    contact[col.X] = a[POSITION] + r_i * nx
    contact[col.Y] = a[POSITION + 1] + r_i * ny
    contact[col.Z] = a[POSITION + 2] + r_i * nz
    contact[col.NX], contact[col.NY], contact[col.NZ] = nx, ny, nz
    contact[col.APPROACH_SPEED], contact[col.EXTERNAL_FORCE] = speed, e_in / m_i - e_jn / m_j
    contact[col.DURATION], contact[col.LOAD] = duration, impulse / duration
    contact[ISOLATED] = 1.0


@kernel
def follow_pair(c, a, b, contact):
    """Add this step's pair force to an open contact; return whether that force is there."""
    acts = 0.5 * c.time_step + a[LAG]
    acting = False
    for axis in range(3):
        contact[PAIR_IMPULSE + axis] += a[PAIR_FORCE + axis] * acts
        acting = acting or a[PAIR_FORCE + axis] != 0.0
        for p in (a, b):
            velocity = p[VELOCITY + axis] + p[LAG] * (p[PAIR_FORCE + axis] + p[FIX_FORCE + axis]) / p[MASS]
            contact[col.ENERGY_LOST] -= p[PAIR_FORCE + axis] * velocity * acts
    if acting:
        contact[col.CONTACT_TIME] += acts
    return acting


@kernel
def close_pair(c, contact, rows):
    """Move an ended contact to the ledger; what cannot be told apart from other contacts becomes NaN."""
    if not is_kept(c, contact):
        return
    jx, jy, jz = contact[PAIR_IMPULSE], contact[PAIR_IMPULSE + 1], contact[PAIR_IMPULSE + 2]
    nx, ny, nz = contact[col.NX], contact[col.NY], contact[col.NZ]
    normal = -(jx * nx + jy * ny + jz * nz)
    tx, ty, tz = jx + normal * nx, jy + normal * ny, jz + normal * nz
    contact[col.NORMAL_IMPULSE] = normal
    contact[col.FRICTION_IMPULSE] = math.sqrt(tx * tx + ty * ty + tz * tz)
    if contact[ISOLATED] == 0.0:
        contact[col.NORMAL_IMPULSE] = contact[col.FRICTION_IMPULSE] = contact[col.ENERGY_LOST] = math.nan
    copy_row(contact, rows[c.rows])
    c.rows += 1


@kernel
def follow_open_pairs(c, step, by_tag, open_pairs, rows):
    """Follow every open contact through this step; those that have ended go to the ledger.

    A contact ends with its overlap, or earlier when its force has vanished and the particles separate.
    """
    slot = 0
    while slot < c.open:
        contact = open_pairs[slot]
        a, b = by_tag[int(contact[col.I])], by_tag[int(contact[col.J])]
        overlap, nx, ny, nz = separation(c.model, a, b)
        acting = follow_pair(c, a, b, contact)
        released = contact[ISOLATED] == 1.0 and not acting and approach_speed(a, b, nx, ny, nz, True) <= 0.0
        if overlap > 0.0 and not released:
            slot += 1
            continue
        if c.rows == rows.shape[0]:
            c.error, c.error_step, c.error_tag = LEDGER_FULL, step, int(contact[col.I]) + 1
            return
        close_pair(c, contact, rows)
        c.open -= 1
        if slot < c.open:
            copy_row(open_pairs[c.open], open_pairs[slot])


@kernel
def observe_pairs(c, step, by_tag, modulus, position, pairs, listed, open_pairs, rows):
    """Follow the contacts between particles through one step; `by_tag` is of all particles."""
    update_pairs(c, step, by_tag, position, pairs, listed)
    if c.error != NO_ERROR:
        return
    follow_open_pairs(c, step, by_tag, open_pairs, rows)
    for pair in range(c.pairs):
        i, j = pairs[pair, 0], pairs[pair, 1]
        a, b = by_tag[i], by_tag[j]
        overlap, nx, ny, nz = separation(c.model, a, b)
        if overlap <= 0.0:
            continue
        speed = approach_speed(a, b, nx, ny, nz, False)
        if speed <= 0.0 or is_open(c, i, j, open_pairs):
            continue
        if c.open == open_pairs.shape[0]:
            c.error, c.error_step, c.error_tag = PAIRS_FULL, step, i + 1
            return
        contact = open_pairs[c.open]
        open_pair(c, step * c.time_step, i, j, a, b, nx, ny, nz, speed, modulus, contact)
        mark_shared(c, i, j, open_pairs)
        follow_pair(c, a, b, contact)
        c.open += 1


@kernel
def is_open(c, i, j, open_pairs):
    """Whether the contact of particles i < j is being followed."""
    for slot in range(c.open):  # noqa: SIM110  Numba has no generators
        if open_pairs[slot, col.I] == i and open_pairs[slot, col.J] == j:
            return True
    return False


@kernel
def mark_shared(c, i, j, open_pairs):
    """Mark the new contact (i, j), not yet counted in c.open, and those of i or j, as not isolated."""
    for slot in range(c.open):
        a, b = open_pairs[slot, col.I], open_pairs[slot, col.J]
        if a in (i, j) or b in (i, j):
            open_pairs[slot, ISOLATED] = 0.0
            open_pairs[c.open, ISOLATED] = 0.0
