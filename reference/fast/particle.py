"""What is done for one particle in a step of the fast stepper.

Which particles come when, and in which order what they do to each other is added up, is decided in `few.py`.
"""

from __future__ import annotations

import math

from reference import ledger as col
from reference.compiled import part
from reference.contact import surface_normal_impulse
from reference.fast.events import bounce, strike
from reference.fast.known import COLUMNS, K
from reference.fast.pairs import acceleration_in
from reference.fast.swarm import adapt
from reference.fast.watch import AHEAD, look, look_closely
from reference.schemes import solve_particle
from reference.state import FLOW_COUETTE
from reference.timestep import DONE, NOT_CONVERGED, NOT_FINITE, wrap


@part
def shear_of(model, pad_height):
    """Shear rate of a Couette flow under a pad or over its gap, 1/s; 0 in another flow."""
    if model.flow != FLOW_COUETTE:
        return 0.0
    return model.wall_speed / (pad_height if model.has_pad else model.gap)


@part
def find_surface(model, fixed, heights, above, s, w, i, step, same_box):
    """Look for the surface around particle i: (touching, nx, ny, nz, qx, qy, qz, steps), see `watch.look`.

    `above` is the map of the surface's maxima; `same_box` says that the box is that of the last look.
    """
    known, row = w.known, COLUMNS * i
    close, number, changed = w.close, w.number, w.changed
    x, y, z, radius = wrap(s.x[i], model.length_x), wrap(s.y[i], model.length_y), s.z[i], s.radius[i]
    x_low, x_high, y_low = s.x_low[i], s.x_high[i], s.y_low[i]
    y_high, z_low, z_high = s.y_high[i], s.z_low[i], s.z_high[i]
    a = min(int(x * fixed.per_spacing), above.shape[0] - 1)
    b = min(int(y * fixed.per_spacing), above.shape[1] - 1)
    clear = z - radius + fixed.way * min(z_low, 0.0) >= above[a, b]
    ahead = fixed.way * max(x_high, -x_low, y_high, -y_low)
    clear = clear and ahead <= fixed.around
    again = same_box and step <= known[row + K.until] and changed[a, b] < known[row + K.looked]
    again = again and abs(x - known[row + K.looked_x]) < fixed.half_x
    again = again and abs(y - known[row + K.looked_y]) < fixed.half_y
    again = again and fixed.dt * z_low > -radius  # else it may sink in one step, which a look sees
    touching, steps = False, AHEAD
    nx, ny, nz, qx, qy, qz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if clear:
        known[row + K.until] = -1.0
    elif again:
        touching, nx, ny, nz, qx, qy, qz, steps = look_closely(
            heights, model.spacing, fixed.dt, i, x, y, z, radius,
            x_low, x_high, y_low, y_high, z_low, z_high, AHEAD, close, number,
        )  # fmt: skip
        steps = min(steps, int(known[row + K.until]) - step)
    else:
        horizon = AHEAD if ahead <= fixed.room else int(fixed.room / ahead * AHEAD)
        touching, nx, ny, nz, qx, qy, qz, steps, others = look(
            heights, model.spacing, fixed.dt, i, x, y, z, radius,
            x_low, x_high, y_low, y_high, z_low, z_high, horizon, close, number,
        )  # fmt: skip
        known[row + K.until], known[row + K.looked] = step + others, step
        known[row + K.looked_x], known[row + K.looked_y] = x, y
    return touching, nx, ny, nz, qx, qy, qz, steps


@part
def hit_surface(
    model, numerics, fixed, s, w, scratch, heights, i, time, shear, pad_height, closing, nx, ny, nz, qx, qy,
    qz, rows, row,
):  # fmt: skip
    """Have the surface push particle i, which comes down at `closing`: (next free row, duration in s)."""
    if closing >= fixed.remarkable:
        x, y = wrap(s.x[i], model.length_x), wrap(s.y[i], model.length_y)
        strike(
            model, fixed.dt, time, pad_height, i, (nx, ny, nz, qx, qy, qz), x, y, s.z[i], s.vx[i], s.vy[i],
            s.vz[i], s.mass[i], s.radius[i], s.modulus[i], heights, scratch.position, scratch.velocity, rows,
            row,
        )  # fmt: skip
        normal, lasting = rows[row, col.NORMAL_IMPULSE], rows[row, col.DURATION]
        removes = rows[row, col.REMOVED_VOLUME] > 0.0
        if removes and model.mass_pickup:
            s.gained[i] = rows[row, col.REMOVED_MASS]
            s.x_low[i] = math.inf  # no velocity is in its box: it gets another one in the next step
        if removes or closing >= numerics.ledger_speed:
            row += 1
    else:
        ax, ay, az = acceleration_in(model, s, w.nonlinear, shear, pad_height, i)
        normal, lasting = bounce(
            model, fixed.dt, s.mass[i], s.radius[i], s.modulus[i], closing,
            s.mass[i] * (ax * nx + ay * ny + az * nz),
        )  # fmt: skip
    s.jx[i] += normal * nx
    s.jy[i] += normal * ny
    s.jz[i] += normal * nz
    return row, lasting


