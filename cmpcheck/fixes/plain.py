"""The fix in plain Python, one particle at a time: to be read beside DESIGN, and to check the compiled form.

`advance_particles` does what its namesake in `particles.py` does, with the same arguments, written anew; the
equations themselves are the reference's in both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cmpcheck.fixes.layout import (
    EVALUATED,
    FORCE,
    FREE,
    GIVEN_COLUMNS,
    IMPULSE,
    LEDGER_FULL,
    MICRO,
    NANO,
    NOT_FINITE,
    OBSERVE,
    PAD,
    PAD_END,
    PER_NEWTON,
    PHASE,
    PICOGRAM,
    START,
    TOUCHING,
    TUNNELLED,
    WAITING,
)
from reference import ledger as col
from reference.collisions import drag_on, impact_energy_lost, record_surface_impact
from reference.contact import compression_impulse, surface_normal_impulse
from reference.heightfield import surface_contact

Outcome = tuple[np.ndarray, float]  # force in N, mass gained in kg
ROW = slice(0, len(col.COLUMNS))


class StepError(Exception):
    """A step that cannot be finished, with an error code of `layout.py` as its argument."""


class Particle(NamedTuple):
    """One particle at this step, SI; `contact`, `pad` and `half_velocity` are views into LAMMPS's arrays."""

    tag: int
    position: np.ndarray
    half_velocity: np.ndarray  # of half a step ago; at the very first evaluation of now
    pair_force: np.ndarray
    mass: float
    radius: float
    modulus: float
    contact: np.ndarray  # with the surface
    pad: np.ndarray  # contact with the pad
    lag: float  # age of half_velocity
    acts: float  # the force of this step acts for so long


def dot(a: np.ndarray, b: np.ndarray) -> float:
    """Scalar product, summed in the order x, y, z."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def drag(c: Any, p: Particle) -> np.ndarray:
    """Drag at the time of the positions (Eqs 20-22)."""
    z, diameter = p.position[2], 2.0 * p.radius
    first = np.array(drag_on(c.model, c.pad_height, z, *p.half_velocity, diameter))
    return np.array(drag_on(c.model, c.pad_height, z, *(p.half_velocity + p.lag / p.mass * first), diameter))


def open_contact(c: Any, p: Particle, time: float, velocity: np.ndarray, hit: tuple[float, ...]) -> None:
    """Write approach, load and removal of an impact into the particle's row (Eqs 30, 34-36)."""
    record_surface_impact(
        c.model, c.pad_height, time, p.tag - 1, hit, p.position, velocity, p.mass, 2.0 * p.radius, p.modulus,
        p.contact[ROW],
    )  # fmt: skip


def close_contact(c: Any, contact: np.ndarray, rows: np.ndarray) -> None:
    """Ledger row of a contact that has ended, unless it was slow and in vain."""
    contact[PHASE] = FREE
    if contact[col.APPROACH_SPEED] < c.ledger_speed and contact[col.REMOVED_VOLUME] == 0.0:
        return
    if c.rows == len(rows):
        raise StepError(LEDGER_FULL)
    rows[c.rows] = contact[ROW]
    c.rows += 1


def pick_up(p: Particle, gained: float) -> None:
    """Velocity of the heavier particle: (m + dm) v' = m v (Eq 24)."""
    p.half_velocity[:] *= p.mass / (p.mass + gained)


def velocity_now(p: Particle, e: np.ndarray) -> np.ndarray:
    """Velocity at the time of the positions, but for contacts with surface and pad."""
    return p.half_velocity + p.lag / p.mass * (e + p.pair_force)


def is_waiting(c: Any, p: Particle, contact: np.ndarray, step: int) -> bool:
    """Whether an impulse is held back for the sake of a pair force, whatever the particle does meanwhile."""
    recent = (step - contact[START]) * c.time_step < c.patience
    return bool(contact[PHASE] == WAITING and p.pair_force.any() and recent)


def begins_to_wait(c: Any, p: Particle, contact: np.ndarray, step: int) -> bool:
    """Whether an impulse is held back that has not been yet; notes when the contact began."""
    if contact[PHASE] != FREE:
        return False
    contact[PHASE], contact[START] = WAITING, step
    return is_waiting(c, p, contact, step)


