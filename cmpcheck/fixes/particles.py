"""One step of the fix for every particle of this rank: drag, contact with the surface, removal (compiled).

Velocity Verlet calls a force at time t with the velocity of t - dt/2, the "half-step" velocity.  Forces that
depend on velocity are evaluated at t to second order: drag at v + (dt/2) E/m, the dashpot implicitly.
An impulse is delivered whole between two half-step velocities, so the impulse form works with those.
The same in plain Python: `plain.py`.  Contacts between particles: `pairs.py`.
"""

from __future__ import annotations

import math

from cmpcheck.fixes.layout import (
    EVALUATED,
    FORCE,
    FREE,
    IMPULSE,
    LEDGER_FULL,
    MICRO,
    NANO,
    NO_ERROR,
    NOT_FINITE,
    OBSERVE,
    PHASE,
    PICOGRAM,
    START,
    TOUCHING,
    TUNNELLED,
    WAITING,
)
from reference import ledger as col
from reference.collisions import commit_removal, drag_on, impact_energy_lost, record_surface_impact
from reference.compiled import formula, kernel
from reference.contact import compression_impulse, surface_normal_impulse
from reference.heightfield import surface_contact


@formula
def drag_now(model, lag, z, vx, vy, vz, mass, diameter):
    """Drag at the time of the positions, from velocities that are `lag` older; second order in the step.

    Paper: Eqs. (20)-(22).  Stable for steps below twice the relaxation time.
    """
    ex, ey, ez = drag_on(model, 0.0, z, vx, vy, vz, diameter)
    ahead = lag / mass
    return drag_on(model, 0.0, z, vx + ahead * ex, vy + ahead * ey, vz + ahead * ez, diameter)


@kernel
def copy_row(source, target):
    """Copy as many numbers as `target` holds."""
    for column in range(target.size):
        target[column] = source[column]


@kernel
def close_contact(c, contact, velocity, mass, gained, rows):
    """Move an ended contact from the per-atom row to the ledger; the particle carries `gained` (kg) on.

    Paper: Eq. (24) tangentially: (m + dm) v' = m v.  Returns `gained`, or minus an error code.
    """
    contact[PHASE] = FREE
    if c.rows == rows.shape[0]:
        return -LEDGER_FULL
    if gained > 0.0:
        for axis in range(3):
            velocity[axis] *= mass / (mass + gained)
    copy_row(contact, rows[c.rows])
    c.rows += 1
    return gained


@kernel
def soft_contact(c, time, acts, position, v_half, v_free, mass, radius, tag, modulus, heights, contact, rows):
    """Spring-dashpot contact with the surface: (force in N, three components; mass gained in kg).

    F = max(0, k x - c v_n), with v_n at the time of the overlap x: `v_free` is the velocity there without
    this force.  Opens at overlap and approach, closes when the force vanishes; removal is committed then.
    A negative mass is minus an error code.
    """
    model = c.model
    found, overlap, nx, ny, nz, qx, qy, qz, _ = surface_contact(
        heights, model.spacing, position[0], position[1], position[2], radius
    )
    v_n = v_free[0] * nx + v_free[1] * ny + v_free[2] * nz
    if overlap > 2.0 * radius:
        return 0.0, 0.0, 0.0, -TUNNELLED
    overlaps = found and overlap > 0.0
    if contact[PHASE] != TOUCHING:
        if not (overlaps and v_n < 0.0):
            return 0.0, 0.0, 0.0, 0.0
        record_surface_impact(
            model, 0.0, time, tag - 1, (nx, ny, nz, qx, qy, qz), position, v_free, mass, 2.0 * radius,
            modulus, contact[: rows.shape[1]],
        )  # fmt: skip
        contact[PHASE] = TOUCHING
    force = 0.0
    if overlaps:
        force = mass * (c.spring * overlap - c.damping * v_n) / (1.0 + c.damping * c.lag)
    if force > 0.0:
        contact[col.NORMAL_IMPULSE] += force * acts
        contact[col.CONTACT_TIME] += acts
        contact[col.ENERGY_LOST] -= force * acts * (v_n + c.lag * force / mass)
        return force * nx, force * ny, force * nz, 0.0
    gained = contact[col.REMOVED_MASS] if model.mass_pickup else 0.0
    square = v_half[0] ** 2 + v_half[1] ** 2 + v_half[2] ** 2
    contact[col.ENERGY_LOST] += 0.5 * mass * square * gained / (mass + gained)
    return 0.0, 0.0, 0.0, close_contact(c, contact, v_half, mass, gained, rows)


