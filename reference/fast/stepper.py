"""The loop over steps of the fast stepper: the same contacts, impulses and removal as `timestep.advance`.

Where a thing happens is decided here, what happens by the functions of `collisions.py` and `schemes.py`.
Books are kept of contacts and removal; those of the fluid and of energy are the answer key's.
"""

from __future__ import annotations

import math

import numpy as np

from reference import ledger as col
from reference.collisions import (
    commit_removal,
    drag_on,
    impact_energy_lost,
    pair_impulse,
    record_pair_contact,
    strike_surface,
)
from reference.compiled import inlined, kernel
from reference.contact import effective_modulus, surface_normal_impulse
from reference.fast.near import NARROW, WIDE, Origin, farthest, fastest_of_box, list_narrow, list_wide
from reference.fast.swarm import adapt, bring_back, swarm_of
from reference.fast.sweep import (
    fast_on_pad,
    glide_along,
    glide_sheared,
    glide_under_pad,
    glide_upright,
    wrap_upright,
)
from reference.fast.watch import HORIZON, MARGIN, insert, look, new_box, remove, watch_all, within
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.schemes import solve_particle
from reference.state import FLOW_COUETTE
from reference.timestep import DONE, LEDGER_FULL, NOT_CONVERGED, NOT_FINITE, SLOWEST, P, wrap

AHEAD = 32  # steps for which the surroundings of a particle are searched


@inlined
def nearest_image(distance, period, half):
    """`minimum_image` of a difference of two wrapped positions; `half` is half of the period, or infinite."""
    if distance > half:
        return distance - period
    if distance < -half:
        return distance + period
    return distance


@inlined
def drag_on_watched(model, w, s, shear, pad_height, i):
    """External force E on particle i, as `collisions.drag_on` has it, three components in N."""
    if w.stiff[i]:
        return drag_on(model, pad_height, s.z[i], s.vx[i], s.vy[i], s.vz[i], 2.0 * s.radius[i])
    if model.flow == FLOW_COUETTE:
        ux, uy, uz = shear * s.z[i], 0.0, 0.0
    else:
        ux, uy, uz = model.flow_x, model.flow_y, model.flow_z
    k = s.drag[i]
    return k * (ux - s.vx[i]), k * (uy - s.vy[i]), k * (uz - s.vz[i])


@kernel
def record_pad(model, numerics, time, pad_height, descent, n, s, rows, row):
    """Fill a ledger row for each impact on the pad that is worth one; return the next free row."""
    velocity = np.empty(3)
    for i in range(n):
        approach = s.vz[i] + descent
        if s.z[i] + s.radius[i] <= pad_height or approach <= 0.0 or approach < numerics.ledger_speed:
            continue
        velocity[0], velocity[1], velocity[2] = s.vx[i], s.vy[i], s.vz[i]
        normal = surface_normal_impulse(s.mass[i], -approach, model.pad_restitution)
        out = rows[row]
        out[:] = 0.0
        out[col.TIME], out[col.KIND], out[col.I], out[col.J] = time, col.KIND_PAD, i, -1
        out[col.X], out[col.Y], out[col.Z], out[col.NZ] = s.x[i], s.y[i], pad_height, -1.0
        out[col.APPROACH_SPEED], out[col.NORMAL_IMPULSE] = approach, normal
        out[col.ENERGY_LOST] = impact_energy_lost(s.mass[i], 0.0, velocity, -velocity[2], normal)
        row += 1
    return row