def soft_contact(c: Any, p: Particle, step: int, e: np.ndarray, touch: tuple, rows: np.ndarray) -> Outcome:
    """Force F = max(0, k x - c v_n) along the normal, and the mass gained when the contact has ended."""
    found, overlap, nx, ny, nz, qx, qy, qz, _ = touch
    n = np.array([nx, ny, nz])
    velocity = velocity_now(p, e)
    v_n = dot(velocity, n)
    overlaps = found and overlap > 0.0
    if p.contact[PHASE] != TOUCHING:
        if not (overlaps and v_n < 0.0):
            return np.zeros(3), 0.0
        open_contact(c, p, step * c.time_step, velocity, (nx, ny, nz, qx, qy, qz))
        p.contact[PHASE] = TOUCHING
    force = 0.0
    if overlaps:
        force = 1.0 / (1.0 + c.damping * p.lag) * (p.mass * (c.spring * overlap - c.damping * v_n))
    if force > 0.0:
        p.contact[col.NORMAL_IMPULSE] += force * p.acts
        p.contact[col.CONTACT_TIME] += p.acts
        p.contact[col.ENERGY_LOST] -= force * p.acts * (v_n + p.lag * force / p.mass)
        return force * n, 0.0
    gained = p.contact[col.REMOVED_MASS] if c.model.mass_pickup else 0.0
    square = dot(p.half_velocity, p.half_velocity)
    p.contact[col.ENERGY_LOST] += 0.5 * p.mass * square * gained / (p.mass + gained)
    close_contact(c, p.contact, rows)
    pick_up(p, gained)
    return np.zeros(3), gained


def impulse_contact(c: Any, p: Particle, step: int, touch: tuple, rows: np.ndarray) -> Outcome:
    """Force J/dt along the normal for one step, once no pair force acts, and the mass gained (Eqs 29-31)."""
    found, overlap, nx, ny, nz, qx, qy, qz, _ = touch
    n = np.array([nx, ny, nz])
    v_n = dot(p.half_velocity, n)
    if not (found and overlap > 0.0 and v_n < 0.0):
        p.contact[PHASE] = FREE
        return np.zeros(3), 0.0
    if begins_to_wait(c, p, p.contact, step):
        return np.zeros(3), 0.0
    open_contact(c, p, p.contact[START] * c.time_step, p.half_velocity, (nx, ny, nz, qx, qy, qz))
    duration, e = p.contact[col.DURATION], c.model.restitution
    ext = compression_impulse(p.contact[col.EXTERNAL_FORCE], duration, p.acts, e)
    j = surface_normal_impulse(p.mass, v_n, e, ext)
    gained = p.contact[col.REMOVED_MASS] if c.model.mass_pickup else 0.0
    p.contact[col.NORMAL_IMPULSE], p.contact[col.CONTACT_TIME] = j, min(duration, p.acts)
    p.contact[col.ENERGY_LOST] = impact_energy_lost(p.mass, gained, p.half_velocity, v_n, j)
    close_contact(c, p.contact, rows)
    pick_up(p, gained)
    return j / p.acts * n, gained


def open_pad_contact(c: Any, p: Particle, time: float, approach: float) -> None:
    """Write time, place and approach of a contact with the pad into the particle's row."""
    x, y, _ = p.position
    p.pad[ROW] = 0.0
    p.pad[[col.TIME, col.KIND, col.I, col.J]] = time, col.KIND_PAD, p.tag - 1, -1
    p.pad[[col.X, col.Y, col.Z, col.NZ, col.APPROACH_SPEED]] = x, y, c.pad_height, -1.0, approach


def soft_pad(c: Any, p: Particle, step: int, e: np.ndarray, rows: np.ndarray) -> float:
    """Force of the pad, F = max(0, k x - c v_n) downwards, with v_n relative to it."""
    overlap, v_z = p.position[2] + p.radius - c.pad_height, velocity_now(p, e)[2]
    approach = v_z + c.pad_velocity
    if p.pad[PHASE] != TOUCHING:
        if not (overlap > 0.0 and approach > 0.0):
            return 0.0
        open_pad_contact(c, p, step * c.time_step, approach)
        p.pad[PHASE] = TOUCHING
    force = p.mass * (c.pad_spring * overlap + c.pad_damping * approach)
    force *= 1.0 / (1.0 + c.pad_damping * p.lag)
    if overlap <= 0.0 or force <= 0.0:
        close_contact(c, p.pad, rows)
        return 0.0
    p.pad[col.NORMAL_IMPULSE] += force * p.acts
    p.pad[col.CONTACT_TIME] += p.acts
    p.pad[col.ENERGY_LOST] += force * p.acts * (v_z - p.lag / p.mass * force)
    return float(force)


