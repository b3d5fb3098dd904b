"""The fast stepper's loop for few particles, and for a piece of many: what `timestep.advance` does.

What is done for one particle is `particle.py`, for a batch of pairs `pairs.py`; here are who comes when, and
the order in which it is added up.  Books are kept of contacts and removal; those of the fluid and of energy
are the answer key's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import kernel, uncounted
from reference.fast.ceiling import REMAP, highest_node, raise_ceiling
from reference.fast.events import book_contacts, record_pad, record_pair, take_off
from reference.fast.known import COLUMNS, K, in_box, note_way, renew, renew_paces
from reference.fast.near import (
    NARROW,
    WIDE,
    Origin,
    farthest,
    list_narrow_of,
    list_wide,
    lists_of,
    settle,
    ways_from,
)
from reference.fast.pairs import LANES, B, batch, next_batch
from reference.fast.particle import (
    check_thrown,
    find_surface,
    hit_surface,
    set_apart,
    shear_of,
    solve_special,
    speed_apart,
)
from reference.fast.swarm import ROW, scratch_of, views
from reference.fast.sweep import depart, fast_on_pad, glide, highest_of
from reference.fast.watch import AHEAD, HORIZON, insert, remove, ring_of
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.timestep import DONE, LEDGER_FULL, SLOWEST, P

RELIST = -1  # status: pairs may have come nearer than the list of them allows


class Run(NamedTuple):
    """Scalars that outlive a call of `march`, as one array: these are their indices."""

    step: int = 0
    left: int = 1  # how far pairs may still come nearer until the narrow list is made anew, m
    spent: int = 2  # how far they may have come since the wide one was, m
    speed: int = 3  # of any particle, at most, relative to the mean, m/s
    mean_x: int = 4  # m/s
    mean_y: int = 5
    near: int = 6  # pairs in the narrow list
    nonlinear: int = 7  # particles whose drag may not be linear
    fresh: int = 8  # 1 where the list of pairs has just been made
    mapped: int = 9  # step in which the map of the surface's maxima was made
    gone: int = 10  # how far a particle may have gone since positions were wrapped, m
    top_x: int = 11  # the highest node
    top_y: int = 12
    highest: int = 13  # its height, m
    alone: int = 14  # 1 where there are no other particles than those given


R = Run()


@kernel
def march_few(
    model, numerics, fixed, progress, t_start, last_step, largest, periods, s, w, ceiling, heights, rows
):
    """Make steps until all are made, or until something is in the way; see `stepper.advance_fast`.

    Particles stand in the order of everyone else.
    """
    n = w.pace.size
    ring, origin = ring_of(n), Origin(np.empty(n), np.empty(n), np.empty(n))
    apart, scratch, meeting = np.empty(n), scratch_of(n), np.empty(LANES, np.uint32)
    c, run = batch(), np.zeros(len(R))
    lists = lists_of(np.empty((0, 2), np.int64))
    for i in range(n):
        insert(w.due, ring, i, 0)
    run[R.alone], run[R.spent] = 1.0, math.inf
    top_x, top_y = highest_node(heights)
    run[R.top_x], run[R.top_y] = top_x, top_y
    run[R.highest] = heights[top_x, top_y] if model.has_surface else 0.0
    skin = NARROW * largest
    room = WIDE * largest - skin
    status = RELIST
    while status == RELIST:
        settle(s, n, periods)
        if run[R.spent] < math.inf:
            ways_from(s, origin, periods, apart)
            run[R.spent] = 2.0 * farthest(apart)
        if model.has_pairs and n > 1 and not run[R.spent] <= room:
            lists = lists_of(list_wide(s, WIDE, largest, periods, origin))
            run[R.spent] = 0.0
            run[R.mean_x], run[R.mean_y] = renew_paces(s, w.pace)
        run[R.fresh] = 1.0
        status = march(
            model, numerics, fixed, progress, t_start, last_step, largest, skin, room, periods, s, w, ring,
            lists, ceiling, scratch, meeting, c, c.view(np.int64), run, heights, rows,
        )  # fmt: skip
    book_contacts(progress, s.contacts.sum(), highest_of(s.longest), fixed.dt)
    return status


@uncounted
def march(
    model, numerics, fixed, progress, t_start, last_step, largest, skin, room, periods, s, w, ring, lists,
    ceiling, scratch, meeting, c, bits, run, heights, rows,
):  # fmt: skip
    """Make steps until all are made, or until something is in the way.

    `lists` has the pairs that are within `skin` and `room` (m) of each other when it is made.

    No array is made here: to count references to it at every step took a fifth of the time.
    """
    n, dt = w.pace.size, fixed.dt
    f = views(s.flat, ROW, s.x.size)  # the same as `s`, at distances that the compiler knows
    due, first = w.due, ring.first
    narrow = lists.narrow
    top_x, top_y, alone = int(run[R.top_x]), int(run[R.top_y]), run[R.alone] > 0.0
    highest = run[R.highest]
    left, spent, speed = run[R.left], run[R.spent], run[R.speed]
    mean_x, mean_y, near = run[R.mean_x], run[R.mean_y], int(run[R.near])
    some_nonlinear, fresh, gone = int(run[R.nonlinear]), run[R.fresh] > 0.0, run[R.gone]
    drift = math.hypot(mean_x, mean_y)
    bounded = not alone or (model.has_pairs and n > 1)
    quarter = 0.5 * min(fixed.half_x, fixed.half_y)
    mapped = run[R.mapped]
    pad_height = progress[P.pad_height]
    status, step, row = DONE, int(run[R.step]), int(progress[P.rows])
    begin_step = step
    while step < last_step and status == DONE:
        time = progress[P.time] if step == 0 else t_start + step * dt
        descent, shear = 0.0, shear_of(model, pad_height)
        if model.has_pad:
            descent = pad_velocity(model, pad_height, lowest_pad_height(model, highest, largest))
        if fresh or (bounded and left < 2.0 * dt * speed) or gone + dt * (speed + drift) > quarter:
            if bounded and not fresh:
                spent += skin - left + 2.0 * dt * speed
                if not spent <= room:
                    status = RELIST
                    break
            settle(s, n, periods)
            near = list_narrow_of(s, lists, skin, periods)
            left, gone, speed, fresh = skin, 0.0, highest_of(w.pace), False
        else:
            left -= 2.0 * dt * speed
            gone += dt * (speed + drift)
        if row + near + 2 * n > rows.shape[0]:
            status = LEDGER_FULL
            break
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), ceiling.height, ceiling.across)
            mapped = step
        begin = row

        # bounds for those whose time is up, and their contacts with the surface
        listed = first[step % HORIZON]
        first[step % HORIZON] = -1
        while listed >= 0:
            i = np.uint32(listed)
            listed = ring.after[i]
            same_box = step < w.known[COLUMNS * i + K.renewed] and in_box(f, i, f.vx[i], f.vy[i], f.vz[i])
            if not same_box:
                before = w.pace[i]
                some_nonlinear += renew(model, fixed, f, w, i, step, pad_height, mean_x, mean_y)
                speed = max(speed, w.pace[i])
                if not alone:
                    note_way(w.known, i, step, dt, w.pace[i], before)
            steps = AHEAD
            if model.has_surface:
                touching, nx, ny, nz, qx, qy, qz, steps = find_surface(
                    model, fixed, heights, ceiling.height, f, w, i, step, same_box
                )
                f.met_surface[i] = step if touching else f.met_surface[i]
                closing = -(f.vx[i] * nx + f.vy[i] * ny + f.vz[i] * nz) if touching else 0.0
                if closing > 0.0:
                    row, lasting = hit_surface(
                        model, numerics, fixed, f, w, scratch, heights, i, time, shear, pad_height, closing,
                        nx, ny, nz, qx, qy, qz, rows, row,
                    )  # fmt: skip
                    f.contacts[i] += 1.0
                    if closing > SLOWEST:
                        f.longest[i] = max(f.longest[i], lasting)
            insert(due, ring, i, step + 1 + steps)
        struck = row

        # contacts of pairs, in batches
        pair = 0
        while pair < near:
            pair, met = next_batch(
                model, fixed, f, lists, w.nonlinear, shear, pad_height, pair, near, meeting, c, bits
            )
            for k in range(met):
                i, j = narrow[2 * meeting[k]], narrow[2 * meeting[k] + 1]
                closing = -c[B.separation + k]
                f.jx[i] += c[B.jx + k]
                f.jy[i] += c[B.jy + k]
                f.jz[i] += c[B.jz + k]
                f.jx[j] -= c[B.jx + k]
                f.jy[j] -= c[B.jy + k]
                f.jz[j] -= c[B.jz + k]
                f.contacts[i] += 1.0
                if closing > SLOWEST:
                    f.longest[i] = max(f.longest[i], c[B.duration + k])
                if closing >= numerics.ledger_speed:
                    record_pair(model, dt, time, pad_height, s, i, j, rows[row])
                    row += 1

        # the pad; velocities after contacts, before drag
        recorded = 0
        if model.has_pad and numerics.ledger_speed <= speed + descent:
            recorded = fast_on_pad(f.z, f.vz, f.radius, pad_height, descent, numerics.ledger_speed)
        if recorded > 0:
            row = record_pad(model, numerics, time, pad_height, descent, n, s, scratch.velocity, rows, row)
        outside = depart(
            f.z, f.vx, f.vy, f.vz, f.wx, f.wy, f.wz, f.jx, f.jy, f.jz, f.per_mass, f.radius, f.contacts,
            f.x_low, f.x_high, f.y_low, f.y_high, f.z_low, f.z_high, f.outside,
            pad_height if model.has_pad else math.inf, descent, model.pad_restitution,
        )  # fmt: skip
        n_thrown, n_special = set_apart(fixed, f, w, scratch, shear, outside > 0, some_nonlinear > 0)

        # drag and motion of all
        glide(
            model, dt, fixed.flow_x, fixed.flow_y, fixed.flow_z, f.x, f.y, f.z, f.vx, f.vy, f.vz, f.wx, f.wy,
            f.wz, f.jx, f.jy, f.jz, f.yielding, shear,
        )  # fmt: skip

        # those whose drag is not linear, or that gain mass; and whose bounds hold no longer
        for k in range(n_special):
            i = scratch.special[k]
            solved = solve_special(model, numerics, fixed, f, scratch, k, i, pad_height, descent)
            if solved != DONE:
                status, progress[P.culprit] = solved, i
        faster = speed
        for k in range(n_thrown):
            i = scratch.thrown[k]
            if due[i] != step + 1 and status == DONE:
                remove(due, ring, i)
                insert(due, ring, i, step + 1)
            faster = max(faster, speed_apart(f.vx[i], f.vy[i], f.vz[i], mean_x, mean_y))
            checked = check_thrown(model, f, i)
            if checked != DONE:
                status, progress[P.culprit] = checked, i
        left -= 2.0 * dt * (faster - speed)
        gone += dt * (faster - speed)
        if status != DONE:
            row = begin
            break
        if struck > begin:
            removed = take_off(model, heights, progress, rows, begin, struck, largest, w.changed, step)
            if removed and alone and heights[top_x, top_y] < highest:
                top_x, top_y = highest_node(heights)
                highest = heights[top_x, top_y]
        step += 1
        progress[P.time] = t_start + step * dt
        if model.has_pad:
            pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
    run[R.step], run[R.left], run[R.spent], run[R.speed] = step, left, spent, speed
    run[R.near], run[R.nonlinear] = near, some_nonlinear
    run[R.fresh], run[R.mapped], run[R.gone] = 1.0 if fresh else 0.0, mapped, gone
    run[R.top_x], run[R.top_y], run[R.highest] = top_x, top_y, highest
    progress[P.rows] = row
    progress[P.steps] += step - begin_step
    progress[P.pad_height] = pad_height
    return status
