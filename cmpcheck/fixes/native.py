"""An engine's own contacts with the surface, followed from outside between its steps (compiled).

LIGGGHTS computes the forces of its mesh wall; here each contact is followed from first overlap and approach
to its end, its impulse summed, its load and cap computed by the reference's kernels.  Contacts between
particles: `pairs.py`.  Loading and stepping the engine: `cmpcheck/engines/liggghts_run.py`.

Velocities are taken as `pairs.py` has them: of half a step ago, with the lag that brings them up to now.
"""

from __future__ import annotations

import math

from cmpcheck.fixes.contacts import close_contact
from cmpcheck.fixes.layout import (
    CONTACT_COLUMNS,
    FIX_FORCE,
    FREE,
    LAG,
    MASS,
    NO_ERROR,
    NOT_FINITE,
    PAIR_FORCE,
    PHASE,
    POSITION,
    RADIUS,
    TOUCHING,
    TUNNELLED,
    VELOCITY,
)
from cmpcheck.fixes.pairs import SKIN, observe_pairs
from cmpcheck.fixes.particles import remove_in_order
from cmpcheck.fixes.samples import is_sampled, store_sample
from reference import ledger as col
from reference.collisions import SEARCH_MARGIN, record_surface_impact
from reference.compiled import kernel
from reference.heightfield import surface_contact
from reference.neighbors import minimum_image, neighbor_pairs
from reference.state import FLOW_COUETTE, FLOW_UNIFORM
from reference.timestep import wrap

# Columns of a contact with a native wall: those of the fix, then its impulse on the particle, N s.
WALL_IMPULSE = CONTACT_COLUMNS
WALL_COLUMNS = WALL_IMPULSE + 3

UPRIGHT = 1e-4  # square of the sine below which a normal counts as vertical: 0.6 degrees

# Columns of `units`: the engine's units of length, velocity, force and mass in SI.
LENGTH, SPEED, FORCE_UNIT, MASS_UNIT = range(4)


@kernel
def collect_native(c, step, units, tags, x, v, f, wall, radius, mass, by_tag):
    """Write an engine's atoms, in its units, into `by_tag` (N, BY_TAG_COLUMNS), in SI.

    `v` are velocities of now, `f` all forces, and `wall` those of the surface alone, which become FIX_FORCE;
    the others PAIR_FORCE.  Arrays (n, 3) or (n,).
    """
    model = c.model
    c.lag = 0.5 * c.time_step if step > 0 else 0.0
    for i in range(tags.size):
        p = by_tag[tags[i] - 1]
        p[MASS], p[RADIUS], p[LAG] = mass[i] * units[MASS_UNIT], radius[i] * units[LENGTH], c.lag
        p[POSITION] = wrap(x[i, 0] * units[LENGTH], model.length_x)
        p[POSITION + 1] = wrap(x[i, 1] * units[LENGTH], model.length_y)
        p[POSITION + 2] = wrap(x[i, 2] * units[LENGTH], model.length_z)
        total = 0.0
        for axis in range(3):
            force = f[i, axis] * units[FORCE_UNIT]
            p[FIX_FORCE + axis] = wall[i, axis] * units[FORCE_UNIT]
            p[PAIR_FORCE + axis] = force - p[FIX_FORCE + axis]
            p[VELOCITY + axis] = v[i, axis] * units[SPEED] - c.lag * force / p[MASS]
            total += p[POSITION + axis] + p[VELOCITY + axis]
        if not math.isfinite(total) and c.error == NO_ERROR:
            c.error, c.error_step, c.error_tag = NOT_FINITE, step, tags[i]


@kernel
def split_off_pad(c, p, touch):
    """Leave in FIX_FORCE the surface's part of a force that the pad may share; the pad's goes to PAIR_FORCE.

    The pad pushes straight down and the surface along its normal, which tells them apart; where that is
    vertical too, the surface's spring tells.
    """
    found, overlap, nx, ny, nz = touch
    if not c.model.has_pad or p[POSITION + 2] + p[RADIUS] <= c.pad_height:
        return
    push = 0.0
    if found and overlap > 0.0:
        wx, wy = p[FIX_FORCE], p[FIX_FORCE + 1]
        level = nx * nx + ny * ny
        push = (wx * nx + wy * ny) / level if level > UPRIGHT else p[MASS] * c.spring * overlap
    for axis, n in enumerate((nx, ny, nz)):
        surface = max(push, 0.0) * n
        p[PAIR_FORCE + axis] += p[FIX_FORCE + axis] - surface
        p[FIX_FORCE + axis] = surface


