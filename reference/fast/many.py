"""The fast stepper's loop for many particles: the order of a step's phases, which threads share out.

What is done with one piece of particles or pairs is `pieces.py`.  Contacts are added up here, in the order of
the pieces, one after another: threads change nothing.
"""

from __future__ import annotations

import math

import numpy as np

from reference import ledger as col
from reference.compiled import inner, kernel
from reference.fast.ceiling import REMAP, highest_node, raise_ceiling
from reference.fast.events import record_pad, record_pair, take_off
from reference.fast.known import pace_of
from reference.fast.near import WIDE, Origin, farthest, list_wide, lists_of, mean
from reference.fast.particle import hit_surface, shear_of
from reference.fast.pieces import COLLIDE, LIST, MOVE, SETTLE, WATCH, Now, found_of, met_of, share_out
from reference.fast.sweep import fast_on_pad, highest_of
from reference.fast.threads import PAIRS, PIECE
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.timestep import DONE, LEDGER_FULL, SLOWEST, P

SKIN = 0.3  # of the narrow list, of the largest diameter: among many, one is always fast


@inner
def push_pairs(model, numerics, fixed, time, pad_height, step, s, scratch, order, lists, met, rows, row):
    """Add up the impulses of the pairs in contact: (next free row, contacts, longest duration in s)."""
    narrow, touch_step, contacts, longest = lists.narrow, scratch.touch_step, 0, 0.0
    for piece in range(met.near.size):
        contacts += met.touching[piece]
        for at in range(piece * PAIRS, piece * PAIRS + met.touching[piece]):
            pair = met.pair[at]
            i, j = narrow[2 * pair], narrow[2 * pair + 1]
            contact = met.contact[at]
            s.jx[i] += contact[0]
            s.jy[i] += contact[1]
            s.jz[i] += contact[2]
            s.jx[j] -= contact[0]
            s.jy[j] -= contact[1]
            s.jz[j] -= contact[2]
            touch_step[i], touch_step[j] = step, step
            if contact[3] > SLOWEST:
                longest = max(longest, contact[4])
            if contact[3] >= numerics.ledger_speed:
                if order[i] > order[j]:
                    i, j = j, i
                record_pair(model, fixed.dt, time, pad_height, s, i, j, rows[row])
                row += 1
    return row, contacts, longest


