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
from reference.fast.known import COLUMNS, Fixed, K, Watch, note_way
from reference.fast.near import FACTS, Lists
from reference.fast.pairs import LANES, batch
from reference.fast.particle import speed_apart
from reference.fast.swarm import COMPONENTS, PADDING, ROW, Scratch, Swarm, adapt, rest, scratch_of, views
from reference.fast.threads import threaded
from reference.fast.watch import HORIZON, MOST_CLOSE, Ring, insert, ring_of
from reference.fast.window import copies_of, margin_of, nodes_to, window_of
from reference.timestep import P, wrap

CHUNK = 8  # pieces, one after another in the same memory
STATE = 9  # numbers of a particle that its piece leads to: position, velocity, mass, contacts, their duration


class Ends(NamedTuple):
    """Where each of N particles has got to in a block, and what it did there."""

    state: np.ndarray  # (N, STATE), SI
    met_surface: np.ndarray  # (N,), step in which it last touched the surface, or -1
    gone: np.ndarray  # (N,), how far it has gone at most, relative to the mean of all, m
    aware: np.ndarray  # (N,), whether it has, has looked at it, or knows which triangles it may touch next


class Found(NamedTuple):
    """What F pieces in C chunks have led to: `Ends`, and what there is of pieces and chunks."""

    state: np.ndarray
    met_surface: np.ndarray
    gone: np.ndarray
    aware: np.ndarray
    made: np.ndarray  # (F,), steps
    status: np.ndarray  # (F,)
    culprit: np.ndarray  # (F,), the particle that it is about
    rows: np.ndarray  # of the ledger, chunk by chunk
    begins: np.ndarray  # (C + 1,), where their rows begin
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
    skin: float  # m, by which no two particles may come nearer
    way: float  # m, that a particle moves in it at most
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
    shift_x: np.ndarray  # nodes by which positions in the window differ from those of the surface
    shift_y: np.ndarray
    nodes: np.ndarray  # what is in the window, see `window.copies_of`
    steps: np.ndarray


@inner
def desk_of(n, nodes):
    """Memory for pieces of n particles over so many nodes of the surface."""
    watch = Watch(
        np.zeros(n, np.int64), np.zeros(COLUMNS * n), np.zeros(n), np.zeros(n, np.bool_),
        np.zeros(3 * MOST_CLOSE * n, np.int32), np.zeros(n, np.int64), np.empty((0, 0), np.int64),
    )  # fmt: skip
    return Desk(
        np.empty(ROW * COMPONENTS), watch, ring_of(n), scratch_of(n), np.empty(LANES, np.uint32), batch(),
        np.zeros(len(R)), np.zeros(2 * len(P)), np.empty(n, np.int64), np.empty(n, np.int64),
        np.empty(2 * nodes), np.empty(nodes, np.int64),
    )  # fmt: skip


