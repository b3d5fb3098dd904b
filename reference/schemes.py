"""One step of each scheme: velocities at its end from the contacts at its start (Eqs 37-43).

`point_implicit` solves the drag of each particle in closed form and is stable for steps longer than the
relaxation time.  `fixed_point` is the paper's: all particles are iterated together.  Moving on, and how long
the next step is, stands in `timestep.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from reference.collisions import collide_pad, collide_pairs, collide_surface, deliver
from reference.compiled import formula, inlined, kernel
from reference.drag import drag_factor, fluid_velocity
from reference.state import FLOW_NONE, Particles

MOST_DRAG_ITERATIONS = 100


class Numerics(NamedTuple):
    """How the equations are solved."""

    time_step: float  # largest step, dt_lim, s
    fixed_point: bool  # the paper's scheme; else point_implicit
    tolerance: float  # TOL
    iterations: int  # k_d
    printed_norm: bool  # 3(a) as printed: relative to |r|, which depends on the origin
    iterated_contacts: bool  # contacts at each iterate, as printed: forms a two-cycle
    ledger_speed: float  # slower contacts that remove nothing are counted, but not kept in the ledger, m/s


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
    work.blows[:] = 0.0
    work.gained[:] = 0.0
    work.simultaneous[:] = 0.0
    if model.has_pairs:
        row = collide_pairs(model, dt, time, pad_height, pairs, p, work, rows, row)
    walls = row
    if model.has_surface:
        row = collide_surface(model, dt, time, pad_height, p, heights, work.clearance, rows, row)
    if model.has_pad:
        row = collide_pad(model, time, pad_height, work.descent[0], p, rows, row)
    deliver(model, p, work, rows, walls, row)
    return row


@inlined
def solve_particle(model, tolerance, dt, pad_height, z, vx, vy, vz, mass, gained, jx, jy, jz, diameter):
    """One particle's step: its velocity, the impulse of the drag on it, and whether the iteration converged.

    Paper: Eqs. (37)-(39) in momentum form, (m+dm) v' = m v + J + dt k (u - v'), solved for v' with k and u
    iterated.  Written as an increment: a particle that moves with the fluid keeps its velocity to the bit.
    The impulse dt k (u - v') is that of the last k and u, with v' eliminated, so that it does not cancel.
    """
    wx, wy, wz = vx, vy, vz
    k, ux, uy, uz, inertia, solved = 0.0, 0.0, 0.0, 0.0, mass, False
    for _ in range(MOST_DRAG_ITERATIONS):
        k, ux, uy, uz = drag_of(model, pad_height, z + dt * wz, wx, wy, wz, diameter)
        inertia = (mass + gained) + dt * k
        ax = vx + (jx + dt * k * (ux - vx) - gained * vx) / inertia
        ay = vy + (jy + dt * k * (uy - vy) - gained * vy) / inertia
        az = vz + (jz + dt * k * (uz - vz) - gained * vz) / inertia
        change = abs(ax - wx) + abs(ay - wy) + abs(az - wz)
        wx, wy, wz = ax, ay, az
        if not change > tolerance * (abs(ax) + abs(ay) + abs(az)) or model.flow == FLOW_NONE:
            solved = True
            break
    part = dt * k / inertia
    dx = part * ((mass + gained) * (ux - vx) + gained * vx - jx)
    dy = part * ((mass + gained) * (uy - vy) + gained * vy - jy)
    dz = part * ((mass + gained) * (uz - vz) + gained * vz - jz)
    return wx, wy, wz, dx, dy, dz, solved


@kernel
def solve_point_implicit(model, tolerance, dt, pad_height, p, work):
    """Velocities and the drag's impulses into `work`; return the first particle not solved, or -1."""
    for i in range(p.position.shape[0]):
        vx, vy, vz = p.velocity[i]
        jx, jy, jz = work.impulse[i]
        wx, wy, wz, dx, dy, dz, solved = solve_particle(
            model, tolerance, dt, pad_height, p.position[i, 2], vx, vy, vz, p.mass[i], work.gained[i],
            jx, jy, jz, p.diameter[i],
        )  # fmt: skip
        work.velocity[i, 0], work.velocity[i, 1], work.velocity[i, 2] = wx, wy, wz
        work.drag[i, 0], work.drag[i, 1], work.drag[i, 2] = dx, dy, dz
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
            drag = dt * k * (u - v[axis])
            given = work.impulse[i, axis] + drag - work.gained[i] * p.velocity[i, axis]
            velocity_k = p.velocity[i, axis] + given / inertia
            work.drag[i, axis] = drag
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
