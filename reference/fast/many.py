"""The fast stepper's loop for many particles, in threads: each phase of a step is a loop over pieces.

What is done for one particle is `particle.py`; here are the order of the phases and what they hand on.
Contacts are added up in the order of the pieces, one after another.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from reference import ledger as col
from reference.compiled import inner, kernel
from reference.fast.ceiling import REMAP, highest_node, raise_ceiling
from reference.fast.events import record_pad, record_pair, take_off
from reference.fast.near import WIDE, Origin, farthest, list_narrow_of, list_wide, lists_of, mean, settle
from reference.fast.pairs import LANES, B, batch, next_batch
from reference.fast.particle import (
    COLUMNS,
    box_holds,
    check_thrown,
    depart,
    find_surface,
    hit_surface,
    keep,
    pace_of,
    renew,
    shear_of,
    solve_special,
    speed_apart,
)
from reference.fast.sweep import fast_on_pad, glide, highest_of
from reference.fast.threads import PAIRS, PIECE, pieces_of, piecework, prefetch, threaded
from reference.fast.watch import AHEAD, MOST_CLOSE
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.timestep import DONE, LEDGER_FULL, SLOWEST, P

SETTLE, LIST, WATCH, COLLIDE, MOVE = range(5)  # phases of a step that are shared out
SKIN = 0.3  # of the narrow list, of the largest diameter: among many, one is always fast


class Found(NamedTuple):
    """What the pieces of a step have found among N particles; F pieces."""

    listed: np.ndarray  # (N,), from the first particle of each piece on: who is looked at; then who hits
    hit: np.ndarray  # (N, 6), in the same places: normal and point of contact of those
    hits: np.ndarray  # (F,), how many
    pace: np.ndarray  # (F,), highest speed in a new box, relative to the mean, m/s
    nonlinear: np.ndarray  # (F,), how many more may have drag that is not linear
    met_pad: np.ndarray  # (F,), how many meet it
    thrown: np.ndarray  # (F,), highest speed of those thrown out of their boxes, m/s
    status: np.ndarray  # (F,)
    culprit: np.ndarray  # (F,), the particle that it is about


class Met(NamedTuple):
    """What the pieces of the wide list of P pairs have found; G pieces."""

    near: np.ndarray  # (G,), how many are in the narrow list, from the first pair of the piece on
    pair: np.ndarray  # (P,), in the same places: number in the narrow list of those in contact
    contact: np.ndarray  # (P, 5), impulse of the first one, N s, speed of approach, m/s, and duration, s
    touching: np.ndarray  # (G,), how many of them
    noted: np.ndarray  # (G,), how many of these have a ledger row
    meeting: np.ndarray  # (G, LANES), see `pairs.next_batch`
    batch: np.ndarray  # (G, ...)
    bits: np.ndarray  # the same memory as integers


class Now(NamedTuple):
    """What is the same for all particles in one step."""

    step: int
    pad_height: float  # m
    descent: float  # speed of the pad, m/s
    shear: float  # of a Couette flow, 1/s
    mean_x: float  # velocity that paces are relative to, m/s
    mean_y: float
    some_nonlinear: bool  # whether some may have drag that is not linear
    skin: float  # of the narrow list, m


@inner
def found_of(n):
    """Room for what n particles may do."""
    f = pieces_of(n, PIECE)
    return Found(
        np.empty(n, np.uint32), np.empty((n, 6)), np.zeros(f, np.int64), np.zeros(f), np.zeros(f, np.int64),
        np.zeros(f, np.int64), np.zeros(f), np.zeros(f, np.int64), np.zeros(f, np.int64),
    )  # fmt: skip


@inner
def met_of(pairs):
    """Room for what this many pairs may do."""
    g = pieces_of(pairs, PAIRS)
    batches = np.ones((g, batch().size))
    return Met(
        np.zeros(g, np.int64), np.empty(pairs, np.uint32), np.empty((pairs, 5)), np.zeros(g, np.int64),
        np.zeros(g, np.int64), np.empty((g, LANES), np.uint32), batches, batches.view(np.int64),
    )  # fmt: skip


@piecework
def watch_piece(piece, model, fixed, heights, above, s, w, found, now):
    """Look at the particles of a piece whose time is up: new boxes, and who comes down on the surface."""
    begin, end = piece * PIECE, min((piece + 1) * PIECE, found.listed.size)
    listed, hit, due, known, step = found.listed, found.hit, w.due, w.known, now.step
    count, hits, change, pace = 0, 0, 0, 0.0
    for i in range(begin, end):
        listed[begin + count] = i
        count += int(due[i] <= step)
    for k in range(begin, begin + count):
        i = listed[k]
        prefetch(known, COLUMNS * i)
        prefetch(w.close, 3 * MOST_CLOSE * i)
        prefetch(s.mass, i)
        prefetch(s.drag, i)
    if model.has_surface:
        for k in range(begin, begin + count):
            i = listed[k]
            a = min(max(int(s.x[i] / model.spacing), 0), heights.shape[0] - 1)
            b = min(max(int(s.y[i] / model.spacing), 0), heights.shape[1] - 1)
            prefetch(above[a], b)
            prefetch(w.changed[a], b)
    for k in range(begin, begin + count):
        i = listed[k]
        same_box = box_holds(w.known, i, step, s.vx[i], s.vy[i], s.vz[i])
        if not same_box:
            change += renew(model, fixed, s, w, i, step, now.pad_height, now.mean_x, now.mean_y)
            pace = max(pace, w.pace[i])
        steps = AHEAD
        if model.has_surface:
            touching, nx, ny, nz, qx, qy, qz, steps = find_surface(
                model, fixed, heights, above, s, w, i, step, same_box
            )
            if touching and s.vx[i] * nx + s.vy[i] * ny + s.vz[i] * nz < 0.0:
                at = begin + hits
                listed[at] = i
                hit[at, 0], hit[at, 1], hit[at, 2] = nx, ny, nz
                hit[at, 3], hit[at, 4], hit[at, 5] = qx, qy, qz
                hits += 1
        due[i] = step + 1 + steps
    found.hits[piece], found.nonlinear[piece], found.pace[piece] = hits, change, pace


@piecework
def collide_piece(piece, model, fixed, s, w, lists, met, now, ledger_speed):
    """Find the contacts among the near pairs of a piece, and their impulses."""
    begin = piece * PAIRS
    pair, end = begin, begin + met.near[piece]
    meeting, c, bits = met.meeting[piece], met.batch[piece], met.bits[piece]
    at, noted = begin, 0
    while pair < end:
        pair, count = next_batch(
            model, fixed, s, lists, w.nonlinear, now.shear, now.pad_height, pair, end, meeting, c, bits
        )
        for k in range(count):
            met.pair[at], contact = meeting[k], met.contact[at]
            contact[0], contact[1], contact[2] = c[B.jx + k], c[B.jy + k], c[B.jz + k]
            contact[3], contact[4] = -c[B.separation + k], c[B.duration + k]
            noted += int(contact[3] >= ledger_speed)
            at += 1
    met.touching[piece], met.noted[piece] = at - begin, noted


@piecework
def move_piece(piece, model, numerics, fixed, s, w, scratch, found, now):
    """Move the particles of a piece: pad, drag, and a look in the next step for those thrown out of a box."""
    begin, end = piece * PIECE, min((piece + 1) * PIECE, found.listed.size)
    touch_step, touched, thrown, special = (
        scratch.touch_step, scratch.touched, scratch.thrown, scratch.special
    )  # fmt: skip
    step, shear, pad_height, descent = now.step, now.shear, now.pad_height, now.descent
    touches, throws, specials, met_pad, highest = begin, begin, begin, 0, 0.0
    found.status[piece] = DONE
    for i in range(begin, end):
        if touch_step[i] == step:
            touched[touches] = i
            touches += 1
            meets, leaves, unusual, wx, wy, wz = depart(model, fixed, s, w, i, shear, pad_height, descent)
            met_pad += int(meets)
            if leaves:
                thrown[throws] = i
                throws += 1
            if unusual:
                keep(s, special, scratch.kept, specials, i)
                specials += 1
            s.vx[i], s.vy[i], s.vz[i] = wx, wy, wz
            s.jx[i], s.jy[i], s.jz[i] = 0.0, 0.0, 0.0
        elif now.some_nonlinear and w.nonlinear[i]:
            keep(s, special, scratch.kept, specials, i)
            specials += 1
    last = end if end < found.listed.size else s.x.size
    met_pad += glide(
        model, fixed.dt, fixed.flow_x, fixed.flow_y, fixed.flow_z, s.x[begin:last], s.y[begin:last],
        s.z[begin:last], s.vx[begin:last], s.vy[begin:last], s.vz[begin:last], s.yielding[begin:last],
        s.under_pad[begin:last], shear, pad_height, descent,
    )  # fmt: skip
    for k in range(begin, touches):
        s.under_pad[touched[k]] = s.radius[touched[k]]
    for k in range(begin, specials):
        i = special[k]
        solved = solve_special(
            model, numerics, fixed, s, scratch, k, i, touch_step[i] != step, pad_height, descent
        )
        if solved != DONE:
            found.status[piece], found.culprit[piece] = solved, i
    for k in range(begin, throws):
        i = thrown[k]
        w.due[i] = step + 1
        highest = max(highest, speed_apart(s.vx[i], s.vy[i], s.vz[i], now.mean_x, now.mean_y))
        checked = check_thrown(model, s, i)
        if found.status[piece] == DONE and checked != DONE:
            found.status[piece], found.culprit[piece] = checked, i
    found.met_pad[piece], found.thrown[piece] = met_pad, highest


@piecework
def work(
    phase, piece, now, lists, met, model, numerics, fixed, periods, heights, above, s, w, scratch, found
):  # fmt: skip
    """Do what a phase does with one piece: of particles, or of pairs."""
    if phase == SETTLE:
        settle(s, piece * PIECE, min((piece + 1) * PIECE, found.listed.size), periods)
    elif phase == LIST:
        begin, end = piece * PAIRS, min((piece + 1) * PAIRS, lists.wide.shape[0])
        met.near[piece] = list_narrow_of(s, lists, now.skin, periods, begin, end)
    elif phase == WATCH:
        watch_piece(piece, model, fixed, heights, above, s, w, found, now)
    elif phase == COLLIDE:
        collide_piece(piece, model, fixed, s, w, lists, met, now, numerics.ledger_speed)
    else:
        move_piece(piece, model, numerics, fixed, s, w, scratch, found, now)


@threaded
def share_out(
    phase, pieces, now, lists, met, model, numerics, fixed, periods, heights, above, s, w, scratch, found
):  # fmt: skip
    """`work` for all pieces; one loop for all phases, for each such loop takes long to compile."""
    for piece in numba.prange(pieces):
        work(
            phase, np.int64(piece), now, lists, met, model, numerics, fixed, periods, heights, above, s, w,
            scratch, found,
        )  # fmt: skip


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
    others = (model, numerics, fixed, periods, heights, ceiling.height, s, w, scratch, found)
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
        now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0, skin)
        if (model.has_pairs and left < 2.0 * dt * speed) or gone + dt * (speed + drift) > quarter:
            share_out(np.int64(SETTLE), pieces, now, lists, met, *others)
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
            now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0, skin)
            share_out(np.int64(LIST), met.near.size, now, lists, met, *others)
            left, gone, speed = skin, 0.0, highest_of(w.pace)
        else:
            left -= 2.0 * dt * speed
            gone += dt * (speed + drift)
        if model.has_surface and step >= mapped + REMAP:
            raise_ceiling(heights, int(ceiling.reach / model.spacing + 0.5), ceiling.height, ceiling.across)
            mapped = step

        share_out(np.int64(WATCH), pieces, now, lists, met, *others)
        nonlinear += found.nonlinear.sum()
        speed = max(speed, highest_of(found.pace))
        share_out(np.int64(COLLIDE), met.near.size, now, lists, met, *others)
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

        now = Now(step, pad_height, descent, shear, mean_x, mean_y, nonlinear > 0, skin)
        share_out(np.int64(MOVE), pieces, now, lists, met, *others)
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
