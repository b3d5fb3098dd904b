"""The fast stepper's loop for many particles: blocks of steps, which groups of particles make by themselves.

For some steps each particle is allowed a way (`ways.py`), and those that may touch each other on their ways
are a group, which need not know of the others: pieces of whole groups are moved one after another, or by
threads, each in memory of a core's own.  Who went farther, and may have missed somebody, is moved again.
Groups meet in the surface alone, of which each piece lowers a copy.  Where one has lowered it and somebody of
another piece touches it nearby later, both become one group, which is moved again; until nobody does.
"""

from __future__ import annotations

import math

import numpy as np

from reference import ledger as col
from reference.collisions import commit_removal
from reference.compiled import inlined, inner, kernel
from reference.fast.bins import empty_bins, enlist
from reference.fast.ceiling import REMAP, highest_node, raise_ceiling
from reference.fast.events import book_contacts, book_removals, told_of
from reference.fast.groups import GROUP, group_pairs, largest_group, part_out
from reference.fast.harvest import (
    bring_in,
    harvest_of,
    removes,
    row_begins,
    spread_removals,
    steps_until_lowered,
    store,
)
from reference.fast.known import COLUMNS, K, fastest_flow, renew, renew_paces
from reference.fast.near import Origin, list_wide, lists_of, settle, ways_from
from reference.fast.particle import speed_apart
from reference.fast.pieces import Block, World, ends_of, found_of, share_out
from reference.fast.sweep import highest_of
from reference.fast.ways import (
    STEPS,
    WIDE_SKIN,
    Reach,
    admit_strayed,
    allow_ways,
    is_wide_enough,
    list_reachable,
)
from reference.pad import lowered_pad, lowest_pad_height
from reference.timestep import DONE, LEDGER_FULL, P

USED = 0.75  # of the way of the fastest: contacts may make one faster
CROWDED = -3  # status: in one step already so many particles may touch each other that they make no groups


@inner
def renew_all(model, fixed, s, w, pad_height, mean_x, mean_y):
    """Give all particles boxes of velocities before the first step, in which all are looked at."""
    for i in range(w.pace.size):
        renew(model, fixed, s, w, i, 0, pad_height, mean_x, mean_y)
        w.known[COLUMNS * i + K.until] = -1.0


@inner
def quicken(s, pace, mean_x, mean_y):
    """Have no `pace` (N,) be less than what a particle has now: one just thrown is not in its box."""
    for i in range(pace.size):
        pace[i] = max(pace[i], speed_apart(s.vx[i], s.vy[i], s.vz[i], mean_x, mean_y))


@inner
def fewest(found, steps):
    """The fewest steps that a piece has made, `steps` at most, and which piece, or -1."""
    made, worst = steps, -1
    for piece in range(found.made.size):
        if found.made[piece] < made:
            made, worst = found.made[piece], piece
    return made, worst


@inner
def reaches(world, block, speed, drift):
    """How far from a removal it may matter, m: to who touches the surface; to who looks at it.

    Counted from where all are when the block begins; none moves faster than `speed` and `drift` (m/s).
    """
    model, fixed = world.model, world.fixed
    # who may touch a triangle which it lowers, two diagonals of a square away
    close = 0.5 * world.largest + 3.0 * model.spacing + block.way
    # who looks at one, squares around, or is told
    ahead = fixed.way * (speed + drift + fastest_flow(model) + model.pad_descent)
    look = 1.5 * (0.5 * world.largest + ahead) + 3.0 * model.spacing
    return close, block.way + max(look, 1.5 * model.spacing * (told_of(model, world.largest) + 1))


@inner
def predicted(rate, steps):
    """How many ledger rows so many steps may need, at `rate` a step."""
    return int(1.2 * rate * steps) + 1


