"""One step of the fix for each particle of this rank: drag, surface, pad and removal (compiled).

Velocity Verlet calls a force at time t with the velocity of t - dt/2, the "half-step" velocity.  Forces that
depend on velocity are evaluated at t to second order: drag at v + (dt/2) E/m, the dashpot implicitly.
An impulse is delivered whole between two half-step velocities, so the impulse form works with those.
The contacts: `contacts.py`, between particles: `pairs.py`.  The same in plain Python: `plain.py`.
"""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.fixes.contacts import (
    impulse_contact,
    impulse_pad,
    is_leaving,
    is_waiting,
    look_at_surface,
    soft_contact,
    soft_pad,
)
from cmpcheck.fixes.kernels import in_place, uncounted
from cmpcheck.fixes.layout import (
    CLEARANCE,
    EVALUATED,
    FORCE,
    FREE,
    GIVEN_COLUMNS,
    IMPULSE,
    MICRO,
    NANO,
    NO_ERROR,
    NOT_FINITE,
    OBSERVE,
    PAD,
    PAD_END,
    PER_NEWTON,
    PHASE,
    PICOGRAM,
    SOFT,
)
from cmpcheck.fixes.local import meet, show_contacts, strangers, waiting_since, way_left, way_since
from cmpcheck.fixes.sweep import (
    SURELY,
    list_due,
    stokes_drag,
    stokes_factor,
    sum_up_pushes,
    sweep,
    sweep_with_pad,
    sweep_with_press,
)
from reference import ledger as col
from reference.collisions import commit_removal, drag_on
from reference.compiled import formula, inlined
from reference.state import FLOW_NONE

FEW = 50  # where one particle in so many is at the pad, that is done in the loop over all of them
RECOUNTED = 256  # steps after which their number is asked for again
TOGETHER = 256  # atoms that are swept before the next ones: what they need stays in the first cache


@formula
def drag_now(model, pad_height, lag, z, vx, vy, vz, mass, diameter):
    """Drag at the time of the positions, from velocities that are `lag` older; second order in the step.

    Paper: Eqs. (20)-(22).  Stable for steps below twice the relaxation time.
    """
    ex, ey, ez = drag_on(model, pad_height, z, vx, vy, vz, diameter)
    ahead = lag / mass
    return drag_on(model, pad_height, z, vx + ahead * ex, vy + ahead * ey, vz + ahead * ez, diameter)


@formula
def stokes_now(model, pad_height, lag, z, vx, vy, vz, mass, diameter, per_diameter):
    """`drag_now` where Stokes's law holds: three components, and whether it surely does.

    `per_diameter` as in `sweep`.
    """
    ex, ey, ez, slip = stokes_drag(model, pad_height, lag, z, vx, vy, vz, mass, per_diameter * diameter)
    if model.flow == FLOW_NONE:
        return ex, ey, ez, True
    per_slip = model.fluid_density / model.viscosity * diameter
    return ex, ey, ez, slip * (per_slip * per_slip) <= SURELY


@uncounted
def fail(c, code, step, tag):
    """Note the first error."""
    if c.error == NO_ERROR:
        c.error, c.error_step, c.error_tag = code, step, tag


