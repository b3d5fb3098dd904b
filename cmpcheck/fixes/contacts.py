"""Contact of one particle with the surface, and with the pad, through one step of the fix (compiled).

Both in two forms: `soft`, a spring and dashpot, and `impulse`, F = J/dt for one step.  Which particles are
asked, and what else acts on them, is `particles.py`; contacts between particles are `pairs.py`.
"""

from __future__ import annotations

import math

from cmpcheck.fixes.calibration import eased, spring_dashpot
from cmpcheck.fixes.kernels import uncounted
from cmpcheck.fixes.layout import (
    CLEARANCE,
    FREE,
    LEDGER_FULL,
    NO_ERROR,
    PHASE,
    START,
    TOUCHING,
    TUNNELLED,
    WAITING,
)
from cmpcheck.fixes.near import STEPS_AHEAD, WIDEST, contact_nearby, is_near, remember
from reference import ledger as col
from reference.collisions import SEARCH_MARGIN, drag_on, impact_energy_lost, record_surface_impact
from reference.compiled import formula, inlined
from reference.contact import compression_impulse, surface_normal_impulse
from reference.fast.events import bounce, remarkable_speed
from reference.heightfield import surface_contact
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity

ROUNDING = 1e-9  # of the radius: more than a way that is summed up over steps can lose


@uncounted
def copy_row(source, target):
    """Copy as many numbers as `target` holds."""
    for column in range(target.size):
        target[column] = source[column]


@uncounted
def is_kept(c, row):
    """Whether a contact that has ended is fast enough for the ledger, or has removed something."""
    return row[col.APPROACH_SPEED] >= c.ledger_speed or row[col.REMOVED_VOLUME] > 0.0


@uncounted
def close_contact(c, contact, rows):
    """Move an ended contact from the per-atom row to the ledger; return an error code."""
    contact[PHASE] = FREE
    if not is_kept(c, contact):
        return NO_ERROR
    if c.rows == rows.shape[0]:
        return LEDGER_FULL
    copy_row(contact, rows[c.rows])
    c.rows += 1
    return NO_ERROR


@uncounted
def close_impact(c, contact, velocity, mass, gained, rows):
    """Close a contact with the surface, from which the particle carries `gained` (kg) on.

    Paper: Eq. (24) tangentially: (m + dm) v' = m v.  Returns `gained`, or minus an error code.
    """
    error = close_contact(c, contact, rows)
    if error != NO_ERROR:
        return -float(error)
    if gained > 0.0:
        for axis in range(3):
            velocity[axis] *= mass / (mass + gained)
    return gained


@formula
def overlap_with(position, radius, qx, qy, qz):
    """Overlap of a sphere with the surface from its closest point q: that of `surface_contact` to the bit."""
    x, y, z = position
    if x == qx and y == qy and z <= qz:  # the centre is on or below the surface
        return radius + qz - z
    return radius - math.sqrt((qx - x) ** 2 + (qy - y) ** 2 + (qz - z) ** 2)


@inlined
def look_at_surface(c, k, position, speed, radius, heights, state, near):
    """Overlap, normal (three components) and closest point (three) of particle k with the surface.

    One that has no contact is looked at further ahead: the surface only ever falls, so what was found of it
    bounds the distance until the way in `state` is used up.  `speed` (m/s) or more is how fast it is.
    """
    x, y, z = position
    spacing, free = c.model.spacing, state[PHASE] == FREE
    reach = (1.0 + SEARCH_MARGIN) * radius if free else radius
    if is_near(near, k, c.falls, x, y, z):
        found, overlap, nx, ny, nz, qx, qy, qz = contact_nearby(near, k, x, y, z, reach)
    else:
        found, overlap, nx, ny, nz, qx, qy, qz, _ = surface_contact(heights, spacing, x, y, z, reach)
        way = min(STEPS_AHEAD * c.time_step * speed, WIDEST * radius)
        if found and reach - overlap < radius + way:  # others are looked at next when they have gone farther
            remember(near, k, c.falls, heights, spacing, x, y, z, reach - overlap, way)
    if free:
        state[CLEARANCE] = (SEARCH_MARGIN - ROUNDING) * radius - (overlap if found else 0.0)
        overlap = overlap_with(position, radius, qx, qy, qz) if found else 0.0
    return overlap, nx, ny, nz, qx, qy, qz


@inlined
def is_waiting(c, step, waits, contact):
    """Whether a contact that has begun is not to act yet, whatever the particle does meanwhile.

    An impulse acts after a native pair force on the particle (`waits`) has ended, or after two contact
    durations.
    """
    return contact[PHASE] == WAITING and waits and (step - contact[START]) * c.time_step < c.patience


