"""Pieces of many particles, which make some steps each by itself, in memory of a core's own.

How they are made is `groups.py`, how they move `few.march`, what is done with what they have found `many.py`.
What a piece leads to goes to places of its own, so that threads can share pieces out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from reference import ledger as col
from reference.compiled import inlined, inner, shared
from reference.fast.ceiling import Ceiling
from reference.fast.few import R, march
from reference.fast.harvest import WIDTH
from reference.fast.known import COLUMNS, Fixed, K, Watch
from reference.fast.near import FACTS, Lists
from reference.fast.pairs import LANES, batch
from reference.fast.swarm import COMPONENTS, PADDING, ROW, Scratch, Swarm, adapt, rest, scratch_of, views
from reference.fast.threads import prefetch, threaded
from reference.fast.watch import HORIZON, MOST_CLOSE, Ring, insert, ring_of
from reference.timestep import P

CHUNK = 8  # pieces, one after another in the same memory
STATE = 9  # numbers of a particle that its piece leads to: position, velocity, mass, contacts, their duration


class Found(NamedTuple):
    """What F pieces in C chunks have led to, for all N particles."""

    state: np.ndarray  # (N, STATE), SI
    met_surface: np.ndarray  # (N,), whether it touched the surface at any time
    made: np.ndarray  # (F,), steps
    status: np.ndarray  # (F,)
    culprit: np.ndarray  # (F,), the particle that it is about
    rows: np.ndarray  # (C, ..., columns), of the ledger
    used: np.ndarray  # (C,), how many of them


class Block(NamedTuple):
    """Some steps that pieces make: what is the same for all of them."""

    first: int  # step
    last: int  # step, which is not made any more
    time: float  # at its beginning, s
    pad_height: float  # m
    mean_x: float  # velocity that paces are relative to, m/s
    mean_y: float
    top_x: int  # the highest node of the surface
    top_y: int
    highest: float  # its height, m
    skin: float  # m, within which all pairs are known
    frozen: bool  # whether the surface is left as it is
    anew: bool  # whether nothing is known of the particles


class World(NamedTuple):
    """What is the same for all blocks."""

    model: NamedTuple
    numerics: NamedTuple
    fixed: Fixed
    t_start: float  # s
    largest: float  # diameter, m
    periods: np.ndarray
    s: Swarm
    w: Watch
    ceiling: Ceiling
    heights: np.ndarray  # (nx, ny), m


class Desk(NamedTuple):
    """Memory in which one piece after another is moved."""

    flat: np.ndarray  # the swarm
    watch: Watch
    ring: Ring
    scratch: Scratch
    meeting: np.ndarray
    batch: np.ndarray
    run: np.ndarray
    progress: np.ndarray


@inner
def desk_of(n):
    """Memory for pieces of n particles."""
    watch = Watch(
        np.zeros(n, np.int64), np.zeros(COLUMNS * n), np.zeros(n), np.zeros(n, np.bool_),
        np.zeros(3 * MOST_CLOSE * n, np.int32), np.zeros(n, np.int64), np.empty((0, 0), np.int64),
    )  # fmt: skip
    return Desk(
        np.empty(ROW * COMPONENTS), watch, ring_of(n), scratch_of(n), np.empty(LANES, np.uint32), batch(),
        np.zeros(len(R)), np.zeros(2 * len(P)),
    )  # fmt: skip


@inner
def gather(f, v, ring, member, block, world):
    """Bring the particles `member` to the small swarm `f`, and what is known of them to `v`; see `Run`."""
    n, uneven, s, w, heights = member.size, 0, world.s, world.w, world.heights
    above, per_spacing = world.ceiling.height, world.fixed.per_spacing
    for k in range(HORIZON):
        ring.first[k] = -1
    if heights.size > 0:
        for k in range(n):
            i = member[k]
            a, b = int(s.x[i] * per_spacing), min(int(s.y[i] * per_spacing), heights.shape[1] - 1)
            for row in range(a - 2, a + 4):
                prefetch(heights[min(max(row, 0), heights.shape[0] - 1)], b)
            prefetch(above[min(a, heights.shape[0] - 1)], b)
    for k in range(n):
        i = member[k]
        f.x[k], f.y[k], f.z[k], f.vx[k], f.vy[k], f.vz[k] = s.x[i], s.y[i], s.z[i], s.vx[i], s.vy[i], s.vz[i]
        f.mass[k], f.radius[k], f.modulus[k], f.drag[k] = s.mass[i], s.radius[i], s.modulus[i], s.drag[i]
        f.x_low[k], f.x_high[k], f.y_low[k] = s.x_low[i], s.x_high[i], s.y_low[i]
        f.y_high[k], f.z_low[k], f.z_high[k] = s.y_high[i], s.z_low[i], s.z_high[i]
        adapt(f, world.fixed.dt, k)
        for column in range(COLUMNS):
            v.known[COLUMNS * k + column] = w.known[COLUMNS * i + column]
        v.pace[k], v.nonlinear[k], v.number[k] = w.pace[i], w.nonlinear[i], w.number[i]
        due = w.due[i]
        if block.anew:
            v.known[COLUMNS * k + K.renewed], v.known[COLUMNS * k + K.until] = -1.0, -1.0
            due = block.first
        insert(v.due, ring, k, due)
        for at in range(3 * v.number[k]):
            v.close[3 * MOST_CLOSE * k + at] = w.close[3 * MOST_CLOSE * i + at]
        uneven += int(v.nonlinear[k])
    for k in range(n, f.x.size):
        rest(f, k)
    f.jx[:], f.jy[:], f.jz[:] = 0.0, 0.0, 0.0
    f.gained[:], f.contacts[:], f.longest[:], f.met_surface[:] = 0.0, 0.0, 0.0, 0.0
    return uneven


@inner
def scatter(f, v, found, s, w, member):
    """Note where particles have got to, and what is known of them."""
    state = found.state
    for k in range(member.size):
        i = member[k]
        state[i, 0], state[i, 1], state[i, 2] = f.x[k], f.y[k], f.z[k]
        state[i, 3], state[i, 4], state[i, 5] = f.vx[k], f.vy[k], f.vz[k]
        state[i, 6], state[i, 7], state[i, 8] = f.mass[k], f.contacts[k], f.longest[k]
        found.met_surface[i] = f.met_surface[k] > 0.0
        s.x_low[i], s.x_high[i], s.y_low[i] = f.x_low[k], f.x_high[k], f.y_low[k]
        s.y_high[i], s.z_low[i], s.z_high[i] = f.y_high[k], f.z_low[k], f.z_high[k]
        for column in range(COLUMNS):
            w.known[COLUMNS * i + column] = v.known[COLUMNS * k + column]
        w.due[i], w.pace[i], w.nonlinear[i], w.number[i] = v.due[k], v.pace[k], v.nonlinear[k], v.number[k]
        for at in range(3 * v.number[k]):
            w.close[3 * MOST_CLOSE * i + at] = v.close[3 * MOST_CLOSE * k + at]


@inlined
def advance_piece(desk, lists, member, block, found, rows, used, world):
    """Make the steps of a block with one piece: (steps made, status, particle it is about, rows in use)."""
    n, v, progress, run, scratch = member.size, desk.watch, desk.progress, desk.run, desk.scratch
    f = views(desk.flat, ROW, PADDING * ((n + PADDING - 1) // PADDING))
    v = Watch(
        v.due[:n], v.known[: COLUMNS * n], v.pace[:n], v.nonlinear[:n], v.close, v.number[:n],
        world.w.changed,
    )  # fmt: skip
    progress[:], run[:] = 0.0, 0.0
    progress[P.time], progress[P.pad_height], progress[P.rows] = block.time, block.pad_height, used
    run[R.step], run[R.fresh], run[R.mapped] = block.first, 1.0, math.inf
    run[R.mean_x], run[R.mean_y] = block.mean_x, block.mean_y
    run[R.top_x], run[R.top_y], run[R.highest] = block.top_x, block.top_y, block.highest
    run[R.frozen] = 1.0 if block.frozen else 0.0
    run[R.nonlinear] = gather(f, v, desk.ring, member, block, world)
    status = march(
        world.model, world.numerics, world.fixed, progress, world.t_start, block.last, world.largest,
        block.skin, 0.0, world.periods, f, v, desk.ring, lists, world.ceiling, scratch, desk.meeting,
        desk.batch, desk.batch.view(np.int64), run, world.heights, rows,
    )  # fmt: skip
    scatter(f, v, found, world.s, world.w, member)
    last = int(progress[P.rows])
    for row in range(used, last):
        rows[row, col.I] = member[int(rows[row, col.I])]
        if rows[row, col.KIND] == col.KIND_PAIR:
            rows[row, col.J] = member[int(rows[row, col.J])]
    return int(run[R.step]) - block.first, status, member[int(progress[P.culprit])], last


@shared
def advance_chunk(
    chunk, parts, block, found, model, numerics, fixed, t_start, largest, periods, s, w, ceiling, heights,
):  # fmt: skip
    """`advance_piece` for the pieces of one chunk."""
    world = World(model, numerics, fixed, t_start, largest, periods, s, w, ceiling, heights)
    begin, end = chunk * CHUNK, min((chunk + 1) * CHUNK, parts.cuts.size - 1)
    most, most_pairs = 0, 0
    for piece in range(begin, end):
        most = max(most, parts.cuts[piece + 1] - parts.cuts[piece])
        most_pairs = max(most_pairs, parts.pair_cuts[piece + 1] - parts.pair_cuts[piece])
    desk = desk_of(most)
    narrow, facts = np.empty(2 * most_pairs, np.uint32), np.empty(FACTS * most_pairs)
    used = int(0.0)
    for piece in range(begin, end):
        pair = parts.pair[parts.pair_cuts[piece] : parts.pair_cuts[piece + 1]]
        lists = Lists(pair, narrow[: 2 * pair.shape[0]], facts[: FACTS * pair.shape[0]])
        member = parts.member[parts.cuts[piece] : parts.cuts[piece + 1]]
        found.made[piece], found.status[piece], found.culprit[piece], used = advance_piece(
            desk, lists, member, block, found, found.rows[chunk], used, world
        )
    found.used[chunk] = used


@threaded
def share_out(
    parts, block, found, model, numerics, fixed, t_start, largest, periods, s, w, ceiling, heights
):  # fmt: skip
    """`advance_chunk` for all chunks; a threaded loop is not given tuples of tuples, like a world."""
    for chunk in numba.prange(found.used.size):
        advance_chunk(
            np.int64(chunk), parts, block, found, model, numerics, fixed, t_start, largest, periods, s, w,
            ceiling, heights,
        )  # fmt: skip


@inner
def found_of(state, met_surface, parts):
    """Room for what the pieces of `parts` lead to, which goes to `state` and `met_surface`.

    A chunk has room for the contacts of two steps at least, all that there can be; memory that is not used is
    not taken.
    """
    pieces = parts.cuts.size - 1
    chunks = (pieces + CHUNK - 1) // CHUNK
    most = 0
    for chunk in range(chunks):
        begin, end = chunk * CHUNK, min((chunk + 1) * CHUNK, pieces)
        particles = parts.cuts[end] - parts.cuts[begin]
        most = max(most, 2 * particles + parts.pair_cuts[end] - parts.pair_cuts[begin])
    return Found(
        state, met_surface, np.zeros(pieces, np.int64), np.zeros(pieces, np.int64),
        np.zeros(pieces, np.int64), np.empty((chunks, 2 * most, WIDTH)), np.zeros(chunks, np.int64),
    )  # fmt: skip