@kernel
def follow_wall(c, step, tag, p, modulus, heights, contact, rows):
    """Follow one particle's contact with the surface through this step; return the mass it has gained, kg.

    It opens at overlap and approach and closes when its force has vanished; a removal is the caller's to
    commit then.  A negative mass is minus an error code.
    """
    model, lag = c.model, p[LAG]
    acts = 0.5 * c.time_step + lag
    found, overlap, nx, ny, nz, qx, qy, qz, _ = surface_contact(
        heights, model.spacing, p[POSITION], p[POSITION + 1], p[POSITION + 2], p[RADIUS]
    )
    if overlap > 2.0 * p[RADIUS]:
        return -float(TUNNELLED)
    split_off_pad(c, p, (found, overlap, nx, ny, nz))
    mass, row = p[MASS], contact[:PHASE]
    wx, wy, wz = p[FIX_FORCE], p[FIX_FORCE + 1], p[FIX_FORCE + 2]
    v_free = (
        p[VELOCITY] + lag * p[PAIR_FORCE] / mass,
        p[VELOCITY + 1] + lag * p[PAIR_FORCE + 1] / mass,
        p[VELOCITY + 2] + lag * p[PAIR_FORCE + 2] / mass,
    )
    if contact[PHASE] != TOUCHING:
        v_n = v_free[0] * nx + v_free[1] * ny + v_free[2] * nz
        if not (found and overlap > 0.0 and v_n < 0.0):
            return 0.0
        record_surface_impact(
            model, c.pad_height, step * c.time_step, tag - 1, (nx, ny, nz, qx, qy, qz),
            (p[POSITION], p[POSITION + 1], p[POSITION + 2]), v_free, mass, 2.0 * p[RADIUS], modulus, row,
        )  # fmt: skip
        contact[WALL_IMPULSE : WALL_IMPULSE + 3] = 0.0
        contact[PHASE] = TOUCHING
    if wx != 0.0 or wy != 0.0 or wz != 0.0:
        contact[col.CONTACT_TIME] += acts
        for axis in range(3):
            w = p[FIX_FORCE + axis]
            contact[WALL_IMPULSE + axis] += w * acts
            contact[col.ENERGY_LOST] -= w * acts * (v_free[axis] + lag * w / mass)
        return 0.0
    jx, jy, jz = contact[WALL_IMPULSE], contact[WALL_IMPULSE + 1], contact[WALL_IMPULSE + 2]
    normal = jx * contact[col.NX] + jy * contact[col.NY] + jz * contact[col.NZ]
    contact[col.NORMAL_IMPULSE] = normal
    contact[col.FRICTION_IMPULSE] = math.sqrt(max(jx * jx + jy * jy + jz * jz - normal * normal, 0.0))
    gained = contact[col.REMOVED_MASS] if model.mass_pickup else 0.0
    square = v_free[0] ** 2 + v_free[1] ** 2 + v_free[2] ** 2
    contact[col.ENERGY_LOST] += 0.5 * mass * square * gained / (mass + gained)
    error = close_contact(c, contact, rows)
    return gained if error == NO_ERROR else -float(error)


@kernel
def follow_walls(c, step, units, tags, v, mass, by_tag, modulus, heights, contacts, rows):
    """Follow every particle's contact with the surface; `v` and `mass`, the engine's, gain what is picked up.

    Paper: Eq. (24): (m + dm) v' = m v, for the whole velocity, which is tangential and rebound by now.
    `contacts` (N, WALL_COLUMNS) by tag.
    """
    for i in range(tags.size):
        tag = tags[i]
        p = by_tag[tag - 1]
        gained = follow_wall(c, step, tag, p, modulus[tag - 1], heights, contacts[tag - 1], rows)
        if gained < 0.0:
            c.error, c.error_step, c.error_tag = -int(gained), step, tag
            return
        if gained > 0.0:
            v[i] *= p[MASS] / (p[MASS] + gained)
            mass[i] += gained / units[MASS_UNIT]


@kernel
def look(
    c, step, units, tags, x, v, f, wall, radius, mass, by_tag, modulus, heights, contacts, rows, position,
    pairs, listed, open_pairs, samples,
):  # fmt: skip
    """Follow all contacts, lower the surface and store a sample, at a step; return whether that failed.

    Arrays as `collect_native`, `follow_walls`, `pairs.observe_pairs` and `samples.store_sample` take them.
    """
    collect_native(c, step, units, tags, x, v, f, wall, radius, mass, by_tag)
    first = c.rows
    if c.model.has_surface and c.error == NO_ERROR:
        follow_walls(c, step, units, tags, v, mass, by_tag, modulus, heights, contacts, rows)
        remove_in_order(c, heights, rows, first, c.rows)
    if c.observe_pairs and c.error == NO_ERROR:
        observe_pairs(c, step, by_tag, modulus, position, pairs, listed, open_pairs, rows)
    if is_sampled(c, step) and c.error == NO_ERROR:
        store_sample(c, step, by_tag, samples)
    return c.error != NO_ERROR


