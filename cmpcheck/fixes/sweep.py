"""What every particle gets at every step, in short loops that the compiler turns into vector code.

Drag as far as Stokes's law holds, and the question whether anything else can happen to a particle at this
step. Those for which it can are left to `particles.py`, one by one, which would give the others the same to
the bit.

How far each of the rank's atoms may travel is kept here, in the order in which LAMMPS has them (`Local`).
When that order changes, and before a run, it is found from where each was looked at last, without a search.
Nothing depends on it but the time it takes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from cmpcheck.fixes.layout import (
    CLEARANCE,
    EVALUATED,
    FORCE,
    FREE,
    GIVEN_COLUMNS,
    MICRO,
    PAD,
    PER_NEWTON,
    PHASE,
    PICOGRAM,
    START,
    WAITING,
)
from reference.compiled import formula, inlined, kernel
from reference.contact import surface_normal_impulse
from reference.drag import drag_factor, fluid_velocity
from reference.state import FLOW_NONE, Model

# A kernel that makes no array: the references to those it is given are not counted.
uncounted = numba.njit(cache=True, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True)
# The same, put in place where compiled code calls it: handing on an array takes seven words.
in_place = numba.njit(
    cache=True, error_model="numpy", nogil=True, _nrt=False, no_cfunc_wrapper=True, forceinline=True
)

NO_CONTACT = math.nan
NOTHING = -0.0  # what a force plus it is that force to the bit, also where that is -0.0
LEAST = 1e-300  # m: what makes a way of 0 negative
SURELY = 1.0 - 1e-9  # of Re^2 = 1: what rounding could bring above that is left to the others


class Local(NamedTuple):
    """What is kept of the rank's atoms, for n particles in all: arrays (n,), and one by tag (n, 4)."""

    tag: np.ndarray  # of the atom that the other numbers are of; 0: none yet
    travel: np.ndarray  # way until the surface can be touched, m; 0, or with the sign turned: to be looked at
    since: np.ndarray  # step since which the pad waits to strike; `NO_CONTACT`, or -inf in a soft contact
    due: np.ndarray  # room for the numbers of those that are looked at
    seen: np.ndarray  # where the surface was searched from last, and how far it was then, m; 0: never


def empty_local(n: int) -> Local:
    """For `n` particles, none of which is known yet."""
    return Local(
        np.zeros(n, np.int32), np.zeros(n), np.full(n, NO_CONTACT), np.zeros(n, np.uint32), np.zeros((n, 4))
    )


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


@uncounted
def strangers(known, tags):
    """How many atoms are not where they were at the last step, among those `known`."""
    count = 0
    for i in range(tags.size):
        count += known[i] != tags[i]
    return count


@uncounted
def meet(model, local, tags, x, radius, state):
    """Find the way left of atoms that are not where they were at the last step."""
    for i in range(tags.size):
        if local.tag[i] != tags[i]:
            local.tag[i] = tags[i]
            state[i, CLEARANCE] = way_since(model, local.seen[tags[i] - 1], x[3 * i : 3 * i + 3], radius[i])
            local.travel[i], local.since[i] = way_left(state[i]), waiting_since(state[i])