@part
def keep(s, scratch, k, i):
    """Have particle i solved by itself, as number k, from what it is before the contacts of the step."""
    kept = scratch.kept
    scratch.special[k] = i
    kept[k, 0], kept[k, 1], kept[k, 2] = s.x[i], s.y[i], s.z[i]
    kept[k, 3], kept[k, 4], kept[k, 5] = s.vx[i], s.vy[i], s.vz[i]
    kept[k, 6], kept[k, 7], kept[k, 8] = s.jx[i], s.jy[i], s.jz[i]


@part
def too_fast(fixed, s, i, shear):
    """Whether particle i may be so fast after its contacts that its drag is not linear."""
    radius, z, wx, wy, wz = s.radius[i], s.z[i], s.wx[i], s.wy[i], s.wz[i]
    here, there = fixed.flow_x + shear * z - wx, fixed.flow_x + shear * (z + fixed.dt * wz) - wx
    slip = max(here * here, there * there) + (fixed.flow_y - wy) ** 2 + (fixed.flow_z - wz) ** 2
    return 4.0 * radius * radius * slip > fixed.slip_limit


@part
def set_apart(fixed, s, w, scratch, shear, some_outside, some_nonlinear):
    """Find those that are thrown, or that are solved by themselves, of all: (how many, how many).

    One that is thrown has left its box, to which drag need not lead it back.  A special one, whose drag may
    not be linear or that gains mass, is solved by `solve_special`.
    """
    n, thrown, special = w.pace.size, 0, 0
    if some_nonlinear:
        for i in range(n):
            if w.nonlinear[i]:
                keep(s, scratch, special, i)
                special += 1
    if some_outside:
        for i in range(n):
            if s.outside[i] > 0.0:
                scratch.thrown[thrown] = i
                thrown += 1
                if not w.nonlinear[i] and (s.gained[i] > 0.0 or too_fast(fixed, s, i, shear)):
                    keep(s, scratch, special, i)
                    special += 1
    return thrown, special


@part
def solve_special(model, numerics, fixed, s, scratch, k, i, pad_height, descent):
    """Solve particle i, the special one number k, by itself; return a status."""
    kept, gained, mass = scratch.kept, s.gained, s.mass
    pushed = 0.0
    if model.has_pad and kept[k, 2] + s.radius[i] > pad_height:
        pushed = surface_normal_impulse(mass[i], -(kept[k, 5] + descent), model.pad_restitution)
    wx, wy, wz, _, _, _, solved = solve_particle(
        model, numerics.tolerance, fixed.dt, pad_height, kept[k, 2], kept[k, 3], kept[k, 4], kept[k, 5],
        mass[i], gained[i], kept[k, 6], kept[k, 7], kept[k, 8] - pushed, 2.0 * s.radius[i],
    )  # fmt: skip
    if gained[i] > 0.0:
        mass[i] += gained[i]
        adapt(s, fixed.dt, i)
        gained[i] = 0.0
    s.vx[i], s.vy[i], s.vz[i] = wx, wy, wz
    s.x[i], s.y[i] = kept[k, 0] + fixed.dt * wx, kept[k, 1] + fixed.dt * wy
    s.z[i] = wrap(kept[k, 2] + fixed.dt * wz, model.length_z)
    if not math.isfinite(wx + wy + wz):
        return NOT_FINITE
    return DONE if solved else NOT_CONVERGED


@part
def check_thrown(model, s, i):
    """Wrap particle i, which its contacts have thrown out of its box, along z; return a status."""
    s.z[i] = wrap(s.z[i], model.length_z)
    finite = math.isfinite(s.x[i] + s.y[i] + s.z[i] + s.vx[i] + s.vy[i] + s.vz[i])
    return DONE if finite else NOT_FINITE


@part
def speed_apart(vx, vy, vz, mean_x, mean_y):
    """Speed relative to a mean, m/s."""
    return math.sqrt((vx - mean_x) ** 2 + (vy - mean_y) ** 2 + vz**2)