def impulse_pad(c: Any, p: Particle, step: int, rows: np.ndarray) -> float:
    """Force of the pad, J/dt downwards for one step, once no pair force acts."""
    if is_waiting(c, p, p.pad, step):
        return 0.0
    approach = p.half_velocity[2] + c.pad_velocity
    if p.position[2] + p.radius <= c.pad_height or approach <= 0.0:
        p.pad[PHASE] = FREE
        return 0.0
    if begins_to_wait(c, p, p.pad, step):
        return 0.0
    open_pad_contact(c, p, p.pad[START] * c.time_step, approach)
    j = surface_normal_impulse(p.mass, -approach, c.model.pad_restitution)
    p.pad[col.NORMAL_IMPULSE] = j
    p.pad[col.ENERGY_LOST] = impact_energy_lost(p.mass, 0.0, p.half_velocity, -p.half_velocity[2], j)
    close_contact(c, p.pad, rows)
    return float(j / p.acts)


def advance_particle(c: Any, p: Particle, step: int, heights: np.ndarray, rows: np.ndarray) -> Outcome:
    """Drag and contacts of one particle: its force in N, and the mass gained in kg."""
    if not np.isfinite([*p.position, *p.half_velocity, *p.pair_force, p.mass]).all():
        raise StepError(NOT_FINITE)
    if c.form == OBSERVE:
        return np.zeros(3), 0.0
    e = drag(c, p)
    push = 0.0
    if c.model.has_pad:
        push = impulse_pad(c, p, step, rows) if c.form == IMPULSE else soft_pad(c, p, step, e, rows)
    down = np.array([0.0, 0.0, -push])
    above = p.position[2] - p.radius >= c.highest
    if not c.model.has_surface or (above and p.contact[PHASE] == FREE):
        return e + down, 0.0
    if c.form == IMPULSE and is_waiting(c, p, p.contact, step):
        return e + down, 0.0
    touch = surface_contact(heights, c.model.spacing, *p.position, p.radius)
    if touch[1] > 2.0 * p.radius:
        raise StepError(TUNNELLED)
    if c.form == IMPULSE:
        force, gained = impulse_contact(c, p, step, touch, rows)
    else:
        force, gained = soft_contact(c, p, step, e, touch, rows)
    return e + force + down, gained


def advance_particles(
    c: Any, step: int, adds: bool, tags: np.ndarray, x: np.ndarray, v: np.ndarray, f: np.ndarray,
    radius: np.ndarray, mass: np.ndarray, state: np.ndarray, given: np.ndarray, modulus: np.ndarray,
    heights: np.ndarray, rows: np.ndarray, _local: Any, _near: Any,
) -> None:  # fmt: skip
    """Note the forces of this step in `given`, in LAMMPS units; see `particles.advance_particles`.

    What only saves time, `_local` and `_near`, has no use here.
    """
    x, v, f, given = x.reshape(-1, 3), v.reshape(-1, 3), f.reshape(-1, 3), given.reshape(-1, GIVEN_COLUMNS)
    c.lag = 0.0
    for i, tag in enumerate(tags):
        if given[i, EVALUATED] == step + 1:
            continue
        c.lag = 0.5 * c.time_step if given[i, EVALUATED] > 0.0 else 0.0
        given[i, EVALUATED] = step + 1
        p = Particle(
            tag, x[i] * MICRO, v[i], f[i] * NANO, mass[i] * PICOGRAM, radius[i] * MICRO, modulus[tag - 1],
            state[i], state[i, PAD:PAD_END], c.lag, 0.5 * c.time_step + c.lag,
        )  # fmt: skip
        try:
            newtons, gained = advance_particle(c, p, step, heights, rows)
        except StepError as error:
            c.error, c.error_step, c.error_tag = error.args[0], step, tag
            return
        mass[i] += gained / PICOGRAM
        given[i, FORCE : FORCE + 3] = newtons * PER_NEWTON
    if adds:
        f += given[:, FORCE : FORCE + 3]