@inlined
def advance_form(
    form, c, step, adds, tags, x, v, f, radius, mass, state, given, modulus, heights, rows, local, near
):  # fmt: skip
    """`advance_particles` in one form: each is compiled without what the other one needs."""
    if strangers(local.tag, tags) > 0:
        meet(c.model, local, tags, x, radius, state)
    travel, since = local.travel[: tags.size], local.since[: tags.size]
    push, rising = local.push[: tags.size], local.rising[: tags.size]
    usual = 0 <= c.last_step < step
    if usual:
        c.lag = 0.5 * c.time_step
    factor = stokes_factor(c.model)
    strikes, kept = math.inf, -math.inf  # a soft pad also by what else acts
    if form == IMPULSE:
        strikes, kept = c.pad_velocity, c.ledger_speed
    many = c.at_pad * FEW >= tags.size
    if c.many and form == IMPULSE:  # how many there are by now is told by the other loop
        many = step % RECOUNTED != 0
        if not many:
            show_contacts(travel, since)
    c.many, c.at_pad = many, 0
    for begin in range(0, tags.size, TOGETHER):
        end = min(begin + TOGETHER, tags.size)
        count = end - begin
        if usual:
            some, rows_of_three = slice(begin, end), slice(3 * begin, 3 * end)
            arrays = (
                x[rows_of_three], v[rows_of_three], f[rows_of_three], radius[some], mass[some], travel[some],
                since[some], given[slice(GIVEN_COLUMNS * begin, GIVEN_COLUMNS * end)], push[some],
                rising[some],
            )  # fmt: skip
            arguments = (adds, c, step, strikes, kept, factor, *arrays)
            if not many:
                sweep(*arguments)
            elif form == IMPULSE:
                sweep_with_pad(*arguments)
            else:
                sweep_with_press(*arguments)
            count = np.int64(list_due(travel[some], local.due))
            if many and form == SOFT:
                others = np.int64(sum_up_pushes(c, state[some], push[some], rising[some], local.due, count))
                c.at_pad += count - others
                count = others
        for number in range(count):
            i = begin + local.due[number] if usual else begin + number
            contact = state[i]
            if usual and form == IMPULSE and math.copysign(1.0, travel[i]) > 0.0:  # at the surface alone
                waits = f[3 * i] != 0.0 or f[3 * i + 1] != 0.0 or f[3 * i + 2] != 0.0
                if is_waiting(c, step, waits, contact) or is_leaving(
                    c, tags[i] - 1, (x[3 * i] * MICRO, x[3 * i + 1] * MICRO, x[3 * i + 2] * MICRO),
                    (v[3 * i], v[3 * i + 1], v[3 * i + 2]), radius[i] * MICRO, contact, near,
                ):  # fmt: skip
                    if adds:
                        add_given(i, f, given)
                    continue
            seen = local.seen[tags[i] - 1]
            if usual:
                contact[CLEARANCE] = -travel[i]
            else:  # before a run a deck may have moved anything
                contact[CLEARANCE] = way_since(c.model, seen, x[3 * i : 3 * i + 3], radius[i])
                near.place[tags[i] - 1, 3] = -1.0
            error = advance_particle(
                form, c, step, usual, i, tags[i], x, v, f, radius, mass, contact, seen, given, modulus,
                heights, rows, near, factor,
            )  # fmt: skip
            if error != NO_ERROR:
                fail(c, error, step, tags[i])
                return
            travel[i], since[i] = way_left(contact), waiting_since(contact)
            if adds:
                add_given(i, f, given)
    if c.observe_pairs:
        c.pushed = count_pushed(f)


@in_place
def advance_particles(
    c, step, adds, tags, x, v, f, radius, mass, state, given, modulus, heights, rows, local, near
):  # fmt: skip
    """Note the forces of this step in `given`, in LAMMPS units; finished contacts go to `rows`.

    Arrays of the rank's own atoms, in LAMMPS units: x, v, f, rows of three one behind the other, (3 n,);
    radius, mass (n,); state (n, STATE_COLUMNS), given, rows of GIVEN_COLUMNS one behind the other.  `v` and
    `mass` change when a particle picks up material.
    `f` comes with what else acts; when the fix `adds`, it goes with the forces of this step in it. Otherwise
    `add_all` adds them, once the pairs have been observed. After an error they are in it for some or none.
    `heights` is only read.  `local` is a `local.Local`, `near` a `near.Near`.
    Every `run` evaluates the last step of the one before again: it gets the same forces, and nothing else.
    """
    c.lag, c.pushed = 0.0, 0
    if c.form == OBSERVE:
        observe_particles(c, step, tags, x, v, f, mass, given)
        return
    if c.form == IMPULSE:
        advance_form(
            IMPULSE, c, step, adds, tags, x, v, f, radius, mass, state, given, modulus, heights, rows, local,
            near,
        )  # fmt: skip
    else:
        advance_form(
            SOFT, c, step, adds, tags, x, v, f, radius, mass, state, given, modulus, heights, rows, local,
            near,
        )  # fmt: skip


@uncounted
def observe_particles(c, step, tags, x, v, f, mass, given):
    """`advance_particles` where the fix gives nobody a force, and follows contacts of pairs alone."""
    for i in range(tags.size):
        j, row = 3 * i, GIVEN_COLUMNS * i
        if given[row + EVALUATED] == step + 1:
            continue
        c.lag = 0.5 * c.time_step if given[row + EVALUATED] > 0.0 else 0.0
        given[row + EVALUATED] = step + 1
        given[row + FORCE], given[row + FORCE + 1], given[row + FORCE + 2] = 0.0, 0.0, 0.0
        total = x[j] + x[j + 1] + x[j + 2] + v[j] + v[j + 1] + v[j + 2] + f[j] + f[j + 1] + f[j + 2] + mass[i]
        if not math.isfinite(total):
            fail(c, NOT_FINITE, step, tags[i])
            return
    c.pushed = count_pushed(f)


