"""Single contacts of the fast stepper: strikes on the surface, and the ledger rows of pairs and of the pad.

They are few: what they give is computed by the functions of `collisions.py`.  No array is made here: the loop
that calls these functions counts no references.
"""

from __future__ import annotations

import math

from reference import ledger as col
from reference.collisions import (
    commit_removal,
    drag_on,
    duration_of,
    impact_energy_lost,
    pair_impulse,
    record_pair_contact,
    strike_surface,
)
from reference.compiled import formula, inner, part
from reference.contact import compression_impulse, effective_modulus, surface_normal_impulse
from reference.neighbors import minimum_image
from reference.state import DEPOSIT_NONE
from reference.timestep import P, wrap


@inner
def record_pair(model, dt, time, pad_height, s, i, j, out):
    """Fill ledger row `out` with the contact of particles i and j."""
    dx = minimum_image(s.x[j] - s.x[i], model.length_x)
    dy = minimum_image(s.y[j] - s.y[i], model.length_y)
    dz = minimum_image(s.z[j] - s.z[i], model.length_z)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    nx, ny, nz = dx / distance, dy / distance, dz / distance
    vx, vy, vz = s.vx[j] - s.vx[i], s.vy[j] - s.vy[i], s.vz[j] - s.vz[i]
    separation = vx * nx + vy * ny + vz * nz
    on_i = drag_on(model, pad_height, s.z[i], s.vx[i], s.vy[i], s.vz[i], 2.0 * s.radius[i])
    on_j = drag_on(model, pad_height, s.z[j], s.vx[j], s.vy[j], s.vz[j], 2.0 * s.radius[j])
    _, _, _, normal, friction, lost, duration, within, external = pair_impulse(
        model, dt, s.mass[i], s.mass[j], 2.0 * s.radius[i], 2.0 * s.radius[j],
        effective_modulus(s.modulus[i], s.modulus[j]), (nx, ny, nz), (vx, vy, vz), separation, on_i, on_j,
    )  # fmt: skip
    x, y = wrap(s.x[i], model.length_x), wrap(s.y[i], model.length_y)
    touch = (x + s.radius[i] * nx, y + s.radius[i] * ny, s.z[i] + s.radius[i] * nz)
    record_pair_contact(
        time, i, j, touch, (nx, ny, nz), -separation, normal, friction, lost, duration, within, external, out
    )


@inner
def record_pad(model, numerics, time, pad_height, descent, n, s, velocity, rows, row):
    """Fill a ledger row for each impact on the pad that is worth one; return the next free row."""
    for i in range(n):
        approach = s.vz[i] + descent
        if s.z[i] + s.radius[i] <= pad_height or approach <= 0.0 or approach < numerics.ledger_speed:
            continue
        velocity[0], velocity[1], velocity[2] = s.vx[i], s.vy[i], s.vz[i]
        normal = surface_normal_impulse(s.mass[i], -approach, model.pad_restitution)
        out = rows[row]
        out[:] = 0.0
        out[col.TIME], out[col.KIND], out[col.I], out[col.J] = time, col.KIND_PAD, i, -1
        out[col.X], out[col.Y] = wrap(s.x[i], model.length_x), wrap(s.y[i], model.length_y)
        out[col.Z], out[col.NZ] = pad_height, -1.0
        out[col.APPROACH_SPEED], out[col.NORMAL_IMPULSE] = approach, normal
        out[col.ENERGY_LOST] = impact_energy_lost(s.mass[i], 0.0, velocity, -velocity[2], normal)
        row += 1
    return row


@formula
def remarkable_speed(model, ledger_speed):
    """Approach (m/s) from which an impact on the surface may remove something, or has a ledger row."""
    return ledger_speed if model.deposit == DEPOSIT_NONE else min(ledger_speed, model.threshold_velocity)


@part
def bounce(model, dt, mass, radius, modulus, closing, external_force):
    """Impulse (N s) of the surface on a particle that comes down at `closing` > 0 (m/s), and duration (s).

    What `strike` finds where nothing is removed; the `external_force` is the drag along the normal, N.
    """
    duration = duration_of(model, mass, radius, effective_modulus(modulus, model.surface_modulus), closing)
    external = compression_impulse(external_force, duration, dt, model.restitution)
    return surface_normal_impulse(mass, -closing, model.restitution, external), duration


@inner
def strike(
    model, dt, time, pad_height, i, hit, x, y, z, vx, vy, vz, mass, radius, modulus, heights, position,
    velocity, rows, row,
):  # fmt: skip
    """Fill ledger row `row` with the impact of particle i on the surface."""
    position[0], position[1], position[2] = x, y, z
    velocity[0], velocity[1], velocity[2] = vx, vy, vz
    strike_surface(
        model, dt, time, pad_height, i, hit, position, velocity, mass, 2.0 * radius, modulus, heights,
        rows[row],
    )  # fmt: skip


@inner
def told_of(model, largest):
    """How many squares away a removal may matter to a particle, of the `largest` diameter (m)."""
    return int(largest / model.spacing) + 2


@inner
def mark(changed, spacing, x, y, reach, step):
    """Note `step` in all squares within `reach` squares of the one at (x, y), whose nodes have fallen."""
    i, j = math.floor(x / spacing), math.floor(y / spacing)
    for a in range(i - reach, i + reach + 1):
        for b in range(j - reach, j + reach + 1):
            changed[a % changed.shape[0], b % changed.shape[1]] = step


@inner
def book_contacts(progress, contacts, longest, dt):
    """Add contacts, of which the `longest` took so many seconds, to the sums of the run."""
    progress[P.contacts] += contacts
    if longest > 0.0:  # then steps have been made, and dt is not 0
        progress[P.largest_ratio] = max(progress[P.largest_ratio], longest / dt)


@inner
def book_removals(progress, rows, first, last):
    """Add the removals of ledger rows first ... last - 1 to the sums of the run, compensated (Kahan).

    What an addition has rounded off is in the second half of `progress`, as in `timestep.add`.
    """
    for row in range(first, last):
        if rows[row, col.REMOVED_VOLUME] > 0.0:
            progress[P.removals] += 1
            for k in range(3):
                column = (col.REMOVED_VOLUME, col.REMOVED_MASS, col.DEPTH)[k]
                total = (P.removed_volume, P.removed_mass, P.depth_sum)[k]
                term = rows[row, column] - progress[len(P) + total]
                summed = progress[total] + term
                progress[len(P) + total] = (summed - progress[total]) - term
                progress[total] = summed


@inner
def take_off(model, heights, progress, rows, first, last, largest, changed, step):
    """Remove from the surface what rows first ... last - 1 of the ledger say; return whether any do.

    `changed` (nx, ny) gets `step` wherever it may matter to a particle; `largest` is a diameter in m.
    """
    removed = commit_removal(model, heights, rows, first, last)
    if removed:
        squares = told_of(model, largest)
        for row in range(first, last):
            if rows[row, col.REMOVED_VOLUME] > 0.0:
                mark(changed, model.spacing, rows[row, col.X], rows[row, col.Y], squares, step)
    book_removals(progress, rows, first, last)
    return removed
