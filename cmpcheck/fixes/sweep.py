"""What every particle gets at every step, in short loops that the compiler turns into vector code.

Drag as far as Stokes's law holds, and the question whether anything else can happen to a particle at this
step. Those for which it can are left to `particles.py`, one by one, which would give the others the same to
the bit.

How far each of the rank's atoms may travel is kept here, in the order in which LAMMPS has them (`Local`),
and found anew when that order changes. Nothing depends on it but the time it takes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cmpcheck.fixes.layout import EVALUATED, FORCE, FREE, MICRO, PAD, PER_NEWTON, PHASE, PICOGRAM
from reference.compiled import formula, kernel
from reference.drag import drag_factor, fluid_velocity
from reference.state import FLOW_NONE, Model

SURELY = 1.0 - 1e-9  # of Re^2 = 1: what rounding could bring above that is left to the others


class Local(NamedTuple):
    """What is kept of the rank's atoms, (n,) each, n the number of all particles."""

    tag: np.ndarray  # of the atom that the other number is of; 0: none yet
    travel: np.ndarray  # way until the surface can be touched, m; 0 or negative: to be looked at


def empty_local(n: int) -> Local:
    """For `n` particles, none of which is known yet."""
    return Local(np.zeros(n, dtype=np.int32), np.zeros(n))


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


@kernel
def flat(rows):
    """Rows of three, (n, 3), one behind the other, (3 n,): the compiler vectorises loops over these."""
    return rows.reshape(rows.size)


@kernel
def strangers(known, tags):
    """How many atoms are not where they were at the last step, among those `known`."""
    count = 0
    for i in range(tags.size):
        count += known[i] != tags[i]
    return count


@kernel
def meet(local, tags):
    """Atoms that are not where they were at the last step will be looked at."""
    for i in range(tags.size):
        if local.tag[i] != tags[i]:
            local.tag[i], local.travel[i] = tags[i], 0.0


@formula
def stokes_drag(model, pad_height, lag, z, vx, vy, vz, mass, k):
    """`particles.drag_now` where drag is k times the slip: three components, the square of the slip."""
    ux, uy, uz = fluid_velocity(model, pad_height, z)
    wx, wy, wz, ahead = ux - vx, uy - vy, uz - vz, lag / mass
    ex, ey, ez = k * wx, k * wy, k * wz
    ex, ey, ez = k * (ux - (vx + ahead * ex)), k * (uy - (vy + ahead * ey)), k * (uz - (vz + ahead * ez))
    return ex, ey, ez, wx * wx + wy * wy + wz * wz


@kernel
def sweep(model, pad_height, dt, per_diameter, x, v, f, radius, mass, travel, force):
    """Fill `force` with the drag, in LAMMPS units, and take this step's way off `travel` (n,).

    Turns the sign of `travel` where more than Stokes's drag may act: above Re = 1, at the pad, where the
    surface may be touched; and where a number is not finite.  x, v, f and `force` are rows of three, (3 n,);
    `per_diameter` is drag over slip and diameter, kg/(s m).
    """
    lag, per_reynolds = 0.5 * dt, 0.0
    if model.flow != FLOW_NONE:
        per_reynolds = model.fluid_density / model.viscosity  # Re over slip and diameter, s/m2
    for i in range(mass.size):
        j = 3 * i
        z, vx, vy, vz = x[j + 2] * MICRO, v[j], v[j + 1], v[j + 2]
        diameter = 2.0 * (radius[i] * MICRO)
        ex, ey, ez, slip = stokes_drag(
            model, pad_height, lag, z, vx, vy, vz, mass[i] * PICOGRAM, per_diameter * diameter
        )
        force[j], force[j + 1], force[j + 2] = ex * PER_NEWTON, ey * PER_NEWTON, ez * PER_NEWTON
        speed = abs(vx) + abs(vy) + abs(vz)  # and more: a root takes as long as all the rest
        left = travel[i] - dt * speed
        left = left if left > 0.0 else 0.0
        total = x[j] + x[j + 1] + z + speed + f[j] + f[j + 1] + f[j + 2]
        per_slip = per_reynolds * diameter
        calm = slip * (per_slip * per_slip) <= SURELY
        calm &= total - total == 0.0  # finite
        calm &= (not model.has_pad) | (z + radius[i] * MICRO <= pad_height)
        travel[i] = left if calm else -left


@kernel
def stokes_factor(model):
    """Drag over slip and diameter, to which it is proportional at Re <= 1, kg/(s m)."""
    return drag_factor(0.0, 1.0, model.fluid_density, model.viscosity) if model.flow != FLOW_NONE else 0.0


@kernel
def note_forces(step, force, state):
    """Keep in `state` what each atom was given at this step, for a run that goes on from here."""
    for i in range(force.shape[0]):
        state[i, EVALUATED] = step + 1
        state[i, FORCE], state[i, FORCE + 1], state[i, FORCE + 2] = force[i, 0], force[i, 1], force[i, 2]


@kernel
def is_free(contact):
    """Whether a particle has an open contact neither with the surface nor with the pad."""
    return contact[PHASE] == FREE and contact[PAD + PHASE] == FREE