@uncounted
def way_since(model, seen, x, radius):
    """Way until a particle can touch the surface, m, 0 where that is unknown: from where it was `seen` last.

    x and radius in LAMMPS units.  It may have gone there in any way, or been moved: the surface only falls.
    """
    dx, dy, dz = seen[0] - x[0] * MICRO, seen[1] - x[1] * MICRO, seen[2] - x[2] * MICRO
    if model.length_x > 0.0:
        dx -= model.length_x * round(dx / model.length_x)
    if model.length_y > 0.0:
        dy -= model.length_y * round(dy / model.length_y)
    left = seen[3] - radius * MICRO - math.sqrt(dx * dx + dy * dy + dz * dz)
    return left if left > 0.0 else 0.0


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
    with_pad, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given
):  # fmt: skip
    """`sweep` and `sweep_with_pad`, of which the compiler makes two loops.

    What can be is told by the sign of a number: truths of several comparisons are packed and unpacked.
    """
    model, pad_height, patience, dt = copied(c.model), c.pad_height, c.patience, c.time_step
    lag, per_reynolds, evaluated, now = 0.5 * dt, 0.0, float(step + 1), float(step)
    if model.flow != FLOW_NONE:
        per_reynolds = model.fluid_density / model.viscosity  # Re over slip and diameter, s/m2
    pad = pad_height if model.has_pad else math.inf
    enough = 0.0 if adds else math.inf  # m: who has more way left gets its forces here
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
        if with_pad:
            pushed = abs(fx) + abs(fy) + abs(fz)
            no_contact = since[i] != since[i]
            struck = (reason > 0.0) & no_contact & (pushed <= 0.0) & (approach < kept)
            held = (pushed > 0.0) & ((now - since[i]) * dt < patience)
            push = surface_normal_impulse(m, -approach, model.pad_restitution) / dt
            ez -= push if struck else 0.0
            reason = 0.0 if struck | held | ((reason <= 0.0) & no_contact) else 1.0
        else:
            reason = reason if reason > -travel[i] else -travel[i]
        ex, ey, ez = ex * PER_NEWTON, ey * PER_NEWTON, ez * PER_NEWTON
        row = GIVEN_COLUMNS * i
        given[row + FORCE], given[row + FORCE + 1], given[row + FORCE + 2] = ex, ey, ez
        given[row + EVALUATED] = evaluated
        speed = abs(vx) + abs(vy) + abs(vz)  # and more: a root takes as long as all the rest
        left = abs(travel[i]) - dt * speed
        left = left if left > 0.0 else 0.0
        total = x[j] + x[j + 1] + z + speed + fx + fy + fz
        per_slip = per_reynolds * diameter
        fast = slip * (per_slip * per_slip) - SURELY
        reason = (reason if reason > fast else fast) + 0.0 * total  # not a number where one is not finite
        left = left if reason <= 0.0 else -left
        travel[i], added = left, left > enough
        ex, ey, ez = ex if added else NOTHING, ey if added else NOTHING, ez if added else NOTHING
        f[j], f[j + 1], f[j + 2] = fx + ex, fy + ey, fz + ez


@uncounted
def sweep(
    adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given
):  # fmt: skip
    """Note the drag in `given`, in LAMMPS units, and take the step's way off `travel` (n,).

    Turns the sign of `travel` where more than Stokes's drag may act: above Re = 1, at the pad, where the
    surface may be touched; and where a number is not finite.  When the fix `adds`, the drag of those with way
    left is added to `f`.  x, v, f and `given` are rows, one behind the other, (3 n,) and (GIVEN_COLUMNS n,):
    with (n, 3) the loop would not be vectorised.  `per_diameter` is drag over slip and diameter, kg/(s m).
    The pad acts on what rises faster than -`strikes`, m/s.
    """
    sweep_form(False, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given)


@uncounted
def sweep_with_pad(
    adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given
):  # fmt: skip
    """As `sweep`, and what the pad does to most.  For when many particles are at the pad.

    In the impulse form it strikes those that come at it at less than `kept` (m/s), so that the ledger has no
    row of them, and holds back from those on which a pair force acts, for less than `patience` (s).
    """
    sweep_form(True, adds, c, step, strikes, kept, per_diameter, x, v, f, radius, mass, travel, since, given)


@uncounted
def show_contacts(travel, since):
    """Turn the sign of `travel` of all in contact with the pad, of which only `since` may have told."""
    for i in range(travel.size):
        if since[i] == since[i]:
            travel[i] = -abs(travel[i]) - LEAST


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
def way_left(contact):
    """What `travel` shall be of a particle that was looked at: the way until it can touch the surface, m.

    0 when it is in contact with the surface, and negative in contact with the pad: to be looked at again.
    """
    way = max(contact[CLEARANCE], 0.0) if contact[PHASE] == FREE else 0.0
    return way if contact[PAD + PHASE] == FREE else -way - LEAST


@uncounted
def waiting_since(contact):
    """What `since` shall be of a particle that was looked at: when its contact with the pad began."""
    phase = contact[PAD + PHASE]
    if phase == FREE:
        return NO_CONTACT
    return contact[PAD + START] if phase == WAITING else -math.inf