@inlined
def try_block(world, block, parent, order, tiles, lists, near, reach, speed, ends, rate):
    """Have all particles make the steps of a block: (steps that all can make, harvest, status, culprit).

    Where these are not all of its steps what is known of particles is of no use.
    """
    model, fixed, s, steps = world.model, world.fixed, world.s, block.last - block.first
    n, drift = parent.size, math.hypot(block.mean_x, block.mean_y)
    again, wanted, harvest = np.zeros(n, np.bool_), np.ones(n, np.bool_), harvest_of(n)
    bins, width, run, pieces = empty_bins(0, 1.0, 0.0, 0.0), 0.0, 0, 0
    while True:
        parts = part_out(parent, wanted, order, tiles, lists.narrow, near)
        found = found_of(ends, parts, predicted(rate, steps) / n)
        share_out(
            parts, block, found, model, world.numerics, fixed, world.t_start, world.largest, world.periods, s,
            world.w, world.ceiling, world.heights,
        )  # fmt: skip
        since, pieces = pieces, pieces + parts.cuts.size - 1
        harvest = bring_in(harvest, found, parts, since)
        fewer, worst = fewest(found, steps)
        if fewer < steps:
            return fewer, harvest, found.status[worst], np.int64(found.culprit[worst])
        again[:] = False
        if steps > 1:  # in one step all contacts are where it begins
            near = admit_strayed(s, lists, near, reach, ends.gone, world.periods, parent, again)
            if not is_wide_enough(reach, world.largest):
                return steps // 2, harvest, CROWDED, 0
        if run > 0 or removes(harvest):
            speed = max(speed, highest_of(world.w.pace))
            close, within = reaches(world, block, speed, drift)
            if not within <= width:
                width = 1.1 * within
                bins = empty_bins(n, width, model.length_x, model.length_y)
                everyone = np.arange(n).astype(np.uint32)
                enlist(bins, s, everyone, ends.aware, model.length_x, model.length_y, 0)
            if run > 0:
                enlist(bins, s, parts.member, ends.aware, model.length_x, model.length_y, run)
            spread_removals(harvest, bins, world, ends.met_surface, close, within, parent, again, run, since)
        if not again.any():
            if model.has_pad and model.has_surface:
                fewer = steps_until_lowered(
                    harvest, block.top_x, block.top_y, world.heights.shape, model.spacing, world.t_start,
                    fixed.dt, block.first, steps,
                )  # fmt: skip
            return fewer, harvest, DONE, 0
        if largest_group(parent) > GROUP:
            return steps // 2, harvest, CROWDED, 0
        wanted[:] = False
        for i in range(n):
            wanted[parent[i]] |= again[i]
        run += 1
        block = Block(
            block.first, block.last, block.time, block.pad_height, block.mean_x, block.mean_y, block.top_x,
            block.top_y, block.highest, block.skin, block.way, True,
        )  # fmt: skip


@inner
def commit(s, state, progress, dt):
    """Have all particles where they have got to; count their contacts."""
    contacts, longest = 0.0, 0.0
    for i in range(state.shape[0]):
        s.x[i], s.y[i], s.z[i] = state[i, 0], state[i, 1], state[i, 2]
        s.vx[i], s.vy[i], s.vz[i] = state[i, 3], state[i, 4], state[i, 5]
        s.mass[i] = state[i, 6]
        contacts += state[i, 7]
        longest = max(longest, state[i, 8])
    book_contacts(progress, contacts, longest, dt)