@inner
def gather(f, v, desk, member, window, block, world):
    """Bring the particles `member` to the small swarm `f`, and what is known of them to `v`; see `Run`."""
    n, uneven, s, w, shape, spacing = (
        member.size, 0, world.s, world.w, world.heights.shape, world.model.spacing
    )  # fmt: skip
    ring, shift_x, shift_y = desk.ring, desk.shift_x, desk.shift_y
    for k in range(HORIZON):
        ring.first[k] = -1
    for k in range(n):
        i = member[k]
        shift_x[k] = nodes_to(s.x[i], window.first_x, shape[0], spacing)
        shift_y[k] = nodes_to(s.y[i], window.first_y, shape[1], spacing)
        f.x[k], f.y[k], f.z[k] = s.x[i] + shift_x[k] * spacing, s.y[i] + shift_y[k] * spacing, s.z[i]
        f.vx[k], f.vy[k], f.vz[k] = s.vx[i], s.vy[i], s.vz[i]
        f.mass[k], f.radius[k], f.modulus[k], f.drag[k] = s.mass[i], s.radius[i], s.modulus[i], s.drag[i]
        f.x_low[k], f.x_high[k], f.y_low[k] = s.x_low[i], s.x_high[i], s.y_low[i]
        f.y_high[k], f.z_low[k], f.z_high[k] = s.y_high[i], s.z_low[i], s.z_high[i]
        adapt(f, world.fixed.dt, k)
        for column in range(len(K)):
            v.known[COLUMNS * k + column] = w.known[COLUMNS * i + column]
        v.known[COLUMNS * k + K.looked_x] += shift_x[k] * spacing
        v.known[COLUMNS * k + K.looked_y] += shift_y[k] * spacing
        v.known[COLUMNS * k + K.gone], v.known[COLUMNS * k + K.since] = 0.0, block.first
        v.pace[k], v.nonlinear[k], v.number[k] = w.pace[i], w.nonlinear[i], w.number[i]
        due = w.due[i]
        if block.anew:
            v.known[COLUMNS * k + K.renewed], v.known[COLUMNS * k + K.until] = -1.0, -1.0
            due = block.first
        insert(v.due, ring, k, due)
        for m in range(v.number[k]):
            to, at = 3 * (MOST_CLOSE * k + m), 3 * (MOST_CLOSE * i + m)
            v.close[to], v.close[to + 1] = w.close[at] + shift_x[k], w.close[at + 1] + shift_y[k]
            v.close[to + 2] = w.close[at + 2]
        uneven += int(v.nonlinear[k])
    for k in range(n, f.x.size):
        rest(f, k)
    f.jx[:], f.jy[:], f.jz[:] = 0.0, 0.0, 0.0
    f.gained[:], f.contacts[:], f.longest[:], f.met_surface[:] = 0.0, 0.0, 0.0, -1.0
    return uneven


@inner
def scatter(f, v, desk, found, member, block, world):
    """Note where particles have got to, and what is known of them."""
    state, s, w, shift_x, shift_y = found.state, world.s, world.w, desk.shift_x, desk.shift_y
    for k in range(member.size):
        i = member[k]
        away_x, away_y = shift_x[k] * world.model.spacing, shift_y[k] * world.model.spacing
        state[i, 0], state[i, 1], state[i, 2] = f.x[k] - away_x, f.y[k] - away_y, f.z[k]
        state[i, 3], state[i, 4], state[i, 5] = f.vx[k], f.vy[k], f.vz[k]
        state[i, 6], state[i, 7], state[i, 8] = f.mass[k], f.contacts[k], f.longest[k]
        pace = max(v.pace[k], speed_apart(f.vx[k], f.vy[k], f.vz[k], block.mean_x, block.mean_y))
        note_way(v.known, k, block.last, world.fixed.dt, pace, v.pace[k])
        found.gone[i] = v.known[COLUMNS * k + K.gone]
        found.met_surface[i] = f.met_surface[k]
        looked, until = v.known[COLUMNS * k + K.looked], v.known[COLUMNS * k + K.until]
        found.aware[i] = f.met_surface[k] >= 0.0 or looked >= block.first or until >= block.last
        s.x_low[i], s.x_high[i], s.y_low[i] = f.x_low[k], f.x_high[k], f.y_low[k]
        s.y_high[i], s.z_low[i], s.z_high[i] = f.y_high[k], f.z_low[k], f.z_high[k]
        for column in range(len(K)):
            w.known[COLUMNS * i + column] = v.known[COLUMNS * k + column]
        w.known[COLUMNS * i + K.looked_x] -= away_x
        w.known[COLUMNS * i + K.looked_y] -= away_y
        w.due[i], w.pace[i], w.nonlinear[i], w.number[i] = v.due[k], pace, v.nonlinear[k], v.number[k]
        for m in range(v.number[k]):
            to, at = 3 * (MOST_CLOSE * i + m), 3 * (MOST_CLOSE * k + m)
            w.close[to], w.close[to + 1] = v.close[at] - shift_x[k], v.close[at + 1] - shift_y[k]
            w.close[to + 2] = v.close[at + 2]


