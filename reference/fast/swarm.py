"""The particles as one array per component, and the constants that a step needs of each; no physics.

Arrays are longer than the number of particles, by as many that rest in nothing as fill the last vector
register: loops over whole registers have no remainder.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import inlined, inner, kernel
from reference.state import FLOW_NONE
from reference.timestep import wrap

PADDING = 16  # a multiple of the doubles in a vector register
MANY = 4096  # particles, from which on they are moved by the loop for many
# Few particles have their components at distances that the compiler knows: it sees that nothing overlaps, and
# keeps one address instead of dozens.  With a power of 2 all would compete for the same lines of a cache.
ROW = MANY + 72


class Swarm(NamedTuple):
    """Arrays (M,), M >= N, SI."""

    x: np.ndarray  # position, m
    y: np.ndarray
    z: np.ndarray
    vx: np.ndarray  # velocity, m/s
    vy: np.ndarray
    vz: np.ndarray
    mass: np.ndarray  # kg
    per_mass: np.ndarray  # 1/kg
    radius: np.ndarray  # m
    modulus: np.ndarray  # E/(1-nu^2), Pa
    drag: np.ndarray  # k = 3 pi mu d of Stokes's drag, kg/s
    rate: np.ndarray  # k/m, 1/s
    yielding: np.ndarray  # dt k/(m + dt k): the part of u - v that a step takes
    jx: np.ndarray  # impulse of the step's contacts with particles and surface, N s
    jy: np.ndarray
    jz: np.ndarray
    wx: np.ndarray  # velocity after these and the pad's, before the drag of the step, m/s
    wy: np.ndarray
    wz: np.ndarray
    gained: np.ndarray  # mass picked up, kg
    contacts: np.ndarray  # how many there were; those of pairs with the first of them
    longest: np.ndarray  # duration of any of them, s
    met_surface: np.ndarray  # step in which it last touched the surface
    x_low: np.ndarray  # a box that w stays in as long as nothing but fluid and pad act on it, m/s
    x_high: np.ndarray
    y_low: np.ndarray
    y_high: np.ndarray
    z_low: np.ndarray
    z_high: np.ndarray
    outside: np.ndarray  # 1 where w is not in it
    flat: np.ndarray  # all of these, one behind the other


COMPONENTS = len(Swarm._fields) - 1


class Scratch(NamedTuple):
    """Who is apart in a step, for N particles."""

    thrown: np.ndarray  # (N,), particles that have left their boxes
    special: np.ndarray  # (N,), particles that are solved by themselves
    kept: np.ndarray  # (N, 9), position, velocity and impulse of the special ones before the step
    position: np.ndarray  # (3,), of one particle
    velocity: np.ndarray  # (3,)


@inner
def scratch_of(n):
    """Scratch for n particles."""
    return Scratch(np.empty(n, np.uint32), np.empty(n, np.uint32), np.empty((n, 9)), np.empty(3), np.empty(3))


@inlined
def views(flat, row, size):
    """The swarm whose components are `row` numbers apart, `size` of each."""
    return Swarm(
        flat[0 * row : 0 * row + size], flat[1 * row : 1 * row + size], flat[2 * row : 2 * row + size],
        flat[3 * row : 3 * row + size], flat[4 * row : 4 * row + size], flat[5 * row : 5 * row + size],
        flat[6 * row : 6 * row + size], flat[7 * row : 7 * row + size], flat[8 * row : 8 * row + size],
        flat[9 * row : 9 * row + size], flat[10 * row : 10 * row + size], flat[11 * row : 11 * row + size],
        flat[12 * row : 12 * row + size], flat[13 * row : 13 * row + size], flat[14 * row : 14 * row + size],
        flat[15 * row : 15 * row + size], flat[16 * row : 16 * row + size], flat[17 * row : 17 * row + size],
        flat[18 * row : 18 * row + size], flat[19 * row : 19 * row + size], flat[20 * row : 20 * row + size],
        flat[21 * row : 21 * row + size], flat[22 * row : 22 * row + size], flat[23 * row : 23 * row + size],
        flat[24 * row : 24 * row + size], flat[25 * row : 25 * row + size], flat[26 * row : 26 * row + size],
        flat[27 * row : 27 * row + size], flat[28 * row : 28 * row + size], flat[29 * row : 29 * row + size],
        flat,
    )  # fmt: skip


def swarm_of(model, dt, p, order):
    """The Particles `p` as a swarm that is moved in steps of `dt`; its particle i is the one order[i]."""
    padded = PADDING * ((len(order) + PADDING - 1) // PADDING)
    row = max(ROW, padded)
    return filled(model, dt, p, order, np.zeros(COMPONENTS * row), row, padded)


@kernel
def filled(model, dt, p, order, flat, row, padded):
    """`swarm_of` in the memory `flat`: components are `row` numbers apart, `padded` of each are used."""
    n, s = order.size, views(flat, row, padded)
    for i in range(n):
        k = order[i]
        s.x[i], s.y[i], s.z[i] = p.position[k]
        s.vx[i], s.vy[i], s.vz[i] = p.velocity[k]
        s.mass[i], s.radius[i], s.modulus[i] = p.mass[k], 0.5 * p.diameter[k], p.modulus[k]
        if model.flow != FLOW_NONE:
            s.drag[i] = 3.0 * math.pi * model.viscosity * p.diameter[k]
        adapt(s, dt, i)
    for i in range(n, padded):
        rest(s, i)
    return s


@inner
def rest(s, i):
    """Have number i of the swarm be no particle: at rest, without drag, and never under the pad."""
    s.x[i], s.y[i], s.z[i], s.vx[i], s.vy[i], s.vz[i] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    s.mass[i], s.per_mass[i], s.yielding[i], s.radius[i] = 1.0, 1.0, 0.0, -math.inf
    s.x_low[i], s.x_high[i], s.y_low[i] = 0.0, 0.0, 0.0
    s.y_high[i], s.z_low[i], s.z_high[i] = 0.0, 0.0, 0.0


@inner
def adapt(s, dt, i):
    """Adapt what depends on the mass of particle i."""
    s.per_mass[i], s.rate[i] = 1.0 / s.mass[i], s.drag[i] / s.mass[i]
    s.yielding[i] = dt * s.drag[i] / (s.mass[i] + dt * s.drag[i])


@kernel
def bring_back(model, s, p, order):
    """Write positions, velocities and masses of the swarm back to the Particles `p`."""
    for i in range(p.mass.shape[0]):
        k = order[i]
        p.position[k, 0] = wrap(s.x[i], model.length_x)
        p.position[k, 1] = wrap(s.y[i], model.length_y)
        p.position[k, 2] = wrap(s.z[i], model.length_z)
        p.velocity[k, 0], p.velocity[k, 1], p.velocity[k, 2] = s.vx[i], s.vy[i], s.vz[i]
        p.mass[k] = s.mass[i]
