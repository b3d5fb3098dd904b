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
from reference.compiled import inlined, kernel
from reference.contact import surface_normal_impulse
from reference.fast.ceiling import REMAP, ceiling_over, highest_node, raise_ceiling
from reference.fast.events import bounce, record_pad, record_pair, strike, take_off
from reference.fast.near import (
    FACTS,
    NARROW,
    WIDE,
    F,
    Origin,
    farthest,
    fastest,
    list_narrow_of,
    list_wide,
    lists_of,
    mean,
    nearest_image,
    settle,
)
from reference.fast.pairs import LANES, B, acceleration, batch, impulses_of_batch
from reference.fast.particle import fastest_flow, half_period
from reference.fast.swarm import ROW, A, adapt, bring_back, scratch_of, swarm_of, views
from reference.fast.sweep import (
    fast_on_pad,
    glide,
    highest_of,
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
# No array is made in the loop, so that no references need be counted: that alone took a fifth of the time.
loop = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False)


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
    gone: int = 10  # how far a particle may have gone since positions were wrapped, m


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
    way = (1.0 + MARGIN) * AHEAD * dt * fastest_flow(model)
    ceiling = ceiling_over(heights, model.spacing, 0.5 * largest + way)
    origin = Origin(np.empty(n), np.empty(n), np.empty(n))
    lists = lists_of(np.empty((0, 2), np.int64))
    scratch = scratch_of(n, batch())
    run = np.zeros(len(R))
    run[R.left], run[R.spent], run[R.gone] = -1.0, math.inf, math.inf
    while True:
        status = march(
            model, numerics, progress, t_start, dt, steps_left, largest, periods, s, w, origin, lists,
            ceiling, scratch, run, heights, rows,
        )  # fmt: skip
        if status != RELIST:
            break
        lists = lists_of(list_wide(s, largest, periods, origin))
        run[R.spent], run[R.fresh] = 0.0, 1.0
    bring_back(model, s, p, order)
    return status


@inlined
def acceleration_of(model, nonlinear, shear, pad_height, flat, i):
    """`pairs.acceleration` of particle i."""
    return acceleration(
        model, nonlinear, shear, pad_height, flat[A.rate + i], flat[A.mass + i], flat[A.radius + i],
        flat[A.z + i], flat[A.vx + i], flat[A.vy + i], flat[A.vz + i],
    )  # fmt: skip


@inlined
def keep(special, kept, k, i, flat):
    """Have particle i solved by itself, as number k, from where it is now."""
    special[k] = i
    kept[k, 0], kept[k, 1], kept[k, 2] = flat[A.x + i], flat[A.y + i], flat[A.z + i]
    kept[k, 3], kept[k, 4], kept[k, 5] = flat[A.vx + i], flat[A.vy + i], flat[A.vz + i]
    kept[k, 6], kept[k, 7], kept[k, 8] = flat[A.jx + i], flat[A.jy + i], flat[A.jz + i]