@inlined
def advance_piece(desk, lists, member, window, block, found, rows, used, world):
    """Make the steps of a block with one piece: (steps made, status, particle it is about, rows in use)."""
    model = world.model
    copies = copies_of(world.heights, world.ceiling.height, window, desk.nodes, desk.steps)
    n, v, progress, run, scratch = member.size, desk.watch, desk.progress, desk.run, desk.scratch
    f = views(desk.flat, ROW, PADDING * ((n + PADDING - 1) // PADDING))
    v = Watch(
        v.due[:n], v.known[: COLUMNS * n], v.pace[:n], v.nonlinear[:n], v.close, v.number[:n],
        copies.changed,
    )  # fmt: skip
    progress[:], run[:] = 0.0, 0.0
    progress[P.time], progress[P.pad_height], progress[P.rows] = block.time, block.pad_height, used
    run[R.step], run[R.fresh], run[R.mapped] = block.first, 1.0, math.inf
    run[R.mean_x], run[R.mean_y] = block.mean_x, block.mean_y
    run[R.top_x], run[R.top_y], run[R.highest] = block.top_x, block.top_y, block.highest
    run[R.nonlinear] = gather(f, v, desk, member, window, block, world)
    status = march(
        model, world.numerics, world.fixed, progress, world.t_start, block.last, world.largest, block.skin,
        0.0, world.periods, f, v, desk.ring, lists,
        Ceiling(copies.above, world.ceiling.across, world.ceiling.reach), scratch, desk.meeting, desk.batch,
        desk.batch.view(np.int64), run, copies.heights, rows,
    )  # fmt: skip
    scatter(f, v, desk, found, member, block, world)
    last = int(progress[P.rows])
    for row in range(used, last):
        k = int(rows[row, col.I])
        rows[row, col.X] = wrap(rows[row, col.X] - desk.shift_x[k] * model.spacing, model.length_x)
        rows[row, col.Y] = wrap(rows[row, col.Y] - desk.shift_y[k] * model.spacing, model.length_y)
        rows[row, col.I] = member[k]
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
    most, most_pairs, most_nodes, margin = 0, 0, 0, margin_of(model, fixed, largest, block.way)
    for piece in range(begin, end):
        most = max(most, parts.cuts[piece + 1] - parts.cuts[piece])
        most_pairs = max(most_pairs, parts.pair_cuts[piece + 1] - parts.pair_cuts[piece])
        member = parts.member[parts.cuts[piece] : parts.cuts[piece + 1]]
        window = window_of(model, s, member, heights.shape, margin)
        most_nodes = max(most_nodes, window.count_x * window.count_y)
    desk = desk_of(most, most_nodes)
    narrow, facts = np.empty(2 * most_pairs, np.uint32), np.empty(FACTS * most_pairs)
    rows, used = found.rows[found.begins[chunk] : found.begins[chunk + 1]], int(0.0)
    for piece in range(begin, end):
        pair = parts.pair[parts.pair_cuts[piece] : parts.pair_cuts[piece + 1]]
        lists = Lists(pair, narrow[: 2 * pair.shape[0]], facts[: FACTS * pair.shape[0]])
        member = parts.member[parts.cuts[piece] : parts.cuts[piece + 1]]
        window = window_of(model, s, member, heights.shape, margin)
        found.made[piece], found.status[piece], found.culprit[piece], used = advance_piece(
            desk, lists, member, window, block, found, rows, used, world
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
def ends_of(n):
    """Room for n particles."""
    return Ends(np.empty((n, STATE)), np.empty(n), np.empty(n), np.empty(n, np.bool_))


@inner
def found_of(ends, parts, expected):
    """Room for what the pieces of `parts` lead to.

    A chunk has room for the contacts of four steps, all that there can be, and for twice as many rows as are
    `expected` of a particle; memory not used is not taken.
    """
    pieces = parts.cuts.size - 1
    chunks = (pieces + CHUNK - 1) // CHUNK
    begins = np.empty(chunks + 1, np.int64)
    for chunk in range(chunks + 1):
        first = min(chunk * CHUNK, pieces)
        begins[chunk] = 4 * (2 * parts.cuts[first] + parts.pair_cuts[first])
        begins[chunk] += 2 * expected * parts.cuts[first]
    return Found(
        ends.state, ends.met_surface, ends.gone, ends.aware, np.zeros(pieces, np.int64),
        np.zeros(pieces, np.int64), np.zeros(pieces, np.int64), np.empty((begins[chunks], WIDTH)), begins,
        np.zeros(chunks, np.int64),
    )  # fmt: skip
