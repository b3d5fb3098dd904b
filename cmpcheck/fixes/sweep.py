"""What every particle gets at every step, in short loops that the compiler turns into vector code.

Drag as far as Stokes's law holds, what the pad does to many alike, and the question whether anything else can
happen to a particle at this step. Those for which it can are left to `particles.py`, one by one, which would
give the others the same to the bit.  What is kept of them from step to step: `local.py`.
"""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.fixes.calibration import eased, spring_dashpot
from cmpcheck.fixes.kernels import apart, uncounted
from cmpcheck.fixes.layout import (
    EVALUATED,
    FORCE,
    GIVEN_COLUMNS,
    MICRO,
    NANO,
    PAD,
    PER_NEWTON,
    PICOGRAM,
)
from cmpcheck.fixes.local import LEAST
from reference import ledger as col
from reference.compiled import formula, inlined, kernel
from reference.contact import surface_normal_impulse
from reference.drag import drag_factor, fluid_velocity
from reference.state import FLOW_NONE, Model

MOVING, STRIKING, PRESSING = range(3)  # kinds of sweeps
NOTHING = -0.0  # what a force plus it is that force to the bit, also where that is -0.0
SURELY = 1.0 - 1e-9  # of Re^2 = 1: what rounding could bring above that is left to the others


@kernel
def copied(model):
    """The constants as values: the compiler cannot know that those in memory stay the same."""
    return Model(
        model.length_x, model.length_y, model.length_z, model.restitution, model.static_friction,
        model.dynamic_friction, model.impact_duration, model.flow, model.fluid_density, model.viscosity,
        model.flow_x, model.flow_y, model.flow_z, model.wall_speed, model.gap, model.has_surface,
        model.spacing, model.surface_modulus, model.surface_density, model.poisson_ratio, model.yield_stress,
        model.deposit, model.acceleration, model.mass_pickup, model.threshold_velocity, model.has_pad,
        model.pad_restitution, model.pad_descent, model.pad_minimum, model.has_pairs, model.new_contacts_only,
    )  # fmt: skip


@formula
def stokes_drag(model, pad_height, lag, z, vx, vy, vz, mass, k):
    """`particles.drag_now` where drag is k times the slip: three components, the square of the slip."""
    ux, uy, uz = fluid_velocity(model, pad_height, z)
    wx, wy, wz, ahead = ux - vx, uy - vy, uz - vz, lag / mass
    ex, ey, ez = k * wx, k * wy, k * wz
    ex, ey, ez = k * (ux - (vx + ahead * ex)), k * (uy - (vy + ahead * ey)), k * (uz - (vz + ahead * ez))
    return ex, ey, ez, wx * wx + wy * wy + wz * wz


@inlined
def sweep_form(
    kind, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given, push,
    rising,
):  # fmt: skip
    """`sweep`, `sweep_with_pad` and `sweep_with_press`, of which the compiler makes three loops.

    What can be is told by the sign of a number: truths of several comparisons are packed and unpacked.
    """
    model, pad_height, patience, dt = copied(c.model), c.pad_height, c.patience, c.time_step
    lag, per_reynolds, evaluated, now = 0.5 * dt, 0.0, float(step + 1), float(step)
    if model.flow != FLOW_NONE:
        per_reynolds = model.fluid_density / model.viscosity  # Re over slip and diameter, s/m2
    pad = pad_height if model.has_pad else math.inf
    enough = 0.0 if adds else math.inf  # m: who has more way left gets its forces here
    spring, damping, descent = c.pad_spring, c.pad_damping, c.pad_velocity
    ease = eased(damping, lag)
    for i in range(mass.size):
        j = 3 * i
        z, vx, vy, vz = x[j + 2] * MICRO, v[j], v[j + 1], v[j + 2]
        fx, fy, fz = f[j], f[j + 1], f[j + 2]
        diameter = 2.0 * (radius[i] * MICRO)
        m = mass[i] * PICOGRAM
        ex, ey, ez, slip = stokes_drag(model, pad_height, lag, z, vx, vy, vz, m, per_diameter * diameter)
        approach = vz + strikes
        inside = z + radius[i] * MICRO - pad
        reason = inside if inside < approach else approach  # why not: above 0 one has to be looked at
        speed = abs(vx) + abs(vy) + abs(vz)  # and more: a root takes as long as all the rest
        left = abs(travel[i]) - dt * speed
        left = left if left > 0.0 else 0.0
        total = x[j] + x[j + 1] + z + speed + fx + fy + fz
        per_slip = per_reynolds * diameter
        fast = slip * (per_slip * per_slip) - SURELY
        if kind == STRIKING:
            pushed = abs(fx) + abs(fy) + abs(fz)
            no_contact = since[i] != since[i]
            struck = (reason > 0.0) & no_contact & (pushed <= 0.0) & (approach < kept)
            held = (pushed > 0.0) & ((now - since[i]) * dt < patience)
            impulse = surface_normal_impulse(m, -approach, model.pad_restitution) / dt
            ez -= impulse if struck else 0.0
            reason = 0.0 if struck | held | ((reason <= 0.0) & no_contact) else 1.0
        else:
            reason = reason if reason > -travel[i] else -travel[i]
        reason = (reason if reason > fast else fast) + 0.0 * total  # not a number where one is not finite
        if kind == PRESSING:
            ahead = lag / m
            v_free = vz + ahead * (ez + fz * NANO)
            force = spring_dashpot(spring, damping, ease, m, inside, -(v_free + descent))
            goes_on = (since[i] == -math.inf) & (left > LEAST) & (fast + 0.0 * total <= 0.0)
            goes_on = goes_on & (inside > 0.0) & (force > 0.0)
            force = force if goes_on else 0.0
            push[i], rising[i] = force, v_free - ahead * force
            nothing = 0.0 if goes_on else NOTHING  # 0, not -0, of a surface that might have pushed
            ex, ey, ez = ex + nothing, ey + nothing, ez + nothing - force
            left = left if reason <= 0.0 else -left
            left = left - LEAST if goes_on else left
            added = (left > enough) | (goes_on & (enough <= 0.0))
        else:
            left = left if reason <= 0.0 else -left
            added = left > enough
        travel[i] = left
        ex, ey, ez = ex * PER_NEWTON, ey * PER_NEWTON, ez * PER_NEWTON
        row = GIVEN_COLUMNS * i
        given[row + FORCE], given[row + FORCE + 1], given[row + FORCE + 2] = ex, ey, ez
        given[row + EVALUATED] = evaluated
        ex, ey, ez = ex if added else NOTHING, ey if added else NOTHING, ez if added else NOTHING
        f[j], f[j + 1], f[j + 2] = fx + ex, fy + ey, fz + ez