@inlined
def is_leaving(c, k, position, velocity, radius, contact, near):
    """Whether particle k goes away from the surface, which it overlaps, so that there is no contact."""
    x, y, z = position
    if not is_near(near, k, c.falls, x, y, z):
        return False
    found, overlap, nx, ny, nz, _, _, _ = contact_nearby(near, k, x, y, z, radius)
    if not (found and overlap > 0.0) or velocity[0] * nx + velocity[1] * ny + velocity[2] * nz < 0.0:
        return False
    contact[PHASE] = FREE
    return True


@uncounted
def soft_contact(
    c, time, acts, touch, position, v_half, v_free, mass, radius, tag, modulus, contact, rows
):  # fmt: skip
    """Spring-dashpot contact with the surface: (force in N, three components; mass gained in kg).

    `touch` is what `look_at_surface` found.  F = max(0, k x - c v_n), with v_n at the time of the overlap x:
    `v_free` is the velocity there without this force.  Opens at overlap and approach, closes when the force
    vanishes; removal is committed then.  A negative mass is minus an error code.
    """
    model = c.model
    overlap, nx, ny, nz, qx, qy, qz = touch
    v_n = v_free[0] * nx + v_free[1] * ny + v_free[2] * nz
    if overlap > 2.0 * radius:
        return 0.0, 0.0, 0.0, -TUNNELLED
    overlaps = overlap > 0.0
    if contact[PHASE] != TOUCHING:
        if not (overlaps and v_n < 0.0):
            return 0.0, 0.0, 0.0, 0.0
        record_surface_impact(
            model, c.pad_height, time, tag - 1, (nx, ny, nz, qx, qy, qz), position, v_free, mass,
            2.0 * radius, modulus, contact[: rows.shape[1]],
        )  # fmt: skip
        contact[PHASE] = TOUCHING
    force = 0.0
    if overlaps:
        force = spring_dashpot(c.spring, c.damping, eased(c.damping, c.lag), mass, overlap, v_n)
    if force > 0.0:
        contact[col.NORMAL_IMPULSE] += force * acts
        contact[col.CONTACT_TIME] += acts
        contact[col.ENERGY_LOST] -= force * acts * (v_n + c.lag * force / mass)
        return force * nx, force * ny, force * nz, 0.0
    gained = contact[col.REMOVED_MASS] if model.mass_pickup else 0.0
    square = v_half[0] ** 2 + v_half[1] ** 2 + v_half[2] ** 2
    contact[col.ENERGY_LOST] += 0.5 * mass * square * gained / (mass + gained)
    return 0.0, 0.0, 0.0, close_impact(c, contact, v_half, mass, gained, rows)


@inlined
def slow_impact(c, acts, normal, position, v_half, v_n, mass, radius, modulus):
    """Force J/dt in N along the normal of an impact that removes nothing."""
    ex, ey, ez = drag_on(
        c.model, c.pad_height, position[2], v_half[0], v_half[1], v_half[2], 2.0 * radius
    )  # fmt: skip
    e_n = ex * normal[0] + ey * normal[1] + ez * normal[2]
    j, _ = bounce(c.model, acts, mass, radius, modulus, -v_n, e_n)
    return j / acts


@uncounted
def impulse_contact(
    c, step, acts, waits, touch, position, v_half, mass, radius, tag, modulus, contact, rows
):  # fmt: skip
    """Impulsive contact with the surface: (force in N, three components; mass gained in kg).

    Paper: Eqs. (29)-(31).  The force J/dt acts for one step; not asked while the contact waits, see
    `is_waiting`.  A negative mass is minus an error code.
    """
    model = c.model
    overlap, nx, ny, nz, qx, qy, qz = touch
    if overlap > 2.0 * radius:
        return 0.0, 0.0, 0.0, -TUNNELLED
    v_n = v_half[0] * nx + v_half[1] * ny + v_half[2] * nz
    if not (overlap > 0.0 and v_n < 0.0):
        contact[PHASE] = FREE
        return 0.0, 0.0, 0.0, 0.0
    if contact[PHASE] == FREE:
        contact[PHASE], contact[START] = WAITING, step
        if is_waiting(c, step, waits, contact):
            return 0.0, 0.0, 0.0, 0.0
    if -v_n < remarkable_speed(model, c.ledger_speed):  # no row is kept of it, see `is_kept`
        contact[PHASE] = FREE
        slow = slow_impact(c, acts, (nx, ny, nz), position, v_half, v_n, mass, radius, modulus)
        return slow * nx, slow * ny, slow * nz, 0.0
    record_surface_impact(
        model, c.pad_height, contact[START] * c.time_step, tag - 1, (nx, ny, nz, qx, qy, qz), position,
        v_half, mass, 2.0 * radius, modulus, contact[: rows.shape[1]],
    )  # fmt: skip
    duration = contact[col.DURATION]
    ext = compression_impulse(contact[col.EXTERNAL_FORCE], duration, acts, model.restitution)
    j = surface_normal_impulse(mass, v_n, model.restitution, ext)
    gained = contact[col.REMOVED_MASS] if model.mass_pickup else 0.0
    contact[col.NORMAL_IMPULSE], contact[col.CONTACT_TIME] = j, min(duration, acts)
    contact[col.ENERGY_LOST] = impact_energy_lost(mass, gained, v_half, v_n, j)
    force = j / acts
    return force * nx, force * ny, force * nz, close_impact(c, contact, v_half, mass, gained, rows)


