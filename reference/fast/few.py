"""The fast stepper's loop for few particles: the same contacts, impulses and removal as `timestep.advance`.

Where a thing happens is decided here, what happens by the functions of `collisions.py` and `schemes.py`.
Books are kept of contacts and removal; those of the fluid and of energy are the answer key's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from reference import ledger as col
from reference.collisions import commit_removal
from reference.compiled import inlined, kernel
from reference.contact import surface_normal_impulse
from reference.fast.ceiling import REMAP, ceiling_over, highest_node, raise_ceiling
from reference.fast.events import book_removals, bounce, mark, record_pad, record_pair, strike
from reference.fast.near import (
    NARROW,
    WIDE,
    Origin,
    farthest,
    fastest,
    list_narrow_of,
    list_wide,
    lists_of,
    mean,
    nearest_image,
)
from reference.fast.pairs import (
    LANES,
    B,
    acceleration,
    approach,
    batch,
    durations,
    fill_up,
    guess_durations,
    impulses,
)
from reference.fast.swarm import adapt, bring_back, scratch_of, swarm_of
from reference.fast.sweep import (
    fast_on_pad,
    glide_along,
    glide_sheared,
    glide_under_pad,
    glide_upright,
    highest_of,
    wrap_upright,
)
from reference.fast.watch import (
    AHEAD,
    HORIZON,
    MARGIN,
    SAFETY,
    insert,
    look,
    look_closely,
    remove,
    velocity_box,
    watch_all,
)
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.schemes import solve_particle
from reference.state import DEPOSIT_NONE, FLOW_COUETTE
from reference.timestep import DONE, LEDGER_FULL, NOT_CONVERGED, NOT_FINITE, SLOWEST, P, wrap

RELIST = -1  # status: the wide list of pairs has to be made anew
# Divisions by one number may share its reciprocal.  No array is made in the loop, so that no references need
# be counted: that alone took a fifth of the time.
loop = numba.njit(
    cache=True, error_model="numpy", nogil=True, fastmath={"arcp", "contract", "nsz"}, _nrt=False
)


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
    fresh: int = 8  # 1 where the wide list has just been made
    mapped: int = 9  # step in which the map of the surface's maxima was made


R = Run()


@kernel
def advance_few(model, numerics, progress, t_end, steps_left, p, heights, rows):
    """See `stepper.advance_fast`."""
    n = p.position.shape[0]
    t_start = progress[P.time]
    dt = (t_end - t_start) / max(steps_left, 1)
    order = np.arange(n)
    s, w = swarm_of(model, dt, p, order), watch_all(n, heights.shape)
    periods = np.array([model.length_x, model.length_y, model.length_z])
    largest = p.diameter.max() if n > 0 else 0.0
    fastest_flow = max(abs(model.wall_speed), math.hypot(model.flow_x, model.flow_y))
    ceiling = ceiling_over(heights, model.spacing, 0.5 * largest + (1.0 + MARGIN) * AHEAD * dt * fastest_flow)
    origin = Origin(np.empty(n), np.empty(n), np.empty(n))
    lists = lists_of(np.empty((0, 2), np.int64))
    scratch = scratch_of(n, batch())
    run = np.zeros(len(R))
    run[R.left], run[R.spent] = -1.0, math.inf
    while True:
        status = march(
            model, numerics, progress, t_start, dt, steps_left, largest, periods, s, w, origin, lists,
            ceiling, scratch, run, heights, rows,
        )  # fmt: skip
        if status != RELIST:
            break
        lists = lists_of(list_wide(s, largest, periods, origin))
        run[R.spent], run[R.fresh] = 0.0, 1.0
    bring_back(s, p, order)
    return status


@inlined
def keep(special, kept, k, i, x, y, z, vx, vy, vz):
    """Have particle i solved by itself, as number k, from where it is now."""
    special[k] = i
    kept[k, 0], kept[k, 1], kept[k, 2] = x[i], y[i], z[i]
    kept[k, 3], kept[k, 4], kept[k, 5] = vx[i], vy[i], vz[i]


@loop
def march(
    model, numerics, progress, t_start, dt, last_step, largest, periods, s, w, origin, lists, ceiling,
    scratch, run, heights, rows,
):  # fmt: skip
    """Make steps until all are made, or until something is in the way; see `advance_few`.

    No array is made here: Numba would count references to it at every step.
    """
    n = scratch.special.shape[0]
    x, y, z, vx, vy, vz, mass, radius = s.x, s.y, s.z, s.vx, s.vy, s.vz, s.mass, s.radius
    drag, rate, yielding, under_pad, jx, jy, jz = s.drag, s.rate, s.yielding, s.under_pad, s.jx, s.jy, s.jz
    due, after, before, first, box, pace = w.due, w.after, w.before, w.first, w.box, w.pace
    renewed, nonlinear, close, number = w.renewed, w.nonlinear, w.close, w.number
    until, looked, changed, looked_x, looked_y = w.until, w.looked, w.changed, w.looked_x, w.looked_y
    narrow, reach, rigid = lists.narrow, lists.reach, lists.rigid
    meeting, c, bits = scratch.meeting, scratch.batch, scratch.bits
    touched, touch_step, special = scratch.touched, scratch.touch_step, scratch.special
    gained, kept = scratch.gained, scratch.kept
    position, velocity = scratch.position, scratch.velocity
    half_x = 0.5 * model.length_x if model.length_x > 0.0 else math.inf
    half_y = 0.5 * model.length_y if model.length_y > 0.0 else math.inf
    half_z = 0.5 * model.length_z if model.length_z > 0.0 else math.inf
    top_x, top_y = highest_node(heights)
    highest = heights[top_x, top_y] if model.has_surface else 0.0
    skin = NARROW * largest
    room = WIDE * largest - skin
    left, spent, speed = run[R.left], run[R.spent], run[R.speed]
    mean_x, mean_y, near = run[R.mean_x], run[R.mean_y], int(run[R.near])
    some_nonlinear, fresh = int(run[R.nonlinear]), run[R.fresh] > 0.0
    pairs = model.has_pairs and n > 1
    margin = MARGIN * max(abs(model.wall_speed), math.hypot(model.flow_x, model.flow_y))
    couette = model.flow == FLOW_COUETTE
    flow_x, flow_y, flow_z = (0.0, 0.0, 0.0) if couette else (model.flow_x, model.flow_y, model.flow_z)
    slip_limit = (model.viscosity / model.fluid_density) ** 2 if model.fluid_density > 0.0 else math.inf
    crossing = min(2.0 * half_x, 2.0 * half_y)
    crossing_z = 2.0 * half_z
    remarkable = numerics.ledger_speed  # speed from which an impact removes or is noted
    if model.deposit != DEPOSIT_NONE:
        remarkable = min(remarkable, model.threshold_velocity)
    above, mapped, way = ceiling.height, run[R.mapped], AHEAD * dt
    around = SAFETY * ceiling.reach - 0.5 * largest
    pad_height = progress[P.pad_height]
    status, step, row = DONE, int(run[R.step]), int(progress[P.rows])
    begin_step = step
    longest, contacts = progress[P.largest_ratio] * dt, 0
    while step < last_step and status == DONE:
        time = progress[P.time] if step == 0 else t_start + step * dt
        descent, shear = 0.0, 0.0
        if model.has_pad:
            descent = pad_velocity(model, pad_height, lowest_pad_height(model, highest, largest))
        if couette:
            shear = model.wall_speed / (pad_height if model.has_pad else model.gap)
        if pairs and (fresh or left < 2.0 * dt * speed):
            if not fresh:
                spent += skin - left + 2.0 * dt * speed
                if spent > room and spent < math.inf:
                    spent = 2.0 * farthest(s, origin, periods)
                if not spent <= room:
                    status = RELIST
                    break
            if fresh:
                mean_x, mean_y = mean(vx, n), mean(vy, n)
                for i in range(n):
                    pace[i] = fastest(
                        box[i, 0], box[i, 1], box[i, 2], box[i, 3], box[i, 4], box[i, 5], mean_x, mean_y
                    )
                fresh = False
            near = list_narrow_of(s, lists, skin, periods, 0, lists.reach.size)
            left, speed = skin, highest_of(pace)
        else:
            left -= 2.0 * dt * speed
        if row + near + 2 * n > rows.shape[0]:
            status = LEDGER_FULL
            break
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), above, ceiling.across)
            mapped = step
        n_touched, n_special, begin = 0, 0, row

        # bounds for those whose time is up, and their contacts with the surface
        i = first[step % HORIZON]
        first[step % HORIZON] = -1
        while i >= 0:
            following = after[i]
            x_low, x_high, y_low = box[i, 0], box[i, 1], box[i, 2]
            y_high, z_low, z_high = box[i, 3], box[i, 4], box[i, 5]
            again = step < renewed[i] and x_low <= vx[i] and vx[i] <= x_high
            again = again and y_low <= vy[i] and vy[i] <= y_high and z_low <= vz[i] and vz[i] <= z_high
            if not again:
                x_low, x_high, y_low, y_high, z_low, z_high, slip = velocity_box(
                    model, dt, pad_height, margin, drag[i], z[i], vx[i], vy[i], vz[i]
                )
                box[i, 0], box[i, 1], box[i, 2] = x_low, x_high, y_low
                box[i, 3], box[i, 4], box[i, 5] = y_high, z_low, z_high
                renewed[i] = step + HORIZON - AHEAD - 1
                pace[i] = fastest(x_low, x_high, y_low, y_high, z_low, z_high, mean_x, mean_y)
                speed = max(speed, pace[i])
                over = 4.0 * radius[i] * radius[i] * slip > slip_limit
                # nor can the sweep wrap a particle that crosses the box in one step
                over = over or dt * max(x_high, -x_low, y_high, -y_low) >= crossing
                over = over or dt * max(z_high, -z_low) >= crossing_z
                if over != nonlinear[i]:
                    nonlinear[i] = over
                    some_nonlinear += 1 if over else -1
            steps = AHEAD
            if model.has_surface:
                a = min(int(x[i] / model.spacing), changed.shape[0] - 1)
                b = min(int(y[i] / model.spacing), changed.shape[1] - 1)
                clear = z[i] - radius[i] + way * min(z_low, 0.0) >= above[a, b]
                clear = clear and way * max(x_high, -x_low, y_high, -y_low) <= around
                again = again and step <= until[i] and changed[a, b] < looked[i]
                touching = False
                if clear:
                    until[i] = -1
                elif again and abs(x[i] - looked_x[i]) < half_x and abs(y[i] - looked_y[i]) < half_y:
                    touching, nx, ny, nz, qx, qy, qz, steps = look_closely(
                        heights, model.spacing, dt, i, x[i], y[i], z[i], radius[i],
                        x_low, x_high, y_low, y_high, z_low, z_high, AHEAD, close, number,
                    )  # fmt: skip
                    steps = min(steps, until[i] - step)
                else:
                    touching, nx, ny, nz, qx, qy, qz, steps, others = look(
                        heights, model.spacing, dt, i, x[i], y[i], z[i], radius[i],
                        x_low, x_high, y_low, y_high, z_low, z_high, AHEAD, close, number,
                    )  # fmt: skip
                    until[i], looked[i], looked_x[i], looked_y[i] = step + others, step, x[i], y[i]
                closing = -(vx[i] * nx + vy[i] * ny + vz[i] * nz) if touching else 0.0
                if closing > 0.0:
                    if closing >= remarkable:
                        strike(
                            model, dt, time, pad_height, i, (nx, ny, nz, qx, qy, qz), x[i], y[i], z[i],
                            vx[i], vy[i], vz[i], mass[i], radius[i], s.modulus[i], heights, position,
                            velocity, rows, row,
                        )  # fmt: skip
                        normal, lasting = rows[row, col.NORMAL_IMPULSE], rows[row, col.DURATION]
                        removes = rows[row, col.REMOVED_VOLUME] > 0.0
                        if removes and model.mass_pickup:
                            gained[i] = rows[row, col.REMOVED_MASS]
                        if removes or closing >= numerics.ledger_speed:
                            row += 1
                    else:
                        ax, ay, az = acceleration(
                            model, nonlinear[i], shear, pad_height, rate[i], mass[i], radius[i], z[i],
                            vx[i], vy[i], vz[i],
                        )  # fmt: skip
                        normal, lasting = bounce(
                            model, dt, mass[i], radius[i], s.modulus[i], closing, ax * nx + ay * ny + az * nz
                        )
                    jx[i] += normal * nx
                    jy[i] += normal * ny
                    jz[i] += normal * nz
                    contacts += 1
                    touch_step[i] = step
                    touched[n_touched] = i
                    n_touched += 1
                    if closing > SLOWEST:
                        longest = max(longest, lasting)
            insert(due, after, before, first, i, step + 1 + steps)
            i = following
        struck = row

        # contacts of pairs, in batches
        pair = 0
        while pair < near:
            met = 0
            while pair < near and met < LANES:  # without branches: whether two touch is hard to foretell
                i, j = narrow[pair, 0], narrow[pair, 1]
                dx = nearest_image(x[j] - x[i], model.length_x, half_x)
                dy = nearest_image(y[j] - y[i], model.length_y, half_y)
                dz = nearest_image(z[j] - z[i], model.length_z, half_z)
                wx, wy, wz = vx[j] - vx[i], vy[j] - vy[i], vz[j] - vz[i]
                lane = np.uint32(met)
                meeting[lane] = pair
                c[B.nx + lane], c[B.ny + lane], c[B.nz + lane] = dx, dy, dz
                c[B.vx + lane], c[B.vy + lane], c[B.vz + lane] = wx, wy, wz
                touching = dx * dx + dy * dy + dz * dz < reach[pair]
                met += int(touching & (wx * dx + wy * dy + wz * dz < 0.0))
                pair += 1
            if met == 0:
                break
            for k in range(met):
                i, j = narrow[meeting[k], 0], narrow[meeting[k], 1]
                ax, ay, az = acceleration(
                    model, nonlinear[i], shear, pad_height, rate[i], mass[i], radius[i], z[i],
                    vx[i], vy[i], vz[i],
                )  # fmt: skip
                bx, by, bz = acceleration(
                    model, nonlinear[j], shear, pad_height, rate[j], mass[j], radius[j], z[j],
                    vx[j], vy[j], vz[j],
                )  # fmt: skip
                c[B.ax + k], c[B.ay + k], c[B.az + k] = ax - bx, ay - by, az - bz
                c[B.mass_i + k], c[B.mass_j + k], c[B.rigid + k] = mass[i], mass[j], rigid[meeting[k]]
            lanes = fill_up(c, met)
            approach(c, lanes)
            if model.impact_duration > 0.0:
                for k in range(lanes):
                    c[B.duration + k] = model.impact_duration
            else:
                guess_durations(bits, lanes)
                durations(c, lanes)
            impulses(c, lanes, model.restitution, model.static_friction, model.dynamic_friction, dt)
            contacts += met
            for k in range(met):
                i, j = narrow[meeting[k], 0], narrow[meeting[k], 1]
                closing = -c[B.separation + k]
                jx[i] += c[B.jx + k]
                jy[i] += c[B.jy + k]
                jz[i] += c[B.jz + k]
                jx[j] -= c[B.jx + k]
                jy[j] -= c[B.jy + k]
                jz[j] -= c[B.jz + k]
                touched[n_touched] = i
                n_touched += int(touch_step[i] != step)
                touch_step[i] = step
                touched[n_touched] = j
                n_touched += int(touch_step[j] != step)
                touch_step[j] = step
                if closing > SLOWEST:
                    longest = max(longest, c[B.duration + k])
                if closing >= numerics.ledger_speed:
                    record_pair(model, dt, time, pad_height, s, i, j, rows[row])
                    row += 1

        # the pad, of those in contact; their velocities before drag
        recorded = 0.0
        if model.has_pad and numerics.ledger_speed <= speed + descent:
            recorded = fast_on_pad(z, vz, radius, pad_height, descent, numerics.ledger_speed)
        if recorded > 0.0:
            row = record_pad(model, numerics, time, pad_height, descent, n, s, velocity, rows, row)
        for k in range(n_touched):
            i = touched[k]
            if model.has_pad:
                under_pad[i] = -math.inf
                meets = (z[i] + radius[i] > pad_height) & (vz[i] + descent > 0.0)
                push = surface_normal_impulse(mass[i], -(vz[i] + descent), model.pad_restitution)
                jz[i] -= push if meets else 0.0
                contacts += int(meets)
            per_mass = 1.0 / mass[i]
            wx, wy, wz = vx[i] + jx[i] * per_mass, vy[i] + jy[i] * per_mass, vz[i] + jz[i] * per_mass
            # the contacts may have made it so fast that its drag is not linear, at either end of its way
            here, there = flow_x + shear * z[i] - wx, flow_x + shear * (z[i] + dt * wz) - wx
            slip = max(here * here, there * there) + (flow_y - wy) ** 2 + (flow_z - wz) ** 2
            if gained[i] > 0.0 or nonlinear[i] or 4.0 * radius[i] * radius[i] * slip > slip_limit:
                keep(special, kept, n_special, i, x, y, z, vx, vy, vz)
                n_special += 1
            vx[i], vy[i], vz[i] = wx, wy, wz
        if some_nonlinear > 0:
            for i in range(n):
                if nonlinear[i] and touch_step[i] != step:
                    keep(special, kept, n_special, i, x, y, z, vx, vy, vz)
                    n_special += 1

        # drag and motion of all
        if model.has_pad:
            contacts += int(
                glide_under_pad(
                    z, vz, under_pad, yielding, flow_z, dt, pad_height, descent, model.pad_restitution
                )
            )
        else:
            glide_upright(z, vz, yielding, flow_z, dt)
        if couette:
            glide_sheared(x, vx, z, yielding, shear, dt, model.length_x)
        else:
            glide_along(x, vx, yielding, flow_x, dt, model.length_x)
        glide_along(y, vy, yielding, flow_y, dt, model.length_y)
        if model.length_z > 0.0:
            wrap_upright(z, model.length_z)

        # those whose drag is not linear, or that gain mass
        for k in range(n_special):
            i = special[k]
            pushed = 0.0
            untouched = touch_step[i] != step  # else the impulse of the pad is in jz already
            if untouched and model.has_pad and kept[k, 2] + radius[i] > pad_height:
                pushed = surface_normal_impulse(mass[i], -(kept[k, 5] + descent), model.pad_restitution)
            wx, wy, wz, _, _, _, solved = solve_particle(
                model, numerics.tolerance, dt, pad_height, kept[k, 2], kept[k, 3], kept[k, 4], kept[k, 5],
                mass[i], gained[i], jx[i], jy[i], jz[i] - pushed, 2.0 * radius[i],
            )  # fmt: skip
            if not math.isfinite(wx + wy + wz):
                status = NOT_FINITE
                progress[P.culprit] = i
            elif not solved:
                status = NOT_CONVERGED
                progress[P.culprit] = i
            if gained[i] > 0.0:
                mass[i] += gained[i]
                adapt(s, dt, i)
                gained[i] = 0.0
            vx[i], vy[i], vz[i] = wx, wy, wz
            x[i] = wrap(kept[k, 0] + dt * wx, model.length_x)
            y[i] = wrap(kept[k, 1] + dt * wy, model.length_y)
            z[i] = wrap(kept[k, 2] + dt * wz, model.length_z)

        # whose bounds hold no longer
        for k in range(n_touched):
            i = touched[k]
            jx[i], jy[i], jz[i], under_pad[i] = 0.0, 0.0, 0.0, radius[i]
            inside = (box[i, 0] <= vx[i]) & (vx[i] <= box[i, 1])
            inside &= (box[i, 2] <= vy[i]) & (vy[i] <= box[i, 3])
            inside &= (box[i, 4] <= vz[i]) & (vz[i] <= box[i, 5])
            if not inside and status == DONE:
                if due[i] != step + 1:
                    remove(due, after, before, first, i)
                    insert(due, after, before, first, i, step + 1)
                x[i], y[i] = wrap(x[i], model.length_x), wrap(y[i], model.length_y)
                z[i] = wrap(z[i], model.length_z)
                left -= 2.0 * dt * math.sqrt((vx[i] - mean_x) ** 2 + (vy[i] - mean_y) ** 2 + vz[i] ** 2)
                if not math.isfinite(x[i] + y[i] + z[i] + vx[i] + vy[i] + vz[i]):
                    status = NOT_FINITE
                    progress[P.culprit] = i
        if status != DONE:
            row = begin
            break
        if struck > begin:
            if commit_removal(model, heights, rows, begin, struck):
                if heights[top_x, top_y] < highest:
                    top_x, top_y = highest_node(heights)
                    highest = heights[top_x, top_y]
                squares = int(largest / model.spacing) + 2
                for k in range(begin, struck):
                    if rows[k, col.REMOVED_VOLUME] > 0.0:
                        mark(changed, model.spacing, rows[k, col.X], rows[k, col.Y], squares, step)
            book_removals(progress, rows, begin, struck)
        step += 1
        progress[P.time] = t_start + step * dt
        if model.has_pad:
            pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
    run[R.step], run[R.left], run[R.spent], run[R.speed] = step, left, spent, speed
    run[R.mean_x], run[R.mean_y], run[R.near], run[R.nonlinear] = mean_x, mean_y, near, some_nonlinear
    run[R.fresh], run[R.mapped] = 1.0 if fresh else 0.0, mapped
    progress[P.rows] = row
    progress[P.steps] += step - begin_step
    progress[P.contacts] += contacts
    progress[P.largest_ratio] = longest / dt if dt > 0.0 else progress[P.largest_ratio]
    progress[P.pad_height] = pad_height
    return status
