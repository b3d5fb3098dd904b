"""One step of the fix for each particle of this rank: drag, surface, pad and removal (compiled).

Velocity Verlet calls a force at time t with the velocity of t - dt/2, the "half-step" velocity.  Forces that
depend on velocity are evaluated at t to second order: drag at v + (dt/2) E/m, the dashpot implicitly.
An impulse is delivered whole between two half-step velocities, so the impulse form works with those.
The contacts: `contacts.py`, between particles: `pairs.py`.  The same in plain Python: `plain.py`.
"""

from __future__ import annotations

import math

from cmpcheck.fixes.contacts import has_clearance, impulse_contact, impulse_pad, soft_contact, soft_pad
from cmpcheck.fixes.layout import (
    CLEARANCE,
    EVALUATED,
    FORCE,
    FREE,
    IMPULSE,
    MICRO,
    NANO,
    NO_ERROR,
    NOT_FINITE,
    OBSERVE,
    PAD,
    PER_NEWTON,
    PHASE,
    PICOGRAM,
)
from cmpcheck.fixes.sweep import copied, flat, is_free, meet, note_forces, stokes_factor, strangers, sweep
from reference import ledger as col
from reference.collisions import commit_removal, drag_on
from reference.compiled import formula, kernel


@formula
def drag_now(model, pad_height, lag, z, vx, vy, vz, mass, diameter):
    """Drag at the time of the positions, from velocities that are `lag` older; second order in the step.

    Paper: Eqs. (20)-(22).  Stable for steps below twice the relaxation time.
    """
    ex, ey, ez = drag_on(model, pad_height, z, vx, vy, vz, diameter)
    ahead = lag / mass
    return drag_on(model, pad_height, z, vx + ahead * ex, vy + ahead * ey, vz + ahead * ez, diameter)


@kernel
def fail(c, code, step, tag, force):
    """Note the first error, and leave no force behind."""
    if c.error == NO_ERROR:
        c.error, c.error_step, c.error_tag = code, step, tag
    force[:] = 0.0


@kernel
def advance_particles(c, step, tags, x, v, f, radius, mass, state, force, modulus, heights, rows, local):
    """Fill `force` (n, 3) with the forces of this step, in LAMMPS units; finished contacts go to `rows`.

    Arrays of the rank's own atoms, in LAMMPS units: x, v, f (n, 3), radius, mass (n,); state
    (n, STATE_COLUMNS).  `v` and `mass` change when a particle picks up material.  `heights` is only read.
    `local` is a `sweep.Local`.
    Every `run` evaluates the last step of the one before again: it gets the same forces, and nothing else.
    """
    c.lag, c.pushed = 0.0, 0
    if strangers(local.tag, tags) > 0:
        meet(local, tags)
    travel = local.travel[: tags.size]
    usual = 0 <= c.last_step < step and c.form != OBSERVE
    if usual:
        c.lag = 0.5 * c.time_step
        model = copied(c.model)
        sweep(
            model, c.pad_height, c.time_step, stokes_factor(model), flat(x), flat(v), flat(f), radius, mass,
            travel, flat(force),
        )  # fmt: skip
        note_forces(step, force, state)
    for i in range(tags.size):
        if usual and travel[i] > 0.0:
            continue
        contact = state[i]
        contact[CLEARANCE] = -travel[i] if usual else 0.0  # before a run a deck may have moved anything
        error = advance_particle(
            c, step, usual, i, tags[i], x, v, f, radius, mass, contact, force, modulus, heights, rows
        )
        if error != NO_ERROR:
            fail(c, error, step, tags[i], force)
            return
        travel[i] = contact[CLEARANCE] if is_free(contact) else 0.0
    if c.observe_pairs:
        c.pushed = count_pushed(f)


@kernel
def count_pushed(f):
    """How many particles have a native pair force, of `f` (n, 3)."""
    count = 0
    for i in range(f.shape[0]):
        count += (f[i, 0] != 0.0) | (f[i, 1] != 0.0) | (f[i, 2] != 0.0)
    return count


@kernel
def advance_particle(
    c, step, usual, i, tag, x, v, f, radius, mass, contact, force, modulus, heights, rows
):  # fmt: skip
    """Fill `force[i]`, whatever acts; return an error code.  `usual`: it was evaluated before."""
    dt, model = c.time_step, c.model
    if not usual and contact[EVALUATED] == step + 1:
        force[i] = contact[FORCE : FORCE + 3]
        return NO_ERROR
    c.lag = 0.5 * dt if usual or contact[EVALUATED] > 0.0 else 0.0  # the first velocities are of full steps
    acts = 0.5 * dt + c.lag  # the first force acts for half a step
    contact[EVALUATED] = step + 1
    px, py, pz, radius_i = x[i, 0] * MICRO, x[i, 1] * MICRO, x[i, 2] * MICRO, radius[i] * MICRO
    vx, vy, vz, m = v[i, 0], v[i, 1], v[i, 2], mass[i] * PICOGRAM
    gx, gy, gz = f[i, 0] * NANO, f[i, 1] * NANO, f[i, 2] * NANO
    if not math.isfinite(px + py + pz + vx + vy + vz + gx + gy + gz + m):
        return NOT_FINITE
    waits = gx != 0.0 or gy != 0.0 or gz != 0.0
    if c.form == OBSERVE:
        force[i] = 0.0
        contact[FORCE : FORCE + 3] = 0.0
        return NO_ERROR
    ex, ey, ez = drag_now(model, c.pad_height, c.lag, pz, vx, vy, vz, m, 2.0 * radius_i)
    ahead = c.lag / m
    v_free = (vx + ahead * (ex + gx), vy + ahead * (ey + gy), vz + ahead * (ez + gz))
    push = 0.0
    pad = contact[PAD:EVALUATED]
    if model.has_pad and (pz + radius_i > c.pad_height or pad[PHASE] != FREE):
        if c.form == IMPULSE:
            push, error = impulse_pad(
                c, step, acts, waits, (px, py, pz), (vx, vy, vz), m, radius_i, tag, pad, rows
            )
        else:
            push, error = soft_pad(c, step * dt, acts, (px, py, pz), v_free, m, radius_i, tag, pad, rows)
        if error != NO_ERROR:
            return error
    sx, sy, sz, gained = 0.0, 0.0, 0.0, 0.0
    if model.has_surface and not has_clearance(c, (px, py, pz), radius_i, heights, contact):
        if c.form == IMPULSE:
            sx, sy, sz, gained = impulse_contact(
                c, step, acts, waits, (px, py, pz), v[i], m, radius_i, tag, modulus[tag - 1], heights,
                contact, rows,
            )  # fmt: skip
        else:
            sx, sy, sz, gained = soft_contact(
                c, step * dt, acts, (px, py, pz), v[i], v_free, m, radius_i, tag, modulus[tag - 1], heights,
                contact, rows,
            )  # fmt: skip
        if gained < 0.0:
            return -int(gained)
        mass[i] += gained / PICOGRAM
    force[i, 0], force[i, 1] = (ex + sx) * PER_NEWTON, (ey + sy) * PER_NEWTON
    force[i, 2] = (ez + sz - push) * PER_NEWTON
    contact[FORCE : FORCE + 3] = force[i]
    return NO_ERROR


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
    if commit_removal(c.model, heights, rows, first, last):
        c.highest = heights.max()
