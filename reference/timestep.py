"""Advancing the state: implicit Euler, fixed-point iteration and the adaptive step (Eqs 37-43).

Two schemes.  `point_implicit` solves the drag of each particle in closed form and is stable for steps longer
than the relaxation time.  `fixed_point` is the paper's: all particles are iterated together, and the step
adapts to the rate of convergence.  Contacts come from `collisions.py`; recording is `simulate.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.collisions import collide_pad, collide_pairs, collide_surface, commit_removal
from reference.compiled import formula, kernel
from reference.drag import drag_factor, fluid_velocity
from reference.ledger import DURATION
from reference.neighbors import has_moved, neighbor_pairs
from reference.state import FLOW_NONE

DONE, LEDGER_FULL, NOT_FINITE, NOT_CONVERGED, STEP_VANISHED = range(5)

MAX_GROWTH = 2.0  # Phi of an accepted step
MIN_SHRINK, MAX_SHRINK = 0.05, 0.9  # Phi of a rejected one
SMALLEST_STEP = 1e-9  # of the largest step: below it a restart is given up


class Numerics(NamedTuple):
    """How the equations are solved."""

    time_step: float  # largest step, dt_lim, s
    fixed_point: bool  # the paper's scheme; else point_implicit
    tolerance: float  # TOL
    iterations: int  # k_d
    printed_norm: bool  # 3(a) as printed: relative to |r|, which depends on the origin
    iterated_contacts: bool  # contacts at each iterate, as printed: forms a two-cycle


class Progress(NamedTuple):
    """Scalars that outlive a call of `advance`, as one array: see its fields' indices below."""

    time: int = 0
    pad_height: int = 1
    step: int = 2  # the adaptive step, s
    largest_ratio: int = 3  # largest delta t/dt of any contact
    rows: int = 4  # ledger rows in use
    steps: int = 5  # accepted steps
    rejected: int = 6
    culprit: int = 7  # particle that a status is about


P = Progress()


@formula
def wrap(x, period):
    """Position within [0, period); a period of 0 means not periodic."""
    if period > 0.0 and (x < 0.0 or x >= period):
        x -= period * math.floor(x / period)
        return 0.0 if x >= period else x
    return x