@loop
def march(
    model, numerics, progress, t_start, dt, last_step, largest, periods, s, w, origin, lists, ceiling,
    scratch, run, heights, rows,
):  # fmt: skip
    """Make steps until all are made, or until something is in the way; see `advance_few`.

    No array is made here: Numba would count references to it at every step.
    """
    n = scratch.special.shape[0]
    flat = s.flat
    f = views(flat, ROW, s.x.size)
    due, after, before, first = w.due, w.after, w.before, w.first
    renewed, nonlinear, close, number = w.renewed, w.nonlinear, w.close, w.number
    until, looked, changed = w.until, w.looked, w.changed
    narrow, facts = lists.narrow, lists.facts
    meeting, c, bits = scratch.meeting, scratch.batch, scratch.bits
    touched, touch_step = scratch.touched, scratch.touch_step
    thrown, special = scratch.thrown, scratch.special
    kept = scratch.kept
    position, velocity = scratch.position, scratch.velocity
    per_spacing = 1.0 / model.spacing if model.has_surface else 0.0
    half_x, half_y, half_z = (
        half_period(model.length_x), half_period(model.length_y), half_period(model.length_z)
    )  # fmt: skip
    top_x, top_y = highest_node(heights)
    highest = heights[top_x, top_y] if model.has_surface else 0.0
    skin = NARROW * largest
    room = WIDE * largest - skin
    left, spent, speed = run[R.left], run[R.spent], run[R.speed]
    mean_x, mean_y, near = run[R.mean_x], run[R.mean_y], int(run[R.near])
    some_nonlinear, fresh, gone = int(run[R.nonlinear]), run[R.fresh] > 0.0, run[R.gone]
    drift = math.hypot(mean_x, mean_y)
    pairs = model.has_pairs and n > 1
    margin = MARGIN * fastest_flow(model)
    couette = model.flow == FLOW_COUETTE
    flow_x, flow_y, flow_z = (0.0, 0.0, 0.0) if couette else (model.flow_x, model.flow_y, model.flow_z)
    slip_limit = (model.viscosity / model.fluid_density) ** 2 if model.fluid_density > 0.0 else math.inf
    quarter = 0.5 * min(half_x, half_y)
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
        if fresh or (pairs and left < 2.0 * dt * speed) or gone + dt * (speed + drift) > quarter:
            settle(s, 0, n, periods)
            if pairs and not fresh:
                spent += skin - left + 2.0 * dt * speed
                if spent > room and spent < math.inf:
                    spent = 2.0 * farthest(s, origin, periods)
                if not spent <= room:
                    status = RELIST
                    break
            if fresh:
                mean_x, mean_y = mean(f.vx, n), mean(f.vy, n)
                drift = math.hypot(mean_x, mean_y)
                for k in range(n):
                    flat[A.pace + k] = fastest(
                        flat[A.x_low + k], flat[A.x_high + k], flat[A.y_low + k], flat[A.y_high + k],
                        flat[A.z_low + k], flat[A.z_high + k], mean_x, mean_y,
                    )  # fmt: skip
                fresh = False
            near = list_narrow_of(s, lists, skin, periods, 0, lists.narrow.size // 2)
            left, gone, speed = skin, 0.0, highest_of(flat[A.pace : A.pace + n])
        else:
            left -= 2.0 * dt * speed
            gone += dt * (speed + drift)
        if row + near + 2 * n > rows.shape[0]:
            status = LEDGER_FULL
            break
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), above, ceiling.across)
            mapped = step
        n_touched, n_thrown, n_special, begin = 0, 0, 0, row

        # bounds for those whose time is up, and their contacts with the surface
        listed = first[step % HORIZON]
        first[step % HORIZON] = -1
        while listed >= 0:
            i = np.uint32(listed)
            listed = after[i]
            x, y, z = wrap(flat[A.x + i], model.length_x), wrap(flat[A.y + i], model.length_y), flat[A.z + i]
            vx, vy, vz = flat[A.vx + i], flat[A.vy + i], flat[A.vz + i]
            mass, radius, modulus = flat[A.mass + i], flat[A.radius + i], flat[A.modulus + i]
            x_low, x_high, y_low = flat[A.x_low + i], flat[A.x_high + i], flat[A.y_low + i]
            y_high, z_low, z_high = flat[A.y_high + i], flat[A.z_low + i], flat[A.z_high + i]
            again = step < renewed[i] and x_low <= vx and vx <= x_high
            again = again and y_low <= vy and vy <= y_high and z_low <= vz and vz <= z_high
            if not again:
                x_low, x_high, y_low, y_high, z_low, z_high, slip = velocity_box(
                    model, dt, pad_height, margin, flat[A.drag + i], z, vx, vy, vz
                )
                flat[A.x_low + i], flat[A.x_high + i], flat[A.y_low + i] = x_low, x_high, y_low
                flat[A.y_high + i], flat[A.z_low + i], flat[A.z_high + i] = y_high, z_low, z_high
                renewed[i] = step + HORIZON - AHEAD - 1
                flat[A.pace + i] = fastest(x_low, x_high, y_low, y_high, z_low, z_high, mean_x, mean_y)
                speed = max(speed, flat[A.pace + i])
                over = 4.0 * radius * radius * slip > slip_limit
                # nor can the sweep wrap a particle that crosses the box in one step
                over = over or dt * max(z_high, -z_low) >= 2.0 * half_z
                if over != nonlinear[i]:
                    nonlinear[i] = over
                    some_nonlinear += 1 if over else -1
            steps = AHEAD
            if model.has_surface:
                a = min(int(x * per_spacing), changed.shape[0] - 1)
                b = min(int(y * per_spacing), changed.shape[1] - 1)
                clear = z - radius + way * min(z_low, 0.0) >= above[a, b]
                clear = clear and way * max(x_high, -x_low, y_high, -y_low) <= around
                again = again and step <= until[i] and changed[a, b] < looked[i]
                again = again and abs(x - flat[A.looked_x + i]) < half_x
                again = again and abs(y - flat[A.looked_y + i]) < half_y
                touching = False
                if clear:
                    until[i] = -1
                elif again:
                    touching, nx, ny, nz, qx, qy, qz, steps = look_closely(
                        heights, model.spacing, dt, i, x, y, z, radius,
                        x_low, x_high, y_low, y_high, z_low, z_high, AHEAD, close, number,
                    )  # fmt: skip
                    steps = min(steps, until[i] - step)
                else:
                    touching, nx, ny, nz, qx, qy, qz, steps, others = look(
                        heights, model.spacing, dt, i, x, y, z, radius,
                        x_low, x_high, y_low, y_high, z_low, z_high, AHEAD, close, number,
                    )  # fmt: skip
                    until[i], looked[i] = step + others, step
                    flat[A.looked_x + i], flat[A.looked_y + i] = x, y
                closing = -(vx * nx + vy * ny + vz * nz) if touching else 0.0
                if closing > 0.0:
                    if closing >= remarkable:
                        strike(
                            model, dt, time, pad_height, i, (nx, ny, nz, qx, qy, qz), x, y, z, vx, vy, vz,
                            mass, radius, modulus, heights, position, velocity, rows, row,
                        )  # fmt: skip
                        normal, lasting = rows[row, col.NORMAL_IMPULSE], rows[row, col.DURATION]
                        removes = rows[row, col.REMOVED_VOLUME] > 0.0
                        if removes and model.mass_pickup:
                            flat[A.gained + i] = rows[row, col.REMOVED_MASS]
                        if removes or closing >= numerics.ledger_speed:
                            row += 1
                    else:
                        ax, ay, az = acceleration_of(model, nonlinear[i], shear, pad_height, flat, i)
                        normal, lasting = bounce(
                            model, dt, mass, radius, modulus, closing, ax * nx + ay * ny + az * nz
                        )
                    flat[A.jx + i] += normal * nx
                    flat[A.jy + i] += normal * ny
                    flat[A.jz + i] += normal * nz
                    contacts += 1
                    touch_step[i] = step
                    touched[n_touched] = i
                    n_touched += 1
                    if closing > SLOWEST:
                        longest = max(longest, lasting)
            insert(due, after, before, first, i, step + 1 + steps)
        struck = row

        # contacts of pairs, in batches
        pair = 0
        while pair < near:
            met = 0
            while pair < near and met < LANES:  # without branches: whether two touch is hard to foretell
                q = np.uint32(pair)
                i, j = narrow[2 * q], narrow[2 * q + 1]
                dx = flat[A.x + j] - flat[A.x + i] + facts[FACTS * q + F.shift_x]
                dy = flat[A.y + j] - flat[A.y + i] + facts[FACTS * q + F.shift_y]
                dz = nearest_image(flat[A.z + j] - flat[A.z + i], model.length_z, half_z)
                wx, wy = flat[A.vx + j] - flat[A.vx + i], flat[A.vy + j] - flat[A.vy + i]
                wz = flat[A.vz + j] - flat[A.vz + i]
                lane = np.uint32(met)
                meeting[lane] = pair
                c[B.nx + lane], c[B.ny + lane], c[B.nz + lane] = dx, dy, dz
                c[B.vx + lane], c[B.vy + lane], c[B.vz + lane] = wx, wy, wz
                touching = dx * dx + dy * dy + dz * dz < facts[FACTS * q + F.reach]
                met += int(touching & (wx * dx + wy * dy + wz * dz < 0.0))
                pair += 1
            if met == 0:
                break
            for k in range(met):
                q = meeting[k]
                i, j = narrow[2 * q], narrow[2 * q + 1]
                ax, ay, az = acceleration_of(model, nonlinear[i], shear, pad_height, flat, i)
                bx, by, bz = acceleration_of(model, nonlinear[j], shear, pad_height, flat, j)
                c[B.ax + k], c[B.ay + k], c[B.az + k] = ax - bx, ay - by, az - bz
                c[B.mass_i + k], c[B.mass_j + k] = flat[A.mass + i], flat[A.mass + j]
                c[B.rigid + k] = facts[FACTS * q + F.rigid]
            impulses_of_batch(model, dt, c, bits, met)
            contacts += met
            for k in range(met):
                i, j = narrow[2 * meeting[k]], narrow[2 * meeting[k] + 1]
                closing = -c[B.separation + k]
                flat[A.jx + i] += c[B.jx + k]
                flat[A.jy + i] += c[B.jy + k]
                flat[A.jz + i] += c[B.jz + k]
                flat[A.jx + j] -= c[B.jx + k]
                flat[A.jy + j] -= c[B.jy + k]
                flat[A.jz + j] -= c[B.jz + k]
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
        recorded = 0
        if model.has_pad and numerics.ledger_speed <= speed + descent:
            recorded = fast_on_pad(f.z, f.vz, f.radius, pad_height, descent, numerics.ledger_speed)
        if recorded > 0:
            row = record_pad(model, numerics, time, pad_height, descent, n, s, velocity, rows, row)
        for k in range(n_touched):
            i = touched[k]
            z, vx, vy, vz = flat[A.z + i], flat[A.vx + i], flat[A.vy + i], flat[A.vz + i]
            mass, radius = flat[A.mass + i], flat[A.radius + i]
            if model.has_pad:
                flat[A.under_pad + i] = -math.inf
                meets = (z + radius > pad_height) & (vz + descent > 0.0)
                push = surface_normal_impulse(mass, -(vz + descent), model.pad_restitution)
                flat[A.jz + i] -= push if meets else 0.0
                contacts += int(meets)
            per_mass = 1.0 / mass
            wx, wy = vx + flat[A.jx + i] * per_mass, vy + flat[A.jy + i] * per_mass
            wz = vz + flat[A.jz + i] * per_mass
            # drag leads to between this and the fluid's velocity, which is in the box
            inside = (flat[A.x_low + i] <= wx) & (wx <= flat[A.x_high + i])
            inside &= (flat[A.y_low + i] <= wy) & (wy <= flat[A.y_high + i])
            inside &= (flat[A.z_low + i] <= wz) & (wz <= flat[A.z_high + i])
            gains = flat[A.gained + i] > 0.0
            alone = nonlinear[i] or gains
            if not inside:
                # it may be so fast that its drag is not linear, at either end of its way
                here, there = flow_x + shear * z - wx, flow_x + shear * (z + dt * wz) - wx
                slip = max(here * here, there * there) + (flow_y - wy) ** 2 + (flow_z - wz) ** 2
                alone = alone or 4.0 * radius * radius * slip > slip_limit
            if gains or not inside:
                thrown[n_thrown] = i
                n_thrown += 1
            if alone:
                keep(special, kept, n_special, i, flat)
                n_special += 1
            flat[A.vx + i], flat[A.vy + i], flat[A.vz + i] = wx, wy, wz
            flat[A.jx + i], flat[A.jy + i], flat[A.jz + i] = 0.0, 0.0, 0.0
        if some_nonlinear > 0:
            for k in range(n):
                if nonlinear[k] and touch_step[k] != step:
                    keep(special, kept, n_special, k, flat)
                    n_special += 1

        # drag and motion of all
        contacts += glide(
            model, dt, flow_x, flow_y, flow_z, f.x, f.y, f.z, f.vx, f.vy, f.vz, f.yielding, f.under_pad,
            shear, pad_height, descent,
        )  # fmt: skip
        if model.has_pad:
            for k in range(n_touched):
                flat[A.under_pad + touched[k]] = flat[A.radius + touched[k]]

        # those whose drag is not linear, or that gain mass
        for k in range(n_special):
            i = special[k]
            mass, gained, radius, pushed = flat[A.mass + i], flat[A.gained + i], flat[A.radius + i], 0.0
            untouched = touch_step[i] != step  # else the impulse of the pad is in J already
            if untouched and model.has_pad and kept[k, 2] + radius > pad_height:
                pushed = surface_normal_impulse(mass, -(kept[k, 5] + descent), model.pad_restitution)
            wx, wy, wz, _, _, _, solved = solve_particle(
                model, numerics.tolerance, dt, pad_height, kept[k, 2], kept[k, 3], kept[k, 4], kept[k, 5],
                mass, gained, kept[k, 6], kept[k, 7], kept[k, 8] - pushed, 2.0 * radius,
            )  # fmt: skip
            if not math.isfinite(wx + wy + wz):
                status = NOT_FINITE
                progress[P.culprit] = i
            elif not solved:
                status = NOT_CONVERGED
                progress[P.culprit] = i
            if gained > 0.0:
                flat[A.mass + i] += gained
                adapt(s, dt, i)
                flat[A.gained + i] = 0.0
            flat[A.vx + i], flat[A.vy + i], flat[A.vz + i] = wx, wy, wz
            flat[A.x + i], flat[A.y + i] = kept[k, 0] + dt * wx, kept[k, 1] + dt * wy
            flat[A.z + i] = wrap(kept[k, 2] + dt * wz, model.length_z)

        # whose bounds hold no longer
        faster = speed
        for k in range(n_thrown):
            i = thrown[k]
            if due[i] != step + 1 and status == DONE:
                remove(due, after, before, first, i)
                insert(due, after, before, first, i, step + 1)
            flat[A.z + i] = wrap(flat[A.z + i], model.length_z)
            vx, vy, vz = flat[A.vx + i], flat[A.vy + i], flat[A.vz + i]
            faster = max(faster, math.sqrt((vx - mean_x) ** 2 + (vy - mean_y) ** 2 + vz * vz))
            if not math.isfinite(flat[A.x + i] + flat[A.y + i] + flat[A.z + i] + vx + vy + vz):
                status = NOT_FINITE
                progress[P.culprit] = i
        left -= 2.0 * dt * (faster - speed)
        gone += dt * (faster - speed)
        if status != DONE:
            row = begin
            break
        if struck > begin:
            removed = take_off(model, heights, progress, rows, begin, struck, largest, changed, step)
            if removed and heights[top_x, top_y] < highest:
                top_x, top_y = highest_node(heights)
                highest = heights[top_x, top_y]
        step += 1
        progress[P.time] = t_start + step * dt
        if model.has_pad:
            pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
    run[R.step], run[R.left], run[R.spent], run[R.speed] = step, left, spent, speed
    run[R.mean_x], run[R.mean_y], run[R.near], run[R.nonlinear] = mean_x, mean_y, near, some_nonlinear
    run[R.fresh], run[R.mapped], run[R.gone] = 1.0 if fresh else 0.0, mapped, gone
    progress[P.rows] = row
    progress[P.steps] += step - begin_step
    progress[P.contacts] += contacts
    progress[P.largest_ratio] = longest / dt if dt > 0.0 else progress[P.largest_ratio]
    progress[P.pad_height] = pad_height
    return status