@kernel
def march_many(
    model, numerics, fixed, progress, t_start, last_step, largest, periods, s, w, ceiling, scratch, order,
    heights, rows,
):  # fmt: skip
    """Make steps until all are made, or until something is in the way; see `stepper.advance_fast`.

    Particles stand cell by cell, so that those next to each other in space are so in memory: particle i is
    the one order[i] for everyone else.
    """
    n, dt = scratch.special.shape[0], fixed.dt
    top_x, top_y = highest_node(heights)
    highest = heights[top_x, top_y] if model.has_surface else 0.0
    skin = SKIN * largest
    room = WIDE * largest - skin
    origin, found = Origin(np.empty(n), np.empty(n), np.empty(n)), found_of(n)
    lists, met = lists_of(np.empty((0, 2), np.int64)), met_of(0)
    pieces = found.hits.size
    # what all phases of the call are given
    same = (model, numerics, fixed, periods, skin, heights, ceiling.height, s, w, scratch, found)
    left, spent, gone, speed, mean_x, mean_y, drift = -1.0, math.inf, math.inf, 0.0, 0.0, 0.0, 0.0
    quarter = 0.5 * min(fixed.half_x, fixed.half_y)
    nonlinear, mapped = 0, 0
    pad_height, row = progress[P.pad_height], int(progress[P.rows])
    first = row
    status, longest = DONE, progress[P.largest_ratio] * dt
    step = int(0.0)  # no literal, which is a type of its own: all would be compiled for both
    while step < last_step and status == DONE:
        time = progress[P.time] if step == 0 else t_start + step * dt
        descent, shear = 0.0, shear_of(model, pad_height)
        if model.has_pad:
            descent = pad_velocity(model, pad_height, lowest_pad_height(model, highest, largest))
        now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0)
        if (model.has_pairs and left < 2.0 * dt * speed) or gone + dt * (speed + drift) > quarter:
            share_out(SETTLE, pieces, now, lists, met, *same)
            spent += skin - left + 2.0 * dt * speed
            if spent > room and spent < math.inf:
                spent = 2.0 * farthest(s, origin, periods)
            if model.has_pairs and not spent <= room:
                lists = lists_of(list_wide(s, largest, periods, origin))
                met = met_of(lists.wide.shape[0])
                spent, mean_x, mean_y = 0.0, mean(s.vx, n), mean(s.vy, n)
                drift = math.hypot(mean_x, mean_y)
                for i in range(n):
                    w.pace[i] = pace_of(w.known, i, mean_x, mean_y)
            share_out(LIST, met.near.size, now, lists, met, *same)
            now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0)  # of a new mean
            left, gone, speed = skin, 0.0, highest_of(w.pace)
        else:
            left -= 2.0 * dt * speed
            gone += dt * (speed + drift)
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), ceiling.height, ceiling.across)
            mapped = step

        share_out(WATCH, pieces, now, lists, met, *same)
        nonlinear += found.nonlinear.sum()
        speed = max(speed, highest_of(found.pace))
        share_out(COLLIDE, met.near.size, now, lists, met, *same)
        on_pad = 0
        if model.has_pad and numerics.ledger_speed <= speed + descent:
            on_pad = fast_on_pad(s.z, s.vz, s.radius, pad_height, descent, numerics.ledger_speed)
        if row + found.hits.sum() + 1 + met.noted.sum() + on_pad > rows.shape[0]:
            status = LEDGER_FULL  # nothing has been changed that the next call does not find out by itself
            break

        begin, contacts = row, 0
        for piece in range(found.hits.size):
            for at in range(piece * PIECE, piece * PIECE + found.hits[piece]):
                i, hit = found.listed[at], found.hit[at]
                closing = -(s.vx[i] * hit[0] + s.vy[i] * hit[1] + s.vz[i] * hit[2])
                row, lasting = hit_surface(
                    model, numerics, fixed, s, w, scratch, heights, i, time, shear, pad_height, closing,
                    hit[0], hit[1], hit[2], hit[3], hit[4], hit[5], rows, row,
                )  # fmt: skip
                scratch.touch_step[i] = step
                contacts += 1
                if closing > SLOWEST:
                    longest = max(longest, lasting)
        struck = row
        row, between, lasting = push_pairs(
            model, numerics, fixed, time, pad_height, step, s, scratch, order, lists, met, rows, row
        )
        longest = max(longest, lasting)
        if on_pad > 0:
            row = record_pad(model, numerics, time, pad_height, descent, n, s, scratch.velocity, rows, row)

        now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0)  # by now
        share_out(MOVE, pieces, now, lists, met, *same)
        faster = max(highest_of(found.thrown) - speed, 0.0)
        left -= 2.0 * dt * faster
        gone += dt * faster
        for piece in range(found.status.size):
            if found.status[piece] != DONE:
                status, progress[P.culprit] = found.status[piece], order[found.culprit[piece]]
        if status != DONE:
            row = begin
            break
        contacts += between + found.met_pad.sum()
        if struck > begin:  # else the model would be handed on for nothing, which takes time
            removed = take_off(model, heights, progress, rows, begin, struck, largest, w.changed, step)
            if removed and heights[top_x, top_y] < highest:
                top_x, top_y = highest_node(heights)
                highest = heights[top_x, top_y]
        progress[P.contacts] += contacts
        step += 1
        progress[P.time] = t_start + step * dt
        if model.has_pad:
            pad_height = lowered_pad(model, pad_height, lowest_pad_height(model, highest, largest), dt)
    for k in range(first, row):
        rows[k, col.I] = order[int(rows[k, col.I])]
        if rows[k, col.KIND] == col.KIND_PAIR:
            rows[k, col.J] = order[int(rows[k, col.J])]
    progress[P.rows] = row
    progress[P.steps] += step
    progress[P.largest_ratio] = longest / dt if dt > 0.0 else progress[P.largest_ratio]
    progress[P.pad_height] = pad_height
    return status