@kernel
def steps_without_contact(c, by_tag, known, contacts):
    """How many steps surely pass before anything can touch; 1 where something touches, or may at the next.

    Bounded by the gaps and the largest speed, which a flow cannot raise above its own.  `known` (nx, ny) are
    the heights as the engine has them: the surface only falls, so what is lower by now is further away.
    """
    model, n = c.model, by_tag.shape[0]
    fastest = 0.0
    if model.flow == FLOW_UNIFORM:
        fastest = math.sqrt(model.flow_x**2 + model.flow_y**2 + model.flow_z**2)
    elif model.flow == FLOW_COUETTE:
        fastest = 2.0 * abs(model.wall_speed)  # twice: particles may be above the gap
    largest = 0.0
    for i in range(n):
        p = by_tag[i]
        square = p[VELOCITY] ** 2 + p[VELOCITY + 1] ** 2 + p[VELOCITY + 2] ** 2
        fastest, largest = max(fastest, math.sqrt(square)), max(largest, p[RADIUS])
    room = SEARCH_MARGIN * largest
    highest = known.max() if model.has_surface else 0.0
    for i in range(n):
        p = by_tag[i]
        if contacts[i, PHASE] != FREE:
            return 1
        if not model.has_surface or p[POSITION + 2] - p[RADIUS] > highest + room:
            continue
        reach = p[RADIUS] + room
        found, overlap, _, _, _, _, _, _, _ = surface_contact(
            known, model.spacing, p[POSITION], p[POSITION + 1], p[POSITION + 2], reach
        )
        if found:
            room = min(room, room - overlap)  # overlap of the enlarged sphere
    if c.observe_pairs:
        if c.open > 0:
            return 1
        room = min(room, 0.5 * pair_room(model, by_tag, largest))  # both move
    if fastest == 0.0 or room <= 0.0:
        return 1 if room <= 0.0 else 1_000_000
    return max(1, int(min(room / (fastest * c.time_step), 1e6)) - 1)


@kernel
def approaches_stale(c, by_tag, known, contacts, heights):
    """Whether a particle may touch next where the surface is lower than the engine knows; (nx, ny) each."""
    model, highest = c.model, known.max()
    for i in range(by_tag.shape[0]):
        p = by_tag[i]
        if contacts[i, PHASE] != FREE or p[POSITION + 2] - p[RADIUS] > highest + SEARCH_MARGIN * p[RADIUS]:
            continue
        speed = math.sqrt(p[VELOCITY] ** 2 + p[VELOCITY + 1] ** 2 + p[VELOCITY + 2] ** 2)
        reach = p[RADIUS] + 3.0 * speed * c.time_step
        found, _, nx, ny, nz, _, _, _, _ = surface_contact(
            known, model.spacing, p[POSITION], p[POSITION + 1], p[POSITION + 2], reach
        )
        if not found or p[VELOCITY] * nx + p[VELOCITY + 1] * ny + p[VELOCITY + 2] * nz >= 0.0:
            continue
        h = model.spacing
        for j in range(math.floor((p[POSITION] - reach) / h), math.ceil((p[POSITION] + reach) / h) + 1):
            for k in range(
                math.floor((p[POSITION + 1] - reach) / h), math.ceil((p[POSITION + 1] + reach) / h) + 1
            ):
                node = j % known.shape[0], k % known.shape[1]
                if heights[node] != known[node]:
                    return True
    return False


@kernel
def plan_steps(c, by_tag, known, contacts, heights):
    """How many steps may be made unseen, at least 1, and whether the engine has to read `heights` before."""
    steps = steps_without_contact(c, by_tag, known, contacts)
    return steps, steps == 1 and c.model.has_surface and approaches_stale(c, by_tag, known, contacts, heights)


@kernel
def pair_room(model, by_tag, largest):
    """The smallest gap between two particles, at most SKIN times the largest radius, in m."""
    room = SKIN * largest
    periods = by_tag[0, :3].copy()
    periods[0], periods[1], periods[2] = model.length_x, model.length_y, model.length_z
    found = neighbor_pairs(by_tag[:, POSITION : POSITION + 3].copy(), 2.0 * largest + room, periods)
    for k in range(found.shape[0]):
        a, b = by_tag[found[k, 0]], by_tag[found[k, 1]]
        square = 0.0
        for axis in range(3):
            square += minimum_image(b[POSITION + axis] - a[POSITION + axis], periods[axis]) ** 2
        room = min(room, math.sqrt(square) - a[RADIUS] - b[RADIUS])
    return room
