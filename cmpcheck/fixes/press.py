"""Soft contacts of particles with the pad that go on, in a loop of their own (compiled).

A particle that the pad presses has a contact for thousands of steps, and late in a run one of two particles
is pressed.  `contacts.soft_pad` would give each the same to the bit.
"""

from __future__ import annotations

import math

import numpy as np

from cmpcheck.fixes.contacts import spring_dashpot
from cmpcheck.fixes.layout import FORCE, GIVEN_COLUMNS, MICRO, NANO, PAD, PER_NEWTON, PICOGRAM
from cmpcheck.fixes.sweep import LEAST, SURELY, copied, stokes_drag, uncounted
from reference import ledger as col
from reference.state import FLOW_NONE


@uncounted
def press_down(
    adds, c, x, v, f, radius, mass, travel, since, given, state, per_diameter, due, count
):  # fmt: skip
    """Advance the contacts with the pad, of the first `count` atoms in `due`, that surely go on.

    Only of atoms too far from the surface to touch it, and slow enough for Stokes's law: what `sweep` has
    noted of them in `given` lacks the pad's force alone. Arrays as `sweep` takes them, and `state`
    (n, STATE_COLUMNS). The others stay in `due`; returns how many they are.
    """
    model, pad_height, lag, others = copied(c.model), c.pad_height, c.lag, np.uint32(0)
    acts, per_reynolds = 0.5 * c.time_step + lag, 0.0
    if model.flow != FLOW_NONE:
        per_reynolds = model.fluid_density / model.viscosity  # Re over slip and diameter, s/m2
    for number in range(np.uint32(count)):
        i = due[number]
        due[others] = i
        others += np.uint32(1)
        if not (since[i] == -math.inf and -travel[i] > LEAST):
            continue
        j, m, radius_i = 3 * i, mass[i] * PICOGRAM, radius[i] * MICRO
        z, vx, vy, vz, gz = x[j + 2] * MICRO, v[j], v[j + 1], v[j + 2], f[j + 2] * NANO
        total = x[j] + x[j + 1] + z + vx + vy + vz + f[j] + f[j + 1] + gz + m
        diameter = 2.0 * radius_i
        _, _, ez, slip = stokes_drag(model, pad_height, lag, z, vx, vy, vz, m, per_diameter * diameter)
        per_slip = per_reynolds * diameter
        v_free = vz + lag / m * (ez + gz)
        overlap = z + radius_i - pad_height
        force = spring_dashpot(
            c, c.pad_spring, c.pad_damping, m, overlap, -(v_free + c.pad_velocity)
        )  # fmt: skip
        if not (
            math.isfinite(total) and slip * (per_slip * per_slip) <= SURELY and overlap > 0.0 and force > 0.0
        ):
            continue
        others -= np.uint32(1)
        state[i, PAD + col.NORMAL_IMPULSE] += force * acts
        state[i, PAD + col.CONTACT_TIME] += acts
        state[i, PAD + col.ENERGY_LOST] += force * acts * (v_free - lag * force / m)
        row = GIVEN_COLUMNS * i + FORCE
        given[row] += 0.0  # as other sums with a force of the surface: it leaves no -0.0
        given[row + 1] += 0.0
        given[row + 2] = (ez + 0.0 - force) * PER_NEWTON
        if adds:
            for axis in range(3):
                f[j + axis] += given[row + axis]
        travel[i] -= LEAST
    return others
