"""When a particle has to be looked at again: bounds on how soon it can touch the surface.

A particle is given a box that holds its velocity for as long as nothing but the fluid and the pad act on it:
the implicit step takes v between v and u, so that the box spans v, the u of the heights that it can reach, and
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

from reference.compiled import inlined, kernel
from reference.heightfield import height_at
from reference.state import FLOW_COUETTE
from reference.triangle import closest_point_on_triangle

HORIZON = 64  # steps, after which every particle is looked at
SAFETY = 1.0 - 1e-9  # of a time until contact, for its round-off
MARGIN = 0.02  # of the flow's speed, by which a box is wider than it must be, so that small contacts stay in it
XL, XH, YL, YH, ZL, ZH = range(6)


class Watch(NamedTuple):
    """When each of N particles is looked at next, as one ring of linked lists; and the boxes of velocities."""

    due: np.ndarray  # (N,), step
    after: np.ndarray  # (N,), the next particle in the list of the same step, or -1
    before: np.ndarray  # (N,)
    first: np.ndarray  # (HORIZON,), first particle of each step of the ring, or -1
    box: np.ndarray  # (N, 6), lowest and highest velocity along x, y, z, m/s
    stiff: np.ndarray  # (N,), whether the Reynolds number can exceed 1


@kernel
def watch_all(n):
    """All particles are looked at in step 0."""
    w = Watch(
        np.zeros(n, np.int64), np.full(n, -1), np.full(n, -1), np.full(HORIZON, -1), np.zeros((n, 6)),
        np.zeros(n, np.bool_),
    )  # fmt: skip
    for i in range(n):
        insert(w, i, 0)
    return w


@kernel
def insert(w, i, step):
    """Have particle i looked at in `step`."""
    slot = step % HORIZON
    head = w.first[slot]
    w.after[i], w.before[i] = head, -1
    if head >= 0:
        w.before[head] = i
    w.first[slot] = i
    w.due[i] = step


@kernel
def remove(w, i):
    """Take particle i out of the list of its step."""
    after, before = w.after[i], w.before[i]
    if before >= 0:
        w.after[before] = after
    else:
        w.first[w.due[i] % HORIZON] = after
    if after >= 0:
        w.before[after] = before


@kernel
def within(w, i, vx, vy, vz):
    """Whether a velocity lies in the box of particle i; one that is not a number does not."""
    b = w.box[i]
    return (
        b[XL] <= vx and vx <= b[XH] and b[YL] <= vy and vy <= b[YH] and b[ZL] <= vz and vz <= b[ZH]
    )  # fmt: skip


@inlined
def new_box(model, dt, pad_height, margin, s, i, box):
    """Fill the box of velocities of particle i; return whether the Reynolds number can exceed 1 within it."""
    vx, vy, vz = s.vx[i], s.vy[i], s.vz[i]
    ux_low, ux_high, uy, uz = model.flow_x, model.flow_x, model.flow_y, model.flow_z
    couette = model.flow == FLOW_COUETTE
    if s.drag[i] == 0.0:  # nothing draws v to u
        ux_low, ux_high, uy, uz, couette = vx, vx, vy, vz, False
    if couette:
        uy, uz = 0.0, 0.0
    z_high = max(vz, uz) + margin
    z_low = min(vz, uz) - margin
    if model.has_pad:
        z_low = min(z_low, -model.pad_restitution * max(z_high, 0.0) - (1.0 + model.pad_restitution) * model.pad_descent)
    if couette:
        way = HORIZON * dt
        gap, lowest = model.gap, model.gap
        if model.has_pad:
            gap, lowest = pad_height, max(pad_height - way * model.pad_descent, model.pad_minimum)
        low, high = s.z[i] + way * min(z_low, 0.0), s.z[i] + way * max(z_high, 0.0)
        a, b, c, d = low / gap, low / lowest, high / gap, high / lowest
        ux_low, ux_high = model.wall_speed * min(a, b, c, d), model.wall_speed * max(a, b, c, d)
        ux_low, ux_high = min(ux_low, ux_high), max(ux_low, ux_high)
    box[XL], box[XH] = min(vx, ux_low) - margin, max(vx, ux_high) + margin
    box[YL], box[YH] = min(vy, uy) - margin, max(vy, uy) + margin
    box[ZL], box[ZH] = z_low, z_high
    sx = max(box[XH] - ux_low, ux_high - box[XL])
    sy = max(box[YH] - uy, uy - box[YL])
    sz = max(box[ZH] - uz, uz - box[ZL])
    reynolds = 2.0 * model.fluid_density * s.radius[i]  # times slip/viscosity
    return reynolds * reynolds * (sx * sx + sy * sy + sz * sz) > model.viscosity * model.viscosity


@inlined
def steps_until(distance, speed, dt, horizon):
    """Steps in which `distance` (m) cannot be used up at `speed` (m/s), `horizon` at most."""
    if distance >= horizon * dt * speed:
        return horizon
    return int(SAFETY * distance / (dt * speed))


@inlined
def look(z_nodes, spacing, dt, x, y, z, radius, box, horizon):
    """Look for the surface: (touching, nx, ny, nz, qx, qy, qz, steps in which it cannot be touched).

    The point that touches and its normal are those of `heightfield.surface_contact`.
    """
    n_x, n_y = z_nodes.shape
    best, qx, qy, qz = radius * radius, 0.0, 0.0, 0.0
    touching, sunk, steps = False, False, horizon
    way = dt * horizon
    right, left = way * max(box[XH], 0.0), way * max(-box[XL], 0.0)
    up, down = way * max(box[YH], 0.0), way * max(-box[YL], 0.0)
    sink = dt * max(-box[ZL], 0.0)
    square = radius * radius
    for i in range(
        math.floor((x - radius - left) / spacing), math.floor((x + radius + right) / spacing) + 1
    ):
        x0, x1 = i * spacing, (i + 1) * spacing
        i0 = i % n_x
        i1 = i0 + 1 if i0 + 1 < n_x else 0
        away_x = x0 - x if x0 > x else (x1 - x if x1 < x else 0.0)
        for j in range(
            math.floor((y - radius - down) / spacing), math.floor((y + radius + up) / spacing) + 1
        ):
            y0, y1 = j * spacing, (j + 1) * spacing
            j0 = j % n_y
            j1 = j0 + 1 if j0 + 1 < n_y else 0
            z00, z10, z01, z11 = z_nodes[i0, j0], z_nodes[i1, j0], z_nodes[i0, j1], z_nodes[i1, j1]
            highest = max(z00, z10, z01, z11)
            away_z = z - steps * sink - highest
            if away_z >= radius:
                continue
            away_y = y0 - y if y0 > y else (y1 - y if y1 < y else 0.0)
            flat = away_x * away_x + away_y * away_y
            reach = square - away_z * away_z if away_z > 0.0 else square
            if flat > reach:
                across = math.sqrt(flat)
                speed = max(away_x * box[XH], away_x * box[XL]) + max(away_y * box[YH], away_y * box[YL])
                steps = min(steps, steps_until(across - math.sqrt(reach), speed / across, dt, horizon))
                continue
            if away_x == 0.0 and away_y == 0.0 and z <= highest:
                ground = height_at(z_nodes, spacing, x, y)
                if z <= ground:
                    touching, sunk, best, qx, qy, qz = True, True, -1.0, x, y, ground
                    break
            for side in range(2):
                if side == 0:
                    cx, cy, cz = closest_point_on_triangle(x, y, z, x0, y0, z00, x1, y0, z10, x1, y1, z11)
                else:
                    cx, cy, cz = closest_point_on_triangle(x, y, z, x0, y0, z00, x1, y1, z11, x0, y1, z01)
                dx, dy, dz = x - cx, y - cy, z - cz
                apart = dx * dx + dy * dy + dz * dz
                if apart < square:
                    if apart < best:
                        touching, best, qx, qy, qz = True, apart, cx, cy, cz
                    continue
                distance = math.sqrt(apart)
                speed = max(-dx * box[XL], -dx * box[XH]) + max(-dy * box[YL], -dy * box[YH])
                speed += max(-dz * box[ZL], -dz * box[ZH])
                steps = min(steps, steps_until(distance - radius, speed / distance, dt, horizon))
        if sunk:
            break
    if sunk:
        return True, 0.0, 0.0, 1.0, qx, qy, qz, 0
    if touching:
        distance = math.sqrt(best)
        return True, (x - qx) / distance, (y - qy) / distance, (z - qz) / distance, qx, qy, qz, 0
    return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, steps