@kernel
def advance_fast(model, numerics, progress, t_end, steps_left, p, heights, rows):
    """Advance as `timestep.advance` does, with the scheme `point_implicit`; the same arguments and status."""
    n = p.position.shape[0]
    t_start = progress[P.time]
    dt = (t_end - t_start) / max(steps_left, 1)
    s = swarm_of(model, dt, p)
    w = watch_all(n)
    periods = np.array([model.length_x, model.length_y, model.length_z])
    half_x = 0.5 * model.length_x if model.length_x > 0.0 else math.inf
    half_y = 0.5 * model.length_y if model.length_y > 0.0 else math.inf
    half_z = 0.5 * model.length_z if model.length_z > 0.0 else math.inf
    largest = p.diameter.max() if n > 0 else 0.0
    highest = heights.max() if model.has_surface else 0.0
    origin = Origin(np.empty(n), np.empty(n), np.empty(n))
    wide = np.empty((0, 2), np.int64)
    narrow = np.empty((0, 2), np.int64)
    narrow_skin, left = NARROW * largest, -1.0  # how far pairs may still come nearer
    room, spent = WIDE * largest - narrow_skin, math.inf  # how far pairs may come nearer, and have
    listed, near, fastest, mean_x, mean_y = False, 0, 0.0, 0.0, 0.0
    pairs = model.has_pairs and n > 1
    touched, touch_step = np.empty(n, np.int64), np.full(n, -1)
    stiff, n_stiff = np.empty(n, np.int64), 0
    place = np.full(n, -1)  # in `stiff`
    special, gained = np.empty(n, np.int64), np.zeros(n)
    kept = np.empty((n, 6))
    velocity, position = np.empty(3), np.empty(3)
    margin = MARGIN * max(abs(model.wall_speed), math.hypot(model.flow_x, model.flow_y))
    couette = model.flow == FLOW_COUETTE
    flow_x, flow_y, flow_z = (0.0, 0.0, 0.0) if couette else (model.flow_x, model.flow_y, model.flow_z)
    pad_height = progress[P.pad_height]
    status = DONE
    step = 0
    while step < steps_left:
        used = int(progress[P.rows])
        row = used
        time = progress[P.time]
        descent = 0.0
        if model.has_pad:
            descent = pad_velocity(model, pad_height, lowest_pad_height(model, highest, largest))
        shear = 0.0
        if couette:
            shear = model.wall_speed / (pad_height if model.has_pad else model.gap)
        if used + near + 2 * n > rows.shape[0]:
            status = LEDGER_FULL
            break
        n_touched, n_special = 0, 0
        contacts = 0.0

        # who may touch the surface, and new boxes of velocities
        i = w.first[step % HORIZON]
        while i >= 0:
            following = w.after[i]
            remove(w, i)
            box = w.box[i]
            tight = new_box(model, dt, pad_height, margin, s, i, box)
            if tight != w.stiff[i]:
                w.stiff[i] = tight
                if tight:
                    stiff[n_stiff], place[i] = i, n_stiff
                    n_stiff += 1
                else:
                    n_stiff -= 1
                    stiff[place[i]] = stiff[n_stiff]
                    place[stiff[n_stiff]] = place[i]
            fastest = max(fastest, fastest_of_box(box, mean_x, mean_y))
            steps = AHEAD
            if model.has_surface:
                touching, nx, ny, nz, qx, qy, qz, steps = look(
                    heights, model.spacing, dt, s.x[i], s.y[i], s.z[i], s.radius[i], box, AHEAD
                )
                if touching and s.vx[i] * nx + s.vy[i] * ny + s.vz[i] * nz < 0.0:
                    velocity[0], velocity[1], velocity[2] = s.vx[i], s.vy[i], s.vz[i]
                    position[0], position[1], position[2] = s.x[i], s.y[i], s.z[i]
                    out = rows[row]
                    strike_surface(
                        model, dt, time, pad_height, i, (nx, ny, nz, qx, qy, qz), position, velocity,
                        s.mass[i], 2.0 * s.radius[i], s.modulus[i], heights, out,
                    )  # fmt: skip
                    contacts += 1.0
                    normal = out[col.NORMAL_IMPULSE]
                    s.jx[i] += normal * nx
                    s.jy[i] += normal * ny
                    s.jz[i] += normal * nz
                    touch_step[i] = step
                    touched[n_touched] = i
                    n_touched += 1
                    if model.mass_pickup and out[col.REMOVED_MASS] > 0.0:
                        gained[i] = out[col.REMOVED_MASS]
                        special[n_special] = i
                        n_special += 1
                    if -out[col.APPROACH_SPEED] < -SLOWEST:
                        progress[P.largest_ratio] = max(progress[P.largest_ratio], out[col.DURATION] / dt)
                    if out[col.REMOVED_VOLUME] > 0.0:
                        row += 1
                    elif out[col.APPROACH_SPEED] >= numerics.ledger_speed:
                        row += 1
            insert(w, i, step + 1 + steps)
            i = following
        struck = row

        # who touches whom
        if pairs:
            left -= 2.0 * dt * fastest
            if left < 0.0:
                mean_x, mean_y = s.vx[:n].sum() / n, s.vy[:n].sum() / n
                spent += narrow_skin - left
                if spent > room and listed:
                    spent = 2.0 * farthest(s, origin, periods)
                if not spent <= room:
                    spent = 0.0
                    wide = list_wide(s, largest, periods, origin)
                    narrow = np.empty((wide.shape[0], 2), np.int64)
                    listed = True
                near = list_narrow(s, wide, narrow_skin, periods, narrow)
                fastest = 0.0
                for k in range(n):
                    fastest = max(fastest, fastest_of_box(w.box[k], mean_x, mean_y))
                left = narrow_skin
                if used + near + 2 * n > rows.shape[0]:
                    status = LEDGER_FULL
            for pair in range(near):
                i, j = narrow[pair, 0], narrow[pair, 1]
                dx = nearest_image(s.x[j] - s.x[i], model.length_x, half_x)
                dy = nearest_image(s.y[j] - s.y[i], model.length_y, half_y)
                dz = nearest_image(s.z[j] - s.z[i], model.length_z, half_z)
                square = dx * dx + dy * dy + dz * dz
                reach = s.radius[i] + s.radius[j]
                if square >= reach * reach or square == 0.0:
                    continue
                distance = math.sqrt(square)
                nx, ny, nz = dx / distance, dy / distance, dz / distance
                vx, vy, vz = s.vx[j] - s.vx[i], s.vy[j] - s.vy[i], s.vz[j] - s.vz[i]
                separation = vx * nx + vy * ny + vz * nz
                if separation >= 0.0:
                    continue
                on_i = drag_on_watched(model, w, s, shear, pad_height, i)
                on_j = drag_on_watched(model, w, s, shear, pad_height, j)
                jx, jy, jz, normal, friction, lost, duration, inside, external = pair_impulse(
                    model, dt, s.mass[i], s.mass[j], 2.0 * s.radius[i], 2.0 * s.radius[j],
                    effective_modulus(s.modulus[i], s.modulus[j]), (nx, ny, nz), (vx, vy, vz), separation,
                    on_i, on_j,
                )  # fmt: skip
                contacts += 1.0
                s.jx[i] += jx
                s.jy[i] += jy
                s.jz[i] += jz
                s.jx[j] -= jx
                s.jy[j] -= jy
                s.jz[j] -= jz
                for k in (i, j):
                    if touch_step[k] != step:
                        touch_step[k] = step
                        touched[n_touched] = k
                        n_touched += 1
                if -separation > SLOWEST:
                    progress[P.largest_ratio] = max(progress[P.largest_ratio], duration / dt)
                if -separation >= numerics.ledger_speed:
                    touch = (s.x[i] + s.radius[i] * nx, s.y[i] + s.radius[i] * ny, s.z[i] + s.radius[i] * nz)
                    record_pair_contact(
                        time, i, j, touch, (nx, ny, nz), -separation, normal, friction, lost, duration,
                        inside, external, rows[row],
                    )  # fmt: skip
                    row += 1

        if model.has_pad and numerics.ledger_speed <= fastest + descent:
            if fast_on_pad(s.z, s.vz, s.radius, pad_height, descent, numerics.ledger_speed) > 0.0:
                row = record_pad(model, numerics, time, pad_height, descent, n, s, rows, row)

        # particles whose drag is not linear, or that gain mass, are solved by themselves
        for k in range(n_stiff):
            if gained[stiff[k]] == 0.0:
                special[n_special] = stiff[k]
                n_special += 1
        for k in range(n_special):
            i = special[k]
            kept[k, 0], kept[k, 1], kept[k, 2] = s.x[i], s.y[i], s.z[i]
            kept[k, 3], kept[k, 4], kept[k, 5] = s.vx[i], s.vy[i], s.vz[i]
        for k in range(n_touched):
            i = touched[k]
            s.vx[i] += s.jx[i] / s.mass[i]
            s.vy[i] += s.jy[i] / s.mass[i]
            if model.has_pad:
                s.under_pad[i] = -math.inf
                if s.z[i] + s.radius[i] > pad_height and s.vz[i] + descent > 0.0:
                    s.jz[i] -= surface_normal_impulse(
                        s.mass[i], -(s.vz[i] + descent), model.pad_restitution
                    )
                    contacts += 1.0
            s.vz[i] += s.jz[i] / s.mass[i]
        if model.has_pad:
            contacts += glide_under_pad(
                s.z, s.vz, s.under_pad, s.yielding, flow_z, dt, pad_height, descent, model.pad_restitution
            )
        else:
            glide_upright(s.z, s.vz, s.yielding, flow_z, dt)
        if couette:
            glide_sheared(s.x, s.vx, s.z, s.yielding, shear, dt, model.length_x)
        else:
            glide_along(s.x, s.vx, s.yielding, flow_x, dt, model.length_x)
        glide_along(s.y, s.vy, s.yielding, flow_y, dt, model.length_y)
        if model.length_z > 0.0:
            wrap_upright(s.z, model.length_z)
        for k in range(n_special):
            i = special[k]
            pushed = 0.0
            untouched = touch_step[i] != step  # else the impulse of the pad is in jz already
            if untouched and model.has_pad and kept[k, 2] + s.radius[i] > pad_height:
                pushed = surface_normal_impulse(s.mass[i], -(kept[k, 5] + descent), model.pad_restitution)
            vx, vy, vz, _, _, _, solved = solve_particle(
                model, numerics.tolerance, dt, pad_height, kept[k, 2], kept[k, 3], kept[k, 4], kept[k, 5],
                s.mass[i], gained[i], s.jx[i], s.jy[i], s.jz[i] - pushed, 2.0 * s.radius[i],
            )  # fmt: skip
            if not solved:
                status = NOT_CONVERGED
                progress[P.culprit] = i
            if gained[i] > 0.0:
                s.mass[i] += gained[i]
                adapt(s, dt, i)
                gained[i] = 0.0
            s.vx[i], s.vy[i], s.vz[i] = vx, vy, vz
            s.x[i] = wrap(kept[k, 0] + dt * vx, model.length_x)
            s.y[i] = wrap(kept[k, 1] + dt * vy, model.length_y)
            s.z[i] = wrap(kept[k, 2] + dt * vz, model.length_z)

        for k in range(n_touched):
            i = touched[k]
            s.jx[i], s.jy[i], s.jz[i] = 0.0, 0.0, 0.0
            s.under_pad[i] = s.radius[i]
            if not within(w, i, s.vx[i], s.vy[i], s.vz[i]):
                if w.due[i] != step + 1:
                    remove(w, i)
                    insert(w, i, step + 1)
                if not math.isfinite(s.x[i] + s.y[i] + s.z[i] + s.vx[i] + s.vy[i] + s.vz[i]):
                    status = NOT_FINITE
                    progress[P.culprit] = i
                speed = math.sqrt((s.vx[i] - mean_x) ** 2 + (s.vy[i] - mean_y) ** 2 + s.vz[i] ** 2)
                left -= 2.0 * dt * speed
        if status == NOT_FINITE or status == NOT_CONVERGED:
            break
        if struck > used and model.has_surface and commit_removal(model, heights, rows, used, struck):
            highest = heights.max()
        for k in range(used, struck):
            if rows[k, col.REMOVED_VOLUME] > 0.0:
                progress[P.removals] += 1
                progress[P.removed_volume] += rows[k, col.REMOVED_VOLUME]
                progress[P.removed_mass] += rows[k, col.REMOVED_MASS]
                progress[P.depth_sum] += rows[k, col.DEPTH]
        progress[P.rows] = row
        progress[P.contacts] += contacts
        step += 1
        progress[P.steps] += 1
        progress[P.time] = t_start + step * dt
        if model.has_pad:
            pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
            progress[P.pad_height] = pad_height
        if status == LEDGER_FULL:
            break
    bring_back(s, p)
    return status
