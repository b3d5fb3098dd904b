"""When a particle has to be looked at again: bounds on how soon it can touch the surface.

A particle is given a box that holds its velocity for as long as nothing but the fluid and the pad act on it.
The implicit step takes v to between v and u: the box spans v, the u of the heights that it can reach, and
what the pad makes of them.  After n steps of dt it is displaced by a vector of n dt times the box.  The
distance to a triangle is a convex function of the position, which nowhere lies below its tangent plane:
d >= d_0 + n.(r - r_0), n the unit vector from the closest point.  With the smallest n.v of the box this gives
the first step at which a triangle can be touched.  The surface only falls, which never brings it nearer to a
point above it.  Contacts with particles or surface may throw a velocity out of its box: such a particle is
looked at in the next step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.heightfield import height_at
from reference.state import FLOW_COUETTE
from reference.triangle import closest_point_on_triangle

AHEAD = 32  # steps for which the surroundings of a particle are searched
HORIZON = 64  # steps, after which every particle is looked at
CLOSE, MOST_CLOSE = 8, 8  # steps, and how many triangles a particle has that may be touched within them
SAFETY = 1.0 - 1e-9  # of a time until contact, for its round-off
MARGIN = (
    0.01  # of the flow's speed, by which a box is wider than it must be, so that small contacts stay in it
)


class Ring(NamedTuple):
    """Which of N particles is looked at in which step: one linked list for each step of a ring."""

    after: np.ndarray  # (N,), the next particle in the list of the same step, or -1
    before: np.ndarray  # (N,)
    first: np.ndarray  # (HORIZON,), the first particle of each list, or -1


@inner
def ring_of(n):
    """A ring in whose lists none of n particles is yet."""
    return Ring(np.full(n, -1), np.full(n, -1), np.full(HORIZON, -1))


@part
def insert(due, ring, i, step):
    """Have particle i, which is in no list, looked at in `step`; `due` (N,) keeps it."""
    slot = step % HORIZON
    head = ring.first[slot]
    ring.after[i], ring.before[i] = head, -1
    if head >= 0:
        ring.before[head] = i
    ring.first[slot] = i
    due[i] = step


@part
def remove(due, ring, i):
    """Take particle i out of its list."""
    follower, leader = ring.after[i], ring.before[i]
    if leader >= 0:
        ring.after[leader] = follower
    else:
        ring.first[due[i] % HORIZON] = follower
    if follower >= 0:
        ring.before[follower] = leader


@part
def fluid_bounds(model, dt, pad_height, z, z_low, z_high):
    """Lowest and highest u_x (m/s) that a particle at height z (m) can meet before it is looked at."""
    if model.flow != FLOW_COUETTE:
        return model.flow_x, model.flow_x
    way = HORIZON * dt
    gap, lowest = model.gap, model.gap
    if model.has_pad:
        gap, lowest = pad_height, max(pad_height - way * model.pad_descent, model.pad_minimum)
    low, high = z + way * min(z_low, 0.0), z + way * max(z_high, 0.0)
    per_gap, per_lowest = 1.0 / gap, 1.0 / lowest
    a, b, c, d = low * per_gap, low * per_lowest, high * per_gap, high * per_lowest
    u, v = model.wall_speed * min(a, b, c, d), model.wall_speed * max(a, b, c, d)
    return min(u, v), max(u, v)


@part
def velocity_box(model, dt, pad_height, margin, drag, z, vx, vy, vz):
    """Bounds of a velocity: (x low, x high, y low, y high, z low, z high) in m/s, and the largest slip^2.

    They hold until it is looked at again, if only fluid and pad act on it; `drag` is 0 where no fluid does.
    """
    uy, uz = model.flow_y, model.flow_z
    if model.flow == FLOW_COUETTE:
        uy, uz = 0.0, 0.0
    if drag == 0.0:
        uy, uz = vy, vz
    z_low, z_high = min(vz, uz) - margin, max(vz, uz) + margin
    if model.has_pad:
        e = model.pad_restitution
        z_low = min(z_low, -e * max(z_high, 0.0) - (1.0 + e) * model.pad_descent)
    u_low, u_high = fluid_bounds(model, dt, pad_height, z, z_low, z_high)
    if drag == 0.0:
        u_low, u_high = vx, vx
    x_low, x_high = min(vx, u_low) - margin, max(vx, u_high) + margin
    y_low, y_high = min(vy, uy) - margin, max(vy, uy) + margin
    sx, sy, sz = (
        max(x_high - u_low, u_high - x_low),
        max(y_high - uy, uy - y_low),
        max(z_high - uz, uz - z_low),
    )
    return x_low, x_high, y_low, y_high, z_low, z_high, sx * sx + sy * sy + sz * sz


@part
def steps_until(distance, speed, dt, horizon):
    """Steps in which `distance` (m) cannot be used up at `speed` (m/s), `horizon` at most."""
    if distance >= horizon * dt * speed:
        return horizon
    return int(SAFETY * distance / (dt * speed))


@part
def around(index, count):
    """`index` modulo `count`, for one that is seldom outside of 0 ... count - 1."""
    while index < 0:
        index += count
    while index >= count:
        index -= count
    return np.uint32(index)


@part
def steps_to_triangle(dx, dy, dz, radius, dt, x_low, x_high, y_low, y_high, z_low, z_high, horizon):
    """Steps in which a sphere cannot touch a triangle whose closest point is at -(dx, dy, dz).

    Distance and speed are both taken times the distance, which spares a division.
    """
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    speed = max(-dx * x_low, -dx * x_high) + max(-dy * y_low, -dy * y_high) + max(-dz * z_low, -dz * z_high)
    return steps_until((distance - radius) * distance, speed, dt, horizon)


@part
def closest_of_triangle(z_nodes, spacing, i, j, side, x, y, z):
    """Closest point of triangle `side` of the square (i, j), which need not be wrapped."""
    n_x, n_y = z_nodes.shape
    i0, j0 = around(i, n_x), around(j, n_y)
    i1 = i0 + 1 if i0 + 1 < n_x else 0
    j1 = j0 + 1 if j0 + 1 < n_y else 0
    x0, x1, y0, y1 = i * spacing, (i + 1) * spacing, j * spacing, (j + 1) * spacing
    z00, z11 = z_nodes[i0, j0], z_nodes[i1, j1]
    if side == 0:
        return closest_point_on_triangle(x, y, z, x0, y0, z00, x1, y0, z_nodes[i1, j0], x1, y1, z11)
    return closest_point_on_triangle(x, y, z, x0, y0, z00, x1, y1, z11, x0, y1, z_nodes[i0, j1])


@part
def look(
    z_nodes,
    spacing,
    dt,
    k,
    x,
    y,
    z,
    radius,
    x_low,
    x_high,
    y_low,
    y_high,
    z_low,
    z_high,
    horizon,
    close,
    number,
):
    """Look for the surface around particle k: (touching, nx, ny, nz, qx, qy, qz, steps, others).

    The point that touches and its normal are those of `heightfield.surface_contact`.  The surface cannot be
    touched within `steps`; the triangles that may be within `CLOSE` go to `close[k]`, their `number[k]` with
    them, and all others cannot be touched within `others` steps: until then `look_closely` is enough.
    """
    n_x, n_y = z_nodes.shape
    best, qx, qy, qz = radius * radius, 0.0, 0.0, 0.0
    touching, sunk, steps, others = False, False, horizon, horizon
    found = 0
    way = dt * horizon
    right, left = way * max(x_high, 0.0), way * max(-x_low, 0.0)
    up, down = way * max(y_high, 0.0), way * max(-y_low, 0.0)
    sink = dt * max(-z_low, 0.0)
    square, per_spacing = radius * radius, 1.0 / spacing
    for i in range(
        math.floor((x - radius - left) * per_spacing), math.floor((x + radius + right) * per_spacing) + 1
    ):
        x0, x1 = i * spacing, (i + 1) * spacing
        i0 = around(i, n_x)
        i1 = i0 + 1 if i0 + 1 < n_x else 0
        away_x = x0 - x if x0 > x else (x1 - x if x1 < x else 0.0)
        for j in range(
            math.floor((y - radius - down) * per_spacing), math.floor((y + radius + up) * per_spacing) + 1
        ):
            j0 = around(j, n_y)
            j1 = j0 + 1 if j0 + 1 < n_y else 0
            highest = max(z_nodes[i0, j0], z_nodes[i1, j0], z_nodes[i0, j1], z_nodes[i1, j1])
            away_z = z - others * sink - highest
            if away_z >= radius:
                continue
            y0, y1 = j * spacing, (j + 1) * spacing
            away_y = y0 - y if y0 > y else (y1 - y if y1 < y else 0.0)
            flat = away_x * away_x + away_y * away_y
            reach = square - away_z * away_z if away_z > 0.0 else square
            if flat > reach:
                across = math.sqrt(flat)
                speed = max(away_x * x_high, away_x * x_low) + max(away_y * y_high, away_y * y_low)
                free = steps_until((across - math.sqrt(reach)) * across, speed, dt, horizon)
                if free >= CLOSE:
                    others = min(others, free)
                    continue
            if away_x == 0.0 and away_y == 0.0 and z <= highest:
                ground = height_at(z_nodes, spacing, x, y)
                if z <= ground:
                    sunk, qx, qy, qz = True, x, y, ground
                    break
            for side in range(2):
                cx, cy, cz = closest_of_triangle(z_nodes, spacing, i, j, side, x, y, z)
                dx, dy, dz = x - cx, y - cy, z - cz
                apart = dx * dx + dy * dy + dz * dz
                free = 0
                if apart >= square:
                    free = steps_to_triangle(
                        dx, dy, dz, radius, dt, x_low, x_high, y_low, y_high, z_low, z_high, horizon
                    )
                elif apart < best:
                    touching, best, qx, qy, qz = True, apart, cx, cy, cz
                if free < CLOSE and found < MOST_CLOSE:
                    steps = min(steps, free)
                    at = 3 * (MOST_CLOSE * k + found)
                    close[at], close[at + 1], close[at + 2] = i, j, side
                    found += 1
                else:
                    others = min(others, free)
        if sunk:
            break
    number[k] = found
    if sunk:
        return True, 0.0, 0.0, 1.0, qx, qy, qz, 0, 0
    if touching:
        distance = math.sqrt(best)
        others, per = others if distance > 0.5 * radius else 0, 1.0 / distance
        return True, (x - qx) * per, (y - qy) * per, (z - qz) * per, qx, qy, qz, 0, others
    return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, min(steps, others), others


@part
def look_closely(
    z_nodes,
    spacing,
    dt,
    k,
    x,
    y,
    z,
    radius,
    x_low,
    x_high,
    y_low,
    y_high,
    z_low,
    z_high,
    horizon,
    close,
    number,
):
    """Look at the close triangles of particle k alone: (touching, nx, ny, nz, qx, qy, qz, steps)."""
    square = radius * radius
    best, qx, qy, qz = square, 0.0, 0.0, 0.0
    touching, steps = False, horizon
    for m in range(number[k]):
        at = 3 * (MOST_CLOSE * k + m)
        cx, cy, cz = closest_of_triangle(z_nodes, spacing, close[at], close[at + 1], close[at + 2], x, y, z)
        dx, dy, dz = x - cx, y - cy, z - cz
        apart = dx * dx + dy * dy + dz * dz
        if apart >= square:
            free = steps_to_triangle(
                dx, dy, dz, radius, dt, x_low, x_high, y_low, y_high, z_low, z_high, horizon
            )
            steps = min(steps, free)
        elif apart < best:
            touching, best, qx, qy, qz = True, apart, cx, cy, cz
    if touching:
        per = 1.0 / math.sqrt(best)
        return True, (x - qx) * per, (y - qy) * per, (z - qz) * per, qx, qy, qz, 0
    return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, steps
