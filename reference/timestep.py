"""Advancing the state from step to step: acceptance, the adaptive step, and what is counted (Eqs 40-43).

How one step is solved is `schemes.py`, its contacts `collisions.py`; recording is `simulation.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference import ledger as col
from reference.collisions import commit_removal
from reference.compiled import formula, kernel
from reference.neighbors import neighbor_pairs
from reference.schemes import Work, collide, solve_fixed_point, solve_point_implicit
from reference.state import FLOW_NONE

DONE, LEDGER_FULL, NOT_FINITE, NOT_CONVERGED, STEP_VANISHED = range(5)

MAX_GROWTH = 2.0  # Phi of an accepted step
MIN_SHRINK, MAX_SHRINK = 0.05, 0.9  # Phi of a rejected one
SKIN = 0.3  # of the largest diameter: pairs that are this much further apart than touching are listed too
SLOWEST = 1e-9  # m/s: what approaches more slowly is the round-off of a contact that is over
SMALLEST_STEP = 1e-9  # of the largest step: below it a restart is given up


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


@formula
def wrap(x, period):
    """Position within [0, period); a period of 0 means not periodic."""
    if period > 0.0 and (x < 0.0 or x >= period):
        x -= period * math.floor(x / period)
        return 0.0 if x >= period else x
    return x


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