@apart
def sweep(
    adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given, push, rising
):  # fmt: skip
    """Note the drag in `given`, in LAMMPS units, and take the step's way off `travel` (n,).

    Turns the sign of `travel` where more than Stokes's drag may act: above Re = 1, at the pad, where the
    surface may be touched; and where a number is not finite.  When the fix `adds`, the drag of those with way
    left is added to `f`.  x, v, f and `given` are rows, one behind the other, (3 n,) and (GIVEN_COLUMNS n,):
    with (n, 3) the loop would not be vectorised.  `per_diameter` is drag over slip and diameter, kg/(s m).
    The pad acts on what rises faster than -`strikes`, m/s.
    """
    sweep_form(
        MOVING, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given, push,
        rising,
    )  # fmt: skip


@apart
def sweep_with_pad(
    adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given, push, rising
):  # fmt: skip
    """As `sweep`, and what the pad does to most in the impulse form.  For when many particles are at the pad.

    It strikes those that come at it at less than `kept` (m/s), so that the ledger has no row of them, and
    holds back from those that wait for a pair force to end, for less than `patience` (s).
    """
    sweep_form(
        STRIKING, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given,
        push, rising,
    )  # fmt: skip


@apart
def sweep_with_press(
    adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given, push, rising
):  # fmt: skip
    """As `sweep`, and what the pad does to those it presses in the soft form, for thousands of steps.

    Their forces are complete, `push` and `rising` (n,) say what the contacts' rows of them are to sum up: it
    is 0 where a contact may have ended or begun, the surface may be touched, or Stokes's law may not hold.
    `contacts.soft_pad` would give each the same to the bit.
    """
    sweep_form(
        PRESSING, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given,
        push, rising,
    )  # fmt: skip


@kernel
def stokes_factor(model):
    """Drag over slip and diameter, to which it is proportional at Re <= 1, kg/(s m)."""
    return drag_factor(0.0, 1.0, model.fluid_density, model.viscosity) if model.flow != FLOW_NONE else 0.0


@uncounted
def list_due(travel, due):
    """Write the atoms that are to be looked at one by one into `due`; return how many they are.

    Without a branch that the processor could guess wrongly.
    """
    count = np.uint32(0)
    for i in range(travel.size):
        due[count] = i
        count += np.uint32(not travel[i] > 0.0)
    return count


@uncounted
def sum_up_pushes(c, state, push, rising, due, count):
    """Add this step to the rows of contacts that the pad presses, of the first `count` atoms in `due`.

    The others stay in `due`; returns how many they are.  `state` is (n, STATE_COLUMNS).
    """
    acts, others = 0.5 * c.time_step + c.lag, np.uint32(0)
    for number in range(np.uint32(count)):
        i = due[number]
        force = push[i]
        if force > 0.0:
            state[i, PAD + col.NORMAL_IMPULSE] += force * acts
            state[i, PAD + col.CONTACT_TIME] += acts
            state[i, PAD + col.ENERGY_LOST] += force * acts * rising[i]
        else:
            due[others] = i
            others += np.uint32(1)
    return others
