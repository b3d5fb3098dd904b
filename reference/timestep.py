"""Advancing the state: implicit Euler, fixed-point iteration and the adaptive step (Eqs 37-43).

Two schemes.  `point_implicit` solves the drag of each particle in closed form and is stable for steps longer
than the relaxation time.  `fixed_point` is the paper's: all particles are iterated together, and the step
adapts to the rate of convergence.  Contacts come from `collisions.py`; recording is `simulation.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference import ledger as col
from reference.collisions import collide_pad, collide_pairs, collide_surface, commit_removal
from reference.compiled import formula, kernel
from reference.drag import drag_factor, fluid_velocity
from reference.neighbors import neighbor_pairs
from reference.state import FLOW_NONE, Particles

DONE, LEDGER_FULL, NOT_FINITE, NOT_CONVERGED, STEP_VANISHED = range(5)

MAX_GROWTH = 2.0  # Phi of an accepted step
MIN_SHRINK, MAX_SHRINK = 0.05, 0.9  # Phi of a rejected one
SKIN = 0.3  # of the largest diameter: pairs that are this much further apart than touching are listed too
MOST_DRAG_ITERATIONS = 100
SLOWEST = 1e-9  # m/s: what approaches more slowly is the round-off of a contact that is over
SMALLEST_STEP = 1e-9  # of the largest step: below it a restart is given up


class Numerics(NamedTuple):
    """How the equations are solved."""

    time_step: float  # largest step, dt_lim, s
    fixed_point: bool  # the paper's scheme; else point_implicit
    tolerance: float  # TOL
    iterations: int  # k_d
    printed_norm: bool  # 3(a) as printed: relative to |r|, which depends on the origin
    iterated_contacts: bool  # contacts at each iterate, as printed: forms a two-cycle
    ledger_speed: float  # slower contacts that remove nothing are counted, but not kept in the ledger, m/s


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
    contacts: int = 8
    removals: int = 9
    removed_volume: int = 10  # sum of caps, m3
    removed_mass: int = 11  # kg
    depth_sum: int = 12  # of delta h, m
    contact_loss: int = 13  # kinetic energy taken by contacts, J
    pad_work: int = 14  # done by the pad on the particles, J; part of contact_loss with the other sign
    fluid_work: int = 15  # done by the drag on the particles, J


P = Progress()


class Work(NamedTuple):
    """Arrays that a step fills, for N particles."""

    impulse: np.ndarray  # (N, 3), of all contacts, N s
    gained: np.ndarray  # (N,), mass picked up, kg
    velocity: np.ndarray  # (N, 3), at the end of the step, m/s
    trial: np.ndarray  # (N, 3), r^k of the paper's iteration, not wrapped, m
    clearance: np.ndarray  # (N,), travel until the surface can be touched, m


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
def collide(model, dt, time, pad_height, pairs, p, heights, work, rows, row):
    """All contacts of one instant: impulses and masses gained into `work`; return the next free row."""
    work.impulse[:] = 0.0
    work.gained[:] = 0.0
    row = collide_pairs(model, dt, time, pad_height, pairs, p, work.impulse, rows, row)
    if model.has_surface:
        row = collide_surface(
            model, dt, time, pad_height, p, heights, work.clearance, work.impulse, work.gained, rows, row
        )
    if model.has_pad:
        row = collide_pad(model, time, pad_height, p, work.impulse, rows, row)
    return row


@kernel
def solve_point_implicit(model, tolerance, dt, pad_height, p, work):
    """Velocities at the end of the step, into `work`; return the first particle not solved, or -1.

    Paper: Eqs. (37)-(39) in momentum form, (m+dm) v' = m v + J + dt k (u - v'), solved for v' with k and u
    iterated.  Written as an increment: a particle that moves with the fluid keeps its velocity to the bit.
    """
    for i in range(p.position.shape[0]):
        vx, vy, vz = p.velocity[i]
        wx, wy, wz = vx, vy, vz
        gained, impulse = work.gained[i], work.impulse[i]
        solved = False
        for _ in range(MOST_DRAG_ITERATIONS):
            k, ux, uy, uz = drag_of(model, pad_height, p.position[i, 2] + dt * wz, wx, wy, wz, p.diameter[i])
            inertia = p.mass[i] + gained + dt * k
            ax = vx + (impulse[0] + dt * k * (ux - vx) - gained * vx) / inertia
            ay = vy + (impulse[1] + dt * k * (uy - vy) - gained * vy) / inertia
            az = vz + (impulse[2] + dt * k * (uz - vz) - gained * vz) / inertia
            change = abs(ax - wx) + abs(ay - wy) + abs(az - wz)
            wx, wy, wz = ax, ay, az
            if not change > tolerance * (abs(ax) + abs(ay) + abs(az)) or model.flow == FLOW_NONE:
                solved = True
                break
        work.velocity[i, 0], work.velocity[i, 1], work.velocity[i, 2] = wx, wy, wz
        if not solved:
            return i
    return -1


@kernel
def iterate_fixed_point(model, dt, pad_height, p, work):
    """One sweep of the paper's iteration over all particles; return sums of (changes, moves, |r|).

    Paper: Eq. (39).  `work.trial` and `work.velocity` hold r^k and v^k and become those of k+1.
    """
    changes, moves, distances = 0.0, 0.0, 0.0
    for i in range(p.position.shape[0]):
        v = work.velocity[i]
        k, ux, uy, uz = drag_of(model, pad_height, work.trial[i, 2], v[0], v[1], v[2], p.diameter[i])
        inertia = p.mass[i] + work.gained[i]
        change, move, distance = 0.0, 0.0, 0.0
        for axis, u in enumerate((ux, uy, uz)):
            force = work.impulse[i, axis] + dt * k * (u - v[axis])
            velocity_k = p.velocity[i, axis] + (force - work.gained[i] * p.velocity[i, axis]) / inertia
            r = p.position[i, axis] + dt * velocity_k
            change += (r - work.trial[i, axis]) ** 2
            move += (r - p.position[i, axis]) ** 2
            distance += r * r
            work.trial[i, axis] = r
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
def solve_fixed_point(model, numerics, dt, time, pad_height, pairs, p, heights, work, rows, row):
    """Iterate a step until it converges or k_d is reached; return (next free row, error, Phi).

    Paper: Section 3.1, steps 1-3.  Contacts are those of the start of the step.
    Departure: the printed scheme evaluates them at each iterate (`iterated_contacts`), which forms a
    two-cycle of overlap, bounce and no overlap.
    """
    found = collide(model, dt, time, pad_height, pairs, p, heights, work, rows, row)
    work.velocity[:] = p.velocity
    work.trial[:] = p.position + dt * p.velocity  # Eq 39 starts from r^0 = r^L + dt v^L
    error, first_error, k = 0.0, 0.0, 0
    while k < numerics.iterations:
        k += 1
        if numerics.iterated_contacts and k > 1:
            moved = Particles(work.trial, p.velocity, p.mass, p.diameter, p.modulus)
            work.clearance[:] = 0.0
            found = collide(model, dt, time, pad_height, pairs, moved, heights, work, rows, row)
        changes, moves, distances = iterate_fixed_point(model, dt, pad_height, p, work)
        scale = distances if numerics.printed_norm else moves
        error = changes / scale if scale > 0.0 else 0.0
        first_error = error if k == 1 else first_error
        if not error > numerics.tolerance:
            break
    if numerics.iterated_contacts:
        work.clearance[:] = 0.0  # it was that of the iterate
    return found, error, step_factor(error, first_error, k, numerics.tolerance, numerics.iterations)


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
def wildest(velocity):
    """Index of the particle whose velocity is not a number, or else the largest."""
    worst, fastest = 0, -1.0
    for i in range(velocity.shape[0]):
        square = velocity[i, 0] ** 2 + velocity[i, 1] ** 2 + velocity[i, 2] ** 2
        if not square <= math.inf:
            return i
        if square > fastest:
            worst, fastest = i, square
    return worst


@kernel
def accept(model, dt, p, work):
    """Move all particles to the end of the step; return (the longest way of any, m; work of the fluid, J).

    The work is that on the momentum after the contacts, so that it and the contacts' losses make up the
    change of kinetic energy, exactly where a particle has one contact at a time.
    """
    longest, fluid_work = 0.0, 0.0
    for i in range(p.position.shape[0]):
        square, gained = 0.0, p.mass[i] + work.gained[i]
        for axis, period in enumerate((model.length_x, model.length_y, model.length_z)):
            after = work.velocity[i, axis]
            struck = (p.mass[i] * p.velocity[i, axis] + work.impulse[i, axis]) / gained
            fluid_work += 0.5 * gained * (after - struck) * (after + struck)
            move = dt * after
            square += move * move
            p.velocity[i, axis] = after
            p.position[i, axis] = wrap(p.position[i, axis] + move, period)
        way = math.sqrt(square)
        longest = max(longest, way)
        work.clearance[i] -= way
        p.mass[i] = gained
    return longest, fluid_work


@kernel
def account(model, numerics, progress, dt, rows, first, last):
    """Add the contacts of an accepted step to the sums, keep those worth a row; return their end."""
    kept = first
    for row in range(first, last):
        out = rows[row]
        progress[P.contacts] += 1
        if out[col.APPROACH_SPEED] > SLOWEST:
            progress[P.largest_ratio] = max(progress[P.largest_ratio], out[col.DURATION] / dt)
        progress[P.contact_loss] += out[col.ENERGY_LOST]
        if out[col.KIND] == col.KIND_PAD:
            progress[P.pad_work] += out[col.NORMAL_IMPULSE] * model.pad_descent
        if out[col.REMOVED_VOLUME] > 0.0:
            progress[P.removals] += 1
            progress[P.removed_volume] += out[col.REMOVED_VOLUME]
            progress[P.removed_mass] += out[col.REMOVED_MASS]
            progress[P.depth_sum] += out[col.DEPTH]
        if out[col.APPROACH_SPEED] >= numerics.ledger_speed or out[col.REMOVED_VOLUME] > 0.0:
            rows[kept] = out
            kept += 1
    return kept


@kernel
def advance(model, numerics, progress, t_end, steps_left, p, heights, rows):
    """Advance the Particles `p` and the surface in place until `t_end`, or until something is in the way.

    With `point_implicit` exactly `steps_left` equal steps lead to `t_end`; with `fixed_point` the step
    adapts.  `progress` holds the scalars of `Progress`.  Returns a status (DONE, LEDGER_FULL, ...).
    """
    n = p.position.shape[0]
    periods = np.array([model.length_x, model.length_y, model.length_z])
    work = Work(np.zeros((n, 3)), np.zeros(n), p.velocity.copy(), p.position.copy(), np.zeros(n))
    largest = p.diameter.max() if n > 0 else 0.0
    skin = SKIN * largest
    pairs = neighbor_pairs(p.position, largest + skin, periods)
    travelled = 0.0  # since the pairs were listed, at most
    highest = heights.max() if model.has_surface else 0.0
    t_start, uniform = progress[P.time], (t_end - progress[P.time]) / max(steps_left, 1)
    step = 0
    while True:
        time, pad_height, used = progress[P.time], progress[P.pad_height], int(progress[P.rows])
        if numerics.fixed_point:
            dt = min(progress[P.step], t_end - time)
            if t_end - time <= SMALLEST_STEP * numerics.time_step:
                return DONE
        else:
            dt = uniform
            if step == steps_left:
                return DONE
        if 2.0 * travelled > skin:
            pairs = neighbor_pairs(p.position, largest + skin, periods)
            travelled = 0.0
        if used + pairs.shape[0] + 2 * n > rows.shape[0]:
            return LEDGER_FULL

        if numerics.fixed_point:
            found, error, factor = solve_fixed_point(
                model, numerics, dt, time, pad_height, pairs, p, heights, work, rows, used
            )
            if not error <= numerics.tolerance:
                progress[P.rejected] += 1
                shrink = factor if math.isfinite(factor) else MIN_SHRINK
                progress[P.step] = dt * min(max(shrink, MIN_SHRINK), MAX_SHRINK)
                if progress[P.step] < SMALLEST_STEP * numerics.time_step:
                    progress[P.culprit] = wildest(work.velocity)
                    return STEP_VANISHED
                continue
            if dt == progress[P.step] or factor < 1.0:  # a step cut short to reach t_end teaches nothing
                progress[P.step] = min(numerics.time_step, min(factor, MAX_GROWTH) * dt)
        else:
            found = collide(model, dt, time, pad_height, pairs, p, heights, work, rows, used)
            unsolved = solve_point_implicit(model, numerics.tolerance, dt, pad_height, p, work)
        bad = first_not_finite(work.velocity, p.position)
        if bad >= 0:
            progress[P.culprit] = bad
            return NOT_FINITE
        if not numerics.fixed_point and unsolved >= 0:
            progress[P.culprit] = unsolved
            return NOT_CONVERGED

        way, fluid_work = accept(model, dt, p, work)
        travelled += way
        if model.flow != FLOW_NONE:
            progress[P.fluid_work] += fluid_work
        if model.has_surface and commit_removal(model, heights, rows, used, found):
            highest = heights.max()
        progress[P.rows] = account(model, numerics, progress, dt, rows, used, found)
        step += 1
        progress[P.steps] += 1
        progress[P.time] = time + dt if numerics.fixed_point else t_start + step * uniform
        if model.has_pad:
            lowest = max(highest + 0.5 * largest, model.pad_minimum)
            progress[P.pad_height] = min(pad_height, max(pad_height - model.pad_descent * dt, lowest))