@uncounted
def count_pushed(f):
    """How many particles have a native pair force, of `f` (3 n,)."""
    count = 0
    for i in range(f.size // 3):
        count += (f[3 * i] != 0.0) | (f[3 * i + 1] != 0.0) | (f[3 * i + 2] != 0.0)
    return count


@inlined
def advance_particle(
    form, c, step, usual, i, tag, x, v, f, radius, mass, contact, seen, given, modulus, heights, rows, near,
    factor,
):  # fmt: skip
    """Note the force on atom i in `given`, whatever acts; return an error code.

    `usual`: it was evaluated before.
    """
    dt, model = c.time_step, c.model
    given = given[GIVEN_COLUMNS * i : GIVEN_COLUMNS * (i + 1)]
    if not usual and given[EVALUATED] == step + 1:
        return NO_ERROR
    c.lag = 0.5 * dt if usual or given[EVALUATED] > 0.0 else 0.0  # the first velocities are of full steps
    acts = 0.5 * dt + c.lag  # the first force acts for half a step
    given[EVALUATED] = step + 1
    px, py, pz, radius_i = x[3 * i] * MICRO, x[3 * i + 1] * MICRO, x[3 * i + 2] * MICRO, radius[i] * MICRO
    vx, vy, vz, m = v[3 * i], v[3 * i + 1], v[3 * i + 2], mass[i] * PICOGRAM
    gx, gy, gz = f[3 * i] * NANO, f[3 * i + 1] * NANO, f[3 * i + 2] * NANO
    if not math.isfinite(px + py + pz + vx + vy + vz + gx + gy + gz + m):
        return NOT_FINITE
    waits = gx != 0.0 or gy != 0.0 or gz != 0.0
    ex, ey, ez, calm = stokes_now(model, c.pad_height, c.lag, pz, vx, vy, vz, m, 2.0 * radius_i, factor)
    if not calm:
        ex, ey, ez = drag_now(model, c.pad_height, c.lag, pz, vx, vy, vz, m, 2.0 * radius_i)
    ahead = c.lag / m
    v_free = (vx + ahead * (ex + gx), vy + ahead * (ey + gy), vz + ahead * (ez + gz))
    push = 0.0
    pad = contact[PAD:PAD_END]
    if model.has_pad and (pz + radius_i > c.pad_height or pad[PHASE] != FREE):
        c.at_pad += 1
        if form == IMPULSE:
            push, error = impulse_pad(
                c, step, acts, waits, (px, py, pz), (vx, vy, vz), m, radius_i, tag, pad, rows
            )
        else:
            push, error = soft_pad(c, step * dt, acts, (px, py, pz), v_free, m, radius_i, tag, pad, rows)
        if error != NO_ERROR:
            return error
    sx, sy, sz, gained = 0.0, 0.0, 0.0, 0.0
    if form == IMPULSE and is_waiting(c, step, waits, contact):
        pass
    elif model.has_surface and (contact[PHASE] != FREE or contact[CLEARANCE] <= 0.0):
        speed = abs(vx) + abs(vy) + abs(vz)
        touch = look_at_surface(c, tag - 1, (px, py, pz), speed, radius_i, heights, contact, near)
        seen[0], seen[1], seen[2], seen[3] = px, py, pz, radius_i + contact[CLEARANCE]
        if contact[PHASE] == FREE and contact[CLEARANCE] > 0.0:
            pass  # too far off
        elif form == IMPULSE:
            sx, sy, sz, gained = impulse_contact(
                c, step, acts, waits, touch, (px, py, pz), v[3 * i : 3 * i + 3], m, radius_i, tag,
                modulus[tag - 1], contact, rows,
            )  # fmt: skip
        else:
            sx, sy, sz, gained = soft_contact(
                c, step * dt, acts, touch, (px, py, pz), v[3 * i : 3 * i + 3], v_free, m, radius_i, tag,
                modulus[tag - 1], contact, rows,
            )  # fmt: skip
        if gained < 0.0:
            return -int(gained)
        mass[i] += gained / PICOGRAM
    given[FORCE], given[FORCE + 1] = (ex + sx) * PER_NEWTON, (ey + sy) * PER_NEWTON
    given[FORCE + 2] = (ez + sz - push) * PER_NEWTON
    return NO_ERROR


@inlined
def add_given(i, f, given):
    """Add what the fix gives atom i to its force, in LAMMPS units."""
    for axis in range(3):
        f[3 * i + axis] += given[GIVEN_COLUMNS * i + FORCE + axis]


@uncounted
def add_all(f, given):
    """Add what the fix gives all atoms at this step to their forces; arrays as in `advance_particles`."""
    for i in range(f.size // 3):
        add_given(i, f, given)


@uncounted
def highest_node(heights, bound):
    """The largest of `heights`, none of which is above `bound`: found once one is as high."""
    highest = -math.inf
    for i in range(heights.shape[0]):
        for j in range(heights.shape[1]):
            highest = max(highest, heights[i, j])
            if highest == bound:
                return highest
    return highest


@uncounted
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
        c.falls += 1
        c.highest = highest_node(heights, c.highest)