@kernel
def march_many(
    model, numerics, fixed, progress, t_start, last_step, largest, periods, s, w, ceiling, heights, rows,
    order, tiles,
):  # fmt: skip
    """Make steps until all are made, or until something is in the way; see `stepper.advance_fast`.

    Particles stand tile by tile, which begin at `tiles`, so that those next to each other in space are so in
    memory: particle i is the one order[i] for everyone else.
    """
    n, dt = order.size, fixed.dt
    world = World(model, numerics, fixed, t_start, largest, periods, s, w, ceiling, heights)
    top_x, top_y = highest_node(heights)
    highest = heights[top_x, top_y] if model.has_surface else 0.0
    origin, lists = Origin(np.empty(n), np.empty(n), np.empty(n)), lists_of(np.empty((0, 2), np.int64))
    parent, ends, reach = np.empty(n, np.int64), ends_of(n), Reach(np.empty(n), np.zeros(n))
    mean_x, mean_y, listed, rate = 0.0, 0.0, False, 0.0
    pad_height, row = progress[P.pad_height], int(progress[P.rows])
    first_row, mapped, ahead, status = row, 0, STEPS, DONE
    step = int(0.0)  # no literal, which is a type of its own: all would be compiled for both
    while step < last_step:
        settle(s, n, periods)
        if listed:
            ways_from(s, origin, periods, reach.apart)
        steps = min(last_step - step, ahead)
        allow_ways(reach, w.pace, steps, fixed, math.inf)
        if not (listed and is_wide_enough(reach, largest)):
            mean_x, mean_y = renew_paces(s, w.pace)
            quicken(s, w.pace, mean_x, mean_y)
            listed, reach.apart[:], pairs = True, 0.0, list_wide(s, WIDE_SKIN, largest, periods, origin)
            lists = lists_of(pairs if model.has_pairs else pairs[:0])
        if step == 0:
            renew_all(model, fixed, s, w, pad_height, mean_x, mean_y)
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), ceiling.height, ceiling.across)
            mapped = step
        speed = highest_of(w.pace)
        while steps > 1 and predicted(rate, steps) > rows.shape[0] - first_row:
            steps -= 1
        if predicted(rate, steps) > rows.shape[0] - row and row > first_row:
            status = LEDGER_FULL
            break
        time, made, anew = progress[P.time] if step == 0 else t_start + step * dt, False, False
        while not made:
            skin = 2.0 * steps * dt * speed / USED
            allow_ways(reach, w.pace, steps, fixed, 0.5 * skin)
            near = list_reachable(s, lists, reach, periods)
            crowded = group_pairs(parent, lists.narrow, near) > GROUP
            if crowded or (steps > 1 and not is_wide_enough(reach, largest)):
                if steps == 1:
                    status = CROWDED
                    break
                steps //= 2
                continue
            block = Block(
                step, step + steps, time, pad_height, mean_x, mean_y, top_x, top_y, highest, skin,
                0.5 * skin + steps * dt * math.hypot(mean_x, mean_y), anew,
            )  # fmt: skip
            fewer, harvest, failed, culprit = try_block(
                world, block, parent, order, tiles, lists, near, reach, speed, ends, rate
            )
            begins = row_begins(harvest, t_start, dt, step, steps)
            made = fewer == steps
            if made and begins[3 * steps] > rows.shape[0] - row:
                made, failed = False, LEDGER_FULL
                while begins[3 * fewer] > rows.shape[0] - row:
                    fewer -= 1
            if not made:
                if fewer == 0 and steps == 1:
                    status, progress[P.culprit] = failed, order[culprit]
                    break
                steps, anew = max(1, fewer if fewer > 0 else steps // 2), True
                speed = max(speed, highest_of(w.pace))
        if not made:
            break
        end = row + begins[3 * steps]
        store(harvest, begins, t_start, dt, step, rows, row)
        commit(s, ends.state, progress, dt)
        book_removals(progress, rows, row, end)
        for k in range(steps):
            commit_removal(model, heights, rows, row + begins[3 * k], row + begins[3 * k + 1])
            if k == steps - 1 and model.has_surface and heights[top_x, top_y] < highest:
                top_x, top_y = highest_node(heights)
                highest = heights[top_x, top_y]
            if model.has_pad:
                pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
        rate, row, ahead = (end - row) / steps, end, min(STEPS, 2 * steps)
        step += steps
        progress[P.time] = t_start + step * dt
    for k in range(first_row, row):
        rows[k, col.I] = order[int(rows[k, col.I])]
        if rows[k, col.KIND] == col.KIND_PAIR:
            rows[k, col.J] = order[int(rows[k, col.J])]
    progress[P.rows] = row
    progress[P.steps] += step
    progress[P.pad_height] = pad_height
    return status