@kernel
def drag_of(model, pad_height, z, vx, vy, vz, diameter):
    """Drag factor k (kg/s) and fluid velocity at a trial position and velocity."""
    if model.flow == FLOW_NONE:
        return 0.0, 0.0, 0.0, 0.0
    ux, uy, uz = fluid_velocity(model, pad_height, z)
    slip = math.sqrt((ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2)
    return drag_factor(slip, diameter, model.fluid_density, model.viscosity), ux, uy, uz


@kernel
def solve_point_implicit(
    model, numerics, dt, pad_height, position, velocity, mass, diameter, impulse, gained, new_velocity
):
    """Velocities at the end of the step, into `new_velocity`; return the first particle not solved, or -1.

    Paper: Eqs. (37)-(39) in momentum form, (m+dm) v' = m v + J + dt k (u - v'), solved for v' with k and u
    iterated.  Written as an increment: a particle that moves with the fluid keeps its velocity to the bit.
    """
    for i in range(position.shape[0]):
        vx, vy, vz = velocity[i]
        wx, wy, wz = vx, vy, vz
        solved = False
        for _ in range(100):
            k, ux, uy, uz = drag_of(model, pad_height, position[i, 2] + dt * wz, wx, wy, wz, diameter[i])
            inertia = mass[i] + gained[i] + dt * k
            ax = vx + (impulse[i, 0] + dt * k * (ux - vx) - gained[i] * vx) / inertia
            ay = vy + (impulse[i, 1] + dt * k * (uy - vy) - gained[i] * vy) / inertia
            az = vz + (impulse[i, 2] + dt * k * (uz - vz) - gained[i] * vz) / inertia
            change = abs(ax - wx) + abs(ay - wy) + abs(az - wz)
            wx, wy, wz = ax, ay, az
            if not change > numerics.tolerance * (abs(ax) + abs(ay) + abs(az)) or model.flow == FLOW_NONE:
                solved = True
                break
        new_velocity[i, 0], new_velocity[i, 1], new_velocity[i, 2] = wx, wy, wz
        if not solved:
            return i
    return -1


@kernel
def iterate_fixed_point(
    model, dt, pad_height, position, velocity, mass, diameter, impulse, gained, trial, new_velocity
):
    """One sweep of the paper's iteration over all particles; return (sum of changes, of moves, of |r|).

    Paper: Eq. (39).  `trial` (N, 3) holds r^k, not wrapped, and `new_velocity` v^k; both become those of k+1.
    """
    changes, moves, distances = 0.0, 0.0, 0.0
    for i in range(position.shape[0]):
        v = new_velocity[i]
        k, ux, uy, uz = drag_of(model, pad_height, trial[i, 2], v[0], v[1], v[2], diameter[i])
        inertia = mass[i] + gained[i]
        change, move, distance = 0.0, 0.0, 0.0
        for axis, u in enumerate((ux, uy, uz)):
            force = impulse[i, axis] + dt * k * (u - v[axis])
            velocity_k = (mass[i] * velocity[i, axis] + force) / inertia
            r = position[i, axis] + dt * velocity_k
            change += (r - trial[i, axis]) ** 2
            move += (r - position[i, axis]) ** 2
            distance += r * r
            trial[i, axis] = r
            v[axis] = velocity_k
        changes += math.sqrt(change)
        moves += math.sqrt(move)
        distances += math.sqrt(distance)
    return changes, moves, distances


@formula
def step_factor(error, first_error, k, tolerance, iterations):
    """Phi, by which the step is multiplied so that k_d iterations would reach the tolerance.

    Paper: Eqs. (42) and (43), p = 1.
    Departure: exponents 1/(k_d-1) and 1/(k-1), because e^0 is an error and eps_k an increment; Phi is capped
    by the caller, and is infinite where nothing changed.
    """
    if error <= 0.0 or first_error <= 0.0 or k < 2:
        return math.inf
    wanted = (tolerance / first_error) ** (1.0 / (iterations - 1))
    return wanted / (error / first_error) ** (1.0 / (k - 1))


@kernel
def first_not_finite(velocity, position):
    """Index of the first particle whose state is not finite, or -1."""
    for i in range(position.shape[0]):
        total = 0.0
        for axis in range(3):
            total += position[i, axis] + velocity[i, axis]
        if not math.isfinite(total):
            return i
    return -1


@kernel
def advance(
    model, numerics, progress, t_end, steps_left, position, velocity, mass, diameter, modulus, heights, rows
):
    """Advance all arrays in place until `t_end`, the ledger is full, or something is wrong.

    With `point_implicit` exactly `steps_left` equal steps lead to `t_end`; with `fixed_point` the step
    adapts.  `progress` holds the scalars of `Progress`.  Returns a status (DONE, LEDGER_FULL, ...).
    """
    n = position.shape[0]
    periods = np.array([model.length_x, model.length_y, model.length_z])
    impulse, gained = np.zeros((n, 3)), np.zeros(n)
    new_velocity, trial = velocity.copy(), position.copy()
    largest = diameter.max() if n > 0 else 0.0
    skin = 0.5 * largest
    listed = position.copy()
    pairs = neighbor_pairs(position, largest + skin, periods)
    highest = heights.max() if model.has_surface else 0.0
    t_start, uniform = progress[P.time], (t_end - progress[P.time]) / max(steps_left, 1)
    step = 0
    while True:
        if numerics.fixed_point:
            left = t_end - progress[P.time]
            if left <= SMALLEST_STEP * numerics.time_step:
                return DONE
            dt = min(progress[P.step], left)
        else:
            if step == steps_left:
                return DONE
            dt = uniform
        time, pad_height = progress[P.time], progress[P.pad_height]
        if has_moved(position, listed, 0.5 * skin, periods):
            pairs = neighbor_pairs(position, largest + skin, periods)
            listed[:] = position
        used = int(progress[P.rows])
        if used + pairs.shape[0] + 2 * n > rows.shape[0]:
            return LEDGER_FULL

        found = collide(
            model, dt, time, pad_height, pairs, position, velocity, mass, diameter, modulus, heights, highest,
            impulse, gained, rows, used,
        )  # fmt: skip
        if not numerics.fixed_point:
            culprit = solve_point_implicit(
                model,
                numerics,
                dt,
                pad_height,
                position,
                velocity,
                mass,
                diameter,
                impulse,
                gained,
                new_velocity,
            )
            if culprit >= 0:
                progress[P.culprit] = culprit
                bad = first_not_finite(new_velocity, position)
                if bad >= 0:
                    progress[P.culprit] = bad
                    return NOT_FINITE
                return NOT_CONVERGED
        else:
            error, first_error, k = 0.0, 0.0, 0
            new_velocity[:] = velocity
            trial[:] = position + dt * velocity  # Eq 39 starts from r^0 = r^L + dt v^L
            while k < numerics.iterations:
                k += 1
                if numerics.iterated_contacts and k > 1:
                    found = collide(
                        model, dt, time, pad_height, pairs, trial, velocity, mass, diameter, modulus, heights,
                        highest, impulse, gained, rows, used,
                    )  # fmt: skip
                changes, moves, distances = iterate_fixed_point(
                    model,
                    dt,
                    pad_height,
                    position,
                    velocity,
                    mass,
                    diameter,
                    impulse,
                    gained,
                    trial,
                    new_velocity,
                )
                scale = distances if numerics.printed_norm else moves
                error = changes / scale if scale > 0.0 else 0.0
                first_error = error if k == 1 else first_error
                if not error > numerics.tolerance:
                    break
            factor = step_factor(error, first_error, k, numerics.tolerance, numerics.iterations)
            if not error <= numerics.tolerance:
                progress[P.rejected] += 1
                shrink = factor if math.isfinite(factor) else MIN_SHRINK
                progress[P.step] = dt * min(max(shrink, MIN_SHRINK), MAX_SHRINK)
                if progress[P.step] < SMALLEST_STEP * numerics.time_step:
                    bad = first_not_finite(velocity, position)
                    progress[P.culprit] = max(bad, 0)
                    return STEP_VANISHED
                continue
            if dt == progress[P.step] or factor < 1.0:  # a step cut short to reach t_end teaches nothing
                progress[P.step] = min(numerics.time_step, min(factor, MAX_GROWTH) * dt)

        bad = first_not_finite(new_velocity, position)
        if bad >= 0:
            progress[P.culprit] = bad
            return NOT_FINITE
        for i in range(n):
            for axis in range(3):
                velocity[i, axis] = new_velocity[i, axis]
                position[i, axis] = wrap(position[i, axis] + dt * new_velocity[i, axis], periods[axis])
            mass[i] += gained[i]
        if model.has_surface and commit_removal(model, heights, rows, used, found):
            highest = heights.max()
        for row in range(used, found):
            if rows[row, DURATION] > 0.0:
                progress[P.largest_ratio] = max(progress[P.largest_ratio], rows[row, DURATION] / dt)
        step += 1
        progress[P.rows] = found
        progress[P.steps] += 1
        progress[P.time] = time + dt if numerics.fixed_point else t_start + step * uniform
        if model.has_pad:
            lowest = max(highest + 0.5 * largest, model.pad_minimum)
            progress[P.pad_height] = min(pad_height, max(pad_height - model.pad_descent * dt, lowest))


@kernel
def collide(
    model,
    dt,
    time,
    pad_height,
    pairs,
    position,
    velocity,
    mass,
    diameter,
    modulus,
    heights,
    highest,
    impulse,
    gained,
    rows,
    row,
):
    """All contacts of one instant: impulses into `impulse`, mass into `gained`; return the next free row."""
    impulse[:] = 0.0
    gained[:] = 0.0
    row = collide_pairs(
        model, dt, time, pad_height, pairs, position, velocity, mass, diameter, modulus, impulse, rows, row
    )
    if model.has_surface:
        row = collide_surface(
            model, dt, time, pad_height, position, velocity, mass, diameter, modulus, heights, highest,
            impulse, gained, rows, row,
        )  # fmt: skip
    if model.has_pad:
        row = collide_pad(model, time, pad_height, position, velocity, mass, diameter, impulse, rows, row)
    return row
