"""What a thread does with one piece of many particles, or of their pairs, in each phase of a step.

What is done for one particle is `particle.py`, for a batch of pairs `pairs.py`; the order of the phases is
`many.py`.  What a piece finds goes to places of its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from reference.compiled import inner, uncounted
from reference.fast.known import COLUMNS, box_holds, renew
from reference.fast.near import list_narrow_of, settle
from reference.fast.pairs import LANES, B, batch, next_batch
from reference.fast.particle import (
    check_thrown,
    depart_all,
    find_surface,
    keep,
    solve_special,
    speed_apart,
)
from reference.fast.sweep import glide
from reference.fast.threads import PAIRS, PIECE, pieces_of, prefetch, threaded
from reference.fast.watch import AHEAD, MOST_CLOSE
from reference.timestep import DONE

# phases of a step; typed, for with each literal number all that `share_out` calls would be compiled anew
SETTLE, LIST, WATCH, COLLIDE, MOVE = map(np.int64, range(5))


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


@uncounted
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


@uncounted
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


@uncounted
def move_piece(piece, model, numerics, fixed, s, w, scratch, found, now):
    """Move the particles of a piece: pad, drag, and a look in the next step for those thrown out of a box."""
    begin, end = piece * PIECE, min((piece + 1) * PIECE, found.listed.size)
    touch_step, touched, thrown, special = (
        scratch.touch_step, scratch.touched, scratch.thrown, scratch.special
    )  # fmt: skip
    step, shear, pad_height, descent = now.step, now.shear, now.pad_height, now.descent
    touches, highest = begin, 0.0
    found.status[piece] = DONE
    for i in range(begin, end):
        touched[touches] = i
        touches += int(touch_step[i] == step)
    met_pad, throws, specials = depart_all(
        model, fixed, s, w, scratch, begin, touches, shear, pad_height, descent
    )
    if now.some_nonlinear:
        for i in range(begin, end):
            if w.nonlinear[i] and touch_step[i] != step:
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


@uncounted
def work_on_piece(
    phase, piece, now, lists, met, model, numerics, fixed, periods, skin, heights, above, s, w, scratch,
    found,
):  # fmt: skip
    """Do what a phase does with one piece: of particles, or of pairs."""
    if phase == SETTLE:
        settle(s, piece * PIECE, min((piece + 1) * PIECE, found.listed.size), periods)
    elif phase == LIST:
        begin, end = piece * PAIRS, min((piece + 1) * PAIRS, lists.wide.shape[0])
        met.near[piece] = list_narrow_of(s, lists, skin, periods, begin, end)
    elif phase == WATCH:
        watch_piece(piece, model, fixed, heights, above, s, w, found, now)
    elif phase == COLLIDE:
        collide_piece(piece, model, fixed, s, w, lists, met, now, numerics.ledger_speed)
    else:
        move_piece(piece, model, numerics, fixed, s, w, scratch, found, now)


@threaded
def share_out(
    phase, pieces, now, lists, met, model, numerics, fixed, periods, skin, heights, above, s, w, scratch,
    found,
):  # fmt: skip
    """`work_on_piece` for all pieces; one loop for all phases, for each such loop takes long to compile."""
    for piece in numba.prange(pieces):
        work_on_piece(
            phase, np.int64(piece), now, lists, met, model, numerics, fixed, periods, skin, heights, above,
            s, w, scratch, found,
        )  # fmt: skip