@uncounted
def lower_pad(c, step):
    """Move the pad from its height at the last step to that of this one, once the surface was lowered.

    Where it is, and whether it still descends, decides the reference's `pad.py`.
    """
    model = c.model
    if not model.has_pad:
        return
    lowest = lowest_pad_height(model, c.highest if model.has_surface else 0.0, c.largest)
    if 0 <= c.last_step < step:
        c.pad_height = lowered_pad(model, c.pad_height, lowest, c.time_step)
    c.pad_velocity = pad_velocity(model, c.pad_height, lowest)


@uncounted
def open_pad_contact(c, time, position, approach, tag, contact):
    """Start the ledger row of a contact with the pad."""
    row = contact[:PHASE]
    row[:] = 0.0
    row[col.TIME], row[col.KIND], row[col.I], row[col.J] = time, col.KIND_PAD, tag - 1, -1
    row[col.X], row[col.Y], row[col.Z], row[col.NZ] = position[0], position[1], c.pad_height, -1.0
    row[col.APPROACH_SPEED] = approach


@inlined
def soft_pad(c, time, acts, position, v_free, mass, radius, tag, contact, rows):
    """Spring-dashpot contact with the pad, which moves down: (force downwards in N, error code)."""
    overlap, approach = position[2] + radius - c.pad_height, v_free[2] + c.pad_velocity
    if contact[PHASE] != TOUCHING:
        if overlap <= 0.0 or approach <= 0.0:
            return 0.0, NO_ERROR
        open_pad_contact(c, time, position, approach, tag, contact)
        contact[PHASE] = TOUCHING
    force = 0.0
    if overlap > 0.0:
        ease = eased(c.pad_damping, c.lag)
        force = spring_dashpot(c.pad_spring, c.pad_damping, ease, mass, overlap, -approach)
    if force <= 0.0:
        return 0.0, close_contact(c, contact, rows)
    contact[col.NORMAL_IMPULSE] += force * acts
    contact[col.CONTACT_TIME] += acts
    contact[col.ENERGY_LOST] += force * acts * (v_free[2] - c.lag / mass * force)
    return force, NO_ERROR


@inlined
def impulse_pad(c, step, acts, waits, position, v_half, mass, radius, tag, contact, rows):
    """Impulsive contact with the pad: (force downwards in N for this step, error code).

    Paper: Section 4; J = (1+e_pad) m (v_z + V_z).
    """
    if is_waiting(c, step, waits, contact):
        return 0.0, NO_ERROR
    approach = v_half[2] + c.pad_velocity
    if position[2] + radius <= c.pad_height or approach <= 0.0:
        contact[PHASE] = FREE
        return 0.0, NO_ERROR
    if contact[PHASE] == FREE:
        contact[PHASE], contact[START] = WAITING, step
        if is_waiting(c, step, waits, contact):
            return 0.0, NO_ERROR
    j = surface_normal_impulse(mass, -approach, c.model.pad_restitution)
    if approach < c.ledger_speed:  # no row is kept of it, see `is_kept`: the pad removes nothing
        contact[PHASE] = FREE
        return j / acts, NO_ERROR
    open_pad_contact(c, contact[START] * c.time_step, position, approach, tag, contact)
    contact[col.NORMAL_IMPULSE] = j
    contact[col.ENERGY_LOST] = impact_energy_lost(mass, 0.0, v_half, -v_half[2], j)
    return j / acts, close_contact(c, contact, rows)