@kernel
def impulse_contact(
    c, step, acts, waits, position, v_half, mass, radius, tag, modulus, heights, contact, rows
):  # fmt: skip
    """Impulsive contact with the surface: (force in N, three components; mass gained in kg).

    Paper: Eqs. (29)-(31).  The force J/dt acts for one step, after a native pair force on the particle
    (`waits`) has ended, or after two contact durations.  A negative mass is minus an error code.
    """
    model = c.model
    found, overlap, nx, ny, nz, qx, qy, qz, _ = surface_contact(
        heights, model.spacing, position[0], position[1], position[2], radius
    )
    if overlap > 2.0 * radius:
        return 0.0, 0.0, 0.0, -TUNNELLED
    v_n = v_half[0] * nx + v_half[1] * ny + v_half[2] * nz
    if not (found and overlap > 0.0 and v_n < 0.0):
        contact[PHASE] = FREE
        return 0.0, 0.0, 0.0, 0.0
    if contact[PHASE] == FREE:
        contact[PHASE], contact[START] = WAITING, step
    if waits and (step - contact[START]) * c.time_step < c.patience:
        return 0.0, 0.0, 0.0, 0.0
    record_surface_impact(
        model, 0.0, contact[START] * c.time_step, tag - 1, (nx, ny, nz, qx, qy, qz), position, v_half, mass,
        2.0 * radius, modulus, contact[: rows.shape[1]],
    )  # fmt: skip
    duration = contact[col.DURATION]
    ext = compression_impulse(contact[col.EXTERNAL_FORCE], duration, acts, model.restitution)
    j = surface_normal_impulse(mass, v_n, model.restitution, ext)
    gained = contact[col.REMOVED_MASS] if model.mass_pickup else 0.0
    contact[col.NORMAL_IMPULSE], contact[col.CONTACT_TIME] = j, min(duration, acts)
    contact[col.ENERGY_LOST] = impact_energy_lost(mass, gained, v_half, v_n, j)
    force = j / acts
    return force * nx, force * ny, force * nz, close_contact(c, contact, v_half, mass, gained, rows)


@kernel
def fail(c, code, step, tag, force):
    """Note the first error, and leave no force behind."""
    if c.error == NO_ERROR:
        c.error, c.error_step, c.error_tag = code, step, tag
    force[:] = 0.0


@kernel
def advance_particles(c, step, tags, x, v, f, radius, mass, state, force, modulus, heights, rows):
    """Fill `force` (n, 3) with the forces of this step, in LAMMPS units; finished contacts go to `rows`.

    Arrays of the rank's own atoms, in LAMMPS units: x, v, f (n, 3), radius, mass (n,); state
    (n, STATE_COLUMNS).  `v` and `mass` change when a particle picks up material.  `heights` is only read.
    Every `run` evaluates the last step of the one before again: it gets the same forces, and nothing else.
    """
    dt, model = c.time_step, c.model
    c.lag = 0.0
    for i in range(tags.size):
        contact = state[i]
        if contact[EVALUATED] == step + 1:
            force[i] = contact[FORCE : FORCE + 3]
            continue
        c.lag = 0.5 * dt if contact[EVALUATED] > 0.0 else 0.0  # the first velocities are of full steps
        acts = 0.5 * dt + c.lag  # the first force acts for half a step
        contact[EVALUATED] = step + 1
        px, py, pz, radius_i = x[i, 0] * MICRO, x[i, 1] * MICRO, x[i, 2] * MICRO, radius[i] * MICRO
        vx, vy, vz, m = v[i, 0], v[i, 1], v[i, 2], mass[i] * PICOGRAM
        gx, gy, gz = f[i, 0] * NANO, f[i, 1] * NANO, f[i, 2] * NANO
        if not math.isfinite(px + py + pz + vx + vy + vz + gx + gy + gz + m):
            fail(c, NOT_FINITE, step, tags[i], force)
            return
        if c.form == OBSERVE:
            force[i] = 0.0
            contact[FORCE : FORCE + 3] = 0.0
            continue
        ex, ey, ez = drag_now(model, c.lag, pz, vx, vy, vz, m, 2.0 * radius_i)
        sx, sy, sz, gained = 0.0, 0.0, 0.0, 0.0
        if model.has_surface and (pz - radius_i < c.highest or contact[PHASE] != FREE):
            if c.form == IMPULSE:
                waits = gx != 0.0 or gy != 0.0 or gz != 0.0
                sx, sy, sz, gained = impulse_contact(
                    c, step, acts, waits, (px, py, pz), v[i], m, radius_i, tags[i],
                    modulus[tags[i] - 1], heights, contact, rows,
                )  # fmt: skip
            else:
                ahead = c.lag / m
                v_free = (vx + ahead * (ex + gx), vy + ahead * (ey + gy), vz + ahead * (ez + gz))
                sx, sy, sz, gained = soft_contact(
                    c, step * dt, acts, (px, py, pz), v[i], v_free, m, radius_i, tags[i],
                    modulus[tags[i] - 1], heights, contact, rows,
                )  # fmt: skip
            if gained < 0.0:
                fail(c, -int(gained), step, tags[i], force)
                return
            mass[i] += gained / PICOGRAM
        force[i, 0], force[i, 1], force[i, 2] = (ex + sx) / NANO, (ey + sy) / NANO, (ez + sz) / NANO
        contact[FORCE : FORCE + 3] = force[i]


@kernel
def remove_in_order(c, heights, rows, first, last):
    """Lower the surface by the impacts of ledger rows first ... last - 1, in the order of particles.

    The order does not depend on how the atoms are stored, nor on how many ranks there are.
    """
    for row in range(first + 1, last):
        slot = row
        while slot > first and rows[slot - 1, col.I] > rows[slot, col.I]:
            for column in range(rows.shape[1]):
                rows[slot - 1, column], rows[slot, column] = rows[slot, column], rows[slot - 1, column]
            slot -= 1
    return commit_removal(c.model, heights, rows, first, last)
