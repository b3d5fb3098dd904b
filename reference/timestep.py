"""Advancing the state from step to step: acceptance, the adaptive step, and what is counted (Eqs 40-43).

How one step is solved is `schemes.py`, its contacts `collisions.py`; recording is `simulation.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference import ledger as col
from reference.collisions import commit_removal, empty_work
from reference.compiled import formula, kernel
from reference.neighbors import neighbor_pairs
from reference.pad import lowered_pad, lowest_pad_height, pad_velocity
from reference.schemes import collide, solve_fixed_point, solve_point_implicit

DONE, LEDGER_FULL, NOT_FINITE, NOT_CONVERGED, STEP_VANISHED = range(5)

MAX_GROWTH = 2.0  # Phi of an accepted step
MIN_SHRINK, MAX_SHRINK = 0.05, 0.9  # Phi of a rejected one
SKIN = 0.3  # of the largest diameter: pairs that are this much further apart than touching are listed too
SLOWEST = 1e-9  # m/s: what approaches more slowly is the round-off of a contact that is over
SMALLEST_STEP = 1e-9  # of the largest step: below it a restart is given up


class Progress(NamedTuple):
    """Scalars that outlive a call of `advance`: indices in one array, made by `new_progress`.

    The second half of the array is what the last addition to each sum has rounded off.
    """

    time: int = 0
    pad_height: int = 1
    step: int = 2  # the adaptive step, s
    largest_ratio: int = 3  # largest delta t/dt of any contact
    rows: int = 4  # ledger rows in use
    steps: int = 5  # accepted steps
    rejected: int = 6
    culprit: int = 7  # particle that a status is about
    # from here on sums over the accepted steps
    contacts: int = 8
    removals: int = 9
    removed_volume: int = 10  # sum of caps, m3
    removed_mass: int = 11  # kg
    depth_sum: int = 12  # of delta h, m
    contact_loss: int = 13  # kinetic energy that the contacts would take, each by itself, J
    simultaneous_loss: int = 14  # what they take beyond that, because impulses are added, J
    pad_work: int = 15  # done by the pad on the particles, J; part of contact_loss with the other sign
    fluid_work: int = 16  # done by the drag on the particles, J
    fluid_impulse_x: int = 17  # of the drag on the particles, N s
    fluid_impulse_y: int = 18
    fluid_impulse_z: int = 19
    surface_impulse_x: int = 20  # of the surface on the particles, N s
    surface_impulse_y: int = 21
    surface_impulse_z: int = 22
    pad_impulse_z: int = 23  # of the pad on the particles, N s; without friction it has no other component
    energy_rounding: int = 24  # bound of the round-off in the energies above, J
    momentum_rounding: int = 25  # and in each component of the impulses, N s


P = Progress()
EPS = float(np.finfo(np.float64).eps)
ROUNDINGS = 64  # of one particle in one step, in eps: see `round_off`


def new_progress():
    """The array of `Progress` at the start of a run, all zero."""
    return np.zeros(2 * len(P))


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
def momentum_and_energy(p):
    """Sums of m |v| (N s) and of m v^2 (J), the sizes from which round-off is bounded."""
    momentum, energy = 0.0, 0.0
    for i in range(p.mass.shape[0]):
        square = p.velocity[i, 0] ** 2 + p.velocity[i, 1] ** 2 + p.velocity[i, 2] ** 2
        momentum += p.mass[i] * math.sqrt(square)
        energy += p.mass[i] * square
    return momentum, energy


@formula
def round_off(terms, sizes):
    """Bound of the round-off in the sums of one step of `terms` numbers: particles and contacts.

    A running error analysis (Higham, "Accuracy and Stability of Numerical Algorithms", Section 3.3), with
    eps = 2 u.  A particle of mass m picks up g and has the mass M after the step.  Let B = sum |J| + g |v|
    of its contacts (in the 1-norm) and y = m |v| + M |v'| + B.  Then |D| = |M v' - m v - J| <= y, and no
    velocity of the step exceeds w = y/m.
    - Momentum: M v' - m v - J - D is not 0, but 1 u y by the rounding of v', 28 u y by its increment's (14
      operations on J, g v and D), 21 u y by that of D.  s, the velocity before D, is off by 6 u y/M.
    - Energy: these 56 u y act on velocities up to w; the energy of s and the product D.(s + v')/2 add
      8 u y w, the losses of contacts (Eqs 5-19, 29-31) 20 u y w, and the simultaneous ones 30 u y w.
    Together less than ROUNDINGS eps = 128 u.  In the step's sums each of `terms` numbers, y or y w at most,
    is rounded `terms` times.  The sums over steps are compensated and round each twice more, within the 14 u
    that are left.  `sizes` is the sum of y over the particles, or of y w = y^2/m, which is at most
    3 (m v^2 + M v'^2 + (B^2 + g M v'^2)/m).
    """
    return EPS * (ROUNDINGS + terms) * sizes


@kernel
def accept(model, dt, p, work, booked):
    """Move all particles to the end of the step and book the fluid's part.

    The fluid gives its impulse D to a particle that contacts have brought to the velocity s, and leaves it
    with v': it does the work D.(s + v')/2, which is M (v'^2 - s^2)/2, exactly.
    Returns: the longest way of any (m), and for `round_off` the sums of M |v'| and of M v'^2 over all
    particles, and of B and of (B^2 + g M v'^2)/m over those in contact.
    """
    longest, work_done, fluid_x, fluid_y, fluid_z, simultaneous = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    momentum, energy, blows, violence = 0.0, 0.0, 0.0, 0.0
    for i in range(p.position.shape[0]):
        mass = p.mass[i] + work.gained[i]
        sx, sy, sz = p.velocity[i, 0], p.velocity[i, 1], p.velocity[i, 2]
        vx, vy, vz = work.velocity[i, 0], work.velocity[i, 1], work.velocity[i, 2]
        dx, dy, dz = work.drag[i, 0], work.drag[i, 1], work.drag[i, 2]
        square = vx * vx + vy * vy + vz * vz
        if work.blows[i] > 0.0:
            blow = work.blows[i] + work.gained[i] * (abs(sx) + abs(sy) + abs(sz))
            sx += (work.impulse[i, 0] - work.gained[i] * sx) / mass
            sy += (work.impulse[i, 1] - work.gained[i] * sy) / mass
            sz += (work.impulse[i, 2] - work.gained[i] * sz) / mass
            simultaneous += work.simultaneous[i]
            blows += blow
            violence += (blow * blow + work.gained[i] * mass * square) / p.mass[i]
            p.mass[i] = mass
        work_done += 0.5 * (dx * (sx + vx) + dy * (sy + vy) + dz * (sz + vz))
        fluid_x, fluid_y, fluid_z = fluid_x + dx, fluid_y + dy, fluid_z + dz
        p.velocity[i, 0], p.velocity[i, 1], p.velocity[i, 2] = vx, vy, vz
        p.position[i, 0] = wrap(p.position[i, 0] + dt * vx, model.length_x)
        p.position[i, 1] = wrap(p.position[i, 1] + dt * vy, model.length_y)
        p.position[i, 2] = wrap(p.position[i, 2] + dt * vz, model.length_z)
        speed = math.sqrt(square)
        momentum, energy = momentum + mass * speed, energy + mass * square
        longest = max(longest, dt * speed)
        work.clearance[i] -= dt * speed
    booked[P.fluid_work], booked[P.simultaneous_loss] = work_done, simultaneous
    booked[P.fluid_impulse_x], booked[P.fluid_impulse_y], booked[P.fluid_impulse_z] = (
        fluid_x,
        fluid_y,
        fluid_z,
    )
    return longest, momentum, energy, blows, violence


@kernel
def account(numerics, progress, dt, descent, rows, first, last, booked):
    """Book the contacts of an accepted step, keep those worth a row in the ledger; return their end."""
    kept, loss, pad, surface_x, surface_y, surface_z = first, 0.0, 0.0, 0.0, 0.0, 0.0
    for row in range(first, last):
        out = rows[row]
        if out[col.APPROACH_SPEED] > SLOWEST:
            progress[P.largest_ratio] = max(progress[P.largest_ratio], out[col.DURATION] / dt)
        loss += out[col.ENERGY_LOST]
        if out[col.KIND] == col.KIND_PAD:
            pad += out[col.NORMAL_IMPULSE]
        elif out[col.KIND] == col.KIND_SURFACE:
            surface_x += out[col.NORMAL_IMPULSE] * out[col.NX]
            surface_y += out[col.NORMAL_IMPULSE] * out[col.NY]
            surface_z += out[col.NORMAL_IMPULSE] * out[col.NZ]
        if out[col.REMOVED_VOLUME] > 0.0:
            booked[P.removals] += 1
            booked[P.removed_volume] += out[col.REMOVED_VOLUME]
            booked[P.removed_mass] += out[col.REMOVED_MASS]
            booked[P.depth_sum] += out[col.DEPTH]
        if out[col.APPROACH_SPEED] >= numerics.ledger_speed or out[col.REMOVED_VOLUME] > 0.0:
            rows[kept] = out
            kept += 1
    booked[P.contacts], booked[P.contact_loss] = last - first, loss
    booked[P.pad_impulse_z], booked[P.pad_work] = -pad, pad * descent
    booked[P.surface_impulse_x], booked[P.surface_impulse_y] = surface_x, surface_y
    booked[P.surface_impulse_z] = surface_z
    return kept


@kernel
def add(progress, booked, lost):
    """Add the sums of a step to those of the run, compensated (Kahan); `booked` is emptied.

    Without it 1e8 additions to one number would be off by up to 1e8 u.  `lost` is what the last additions
    have rounded off.
    """
    for k in range(P.contacts, len(P)):
        term = booked[k] - lost[k]
        total = progress[k] + term
        lost[k] = (total - progress[k]) - term
        progress[k] = total
        booked[k] = 0.0


@kernel
def advance(model, numerics, progress, t_end, steps_left, p, heights, rows):
    """Advance the Particles `p` and the surface in place until `t_end`, or until something is in the way.

    With `point_implicit` exactly `steps_left` equal steps lead to `t_end`; with `fixed_point` the step
    adapts.  `progress` holds the scalars of `Progress`.  Returns a status (DONE, LEDGER_FULL, ...).
    """
    n = p.position.shape[0]
    periods = np.array([model.length_x, model.length_y, model.length_z])
    work, booked, lost = empty_work(n), np.zeros(len(P)), progress[len(P) :]
    momentum_before, energy_before = momentum_and_energy(p)
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
        if model.has_pad:
            work.descent[0] = pad_velocity(model, pad_height, lowest_pad_height(model, highest, largest))

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

        way, momentum, energy, blows, violence = accept(model, dt, p, work, booked)
        travelled += way
        terms = n + found - used
        booked[P.momentum_rounding] = round_off(terms, momentum_before + momentum + blows)
        booked[P.energy_rounding] = round_off(terms, 3.0 * (energy_before + energy + violence))
        momentum_before, energy_before = momentum, energy
        if model.has_surface and commit_removal(model, heights, rows, used, found):
            highest = heights.max()
        progress[P.rows] = account(numerics, progress, dt, work.descent[0], rows, used, found, booked)
        add(progress, booked, lost)
        step += 1
        progress[P.steps] += 1
        progress[P.time] = time + dt if numerics.fixed_point else t_start + step * uniform
        if model.has_pad:
            lowest = lowest_pad_height(model, highest, largest)
            progress[P.pad_height] = lowered_pad(model, pad_height, lowest, dt)
