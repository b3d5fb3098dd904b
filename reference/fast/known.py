"""What is known of each particle, so that it need not be looked at in every step of the fast stepper.

When it is looked at next, how long its box of velocities (`swarm.py`) holds, and what stays the same for all.
What the bounds are is `watch.py`; what is done for a particle, `particle.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from reference.compiled import inner, part
from reference.fast.events import remarkable_speed
from reference.fast.near import fastest, mean
from reference.fast.watch import AHEAD, HORIZON, MARGIN, MOST_CLOSE, SAFETY, velocity_box
from reference.fast.ways import LEEWAY, STEPS
from reference.neighbors import half_period
from reference.state import FLOW_COUETTE


class Known(NamedTuple):
    """What is known of a particle, one row of numbers: these are their columns."""

    renewed: int = 0  # step until which the box of its velocity may be used again
    until: int = 1  # step until which no triangle but the close ones can be touched
    looked: int = 2  # step in which the close triangles were found
    looked_x: int = 3  # and where, m
    looked_y: int = 4
    gone: int = 5  # the way it has gone at most, relative to the mean of all, until it had this box, m
    since: int = 6  # step in which it was given it, or in which the block begins


K = Known()
COLUMNS = 8  # of such a row: a cache line


class Watch(NamedTuple):
    """When each of N particles is looked at, and what is known of it."""

    due: np.ndarray  # (N,), step in which it is looked at
    known: np.ndarray  # (COLUMNS N,), see `Known`
    pace: np.ndarray  # (N,), highest speed in the box, or now, relative to the mean of all, m/s
    nonlinear: np.ndarray  # (N,), whether the Reynolds number may exceed 1
    close: np.ndarray  # (3 MOST_CLOSE N,), squares and sides of triangles that may be touched soon
    number: np.ndarray  # (N,), how many
    changed: np.ndarray  # (nx, ny), step of the last removal near a square; of a window, or few particles


def know_all(n, shape):
    """All particles are looked at in step 0; the surface has squares of this `shape`."""
    return Watch(
        np.zeros(n, np.int64), np.zeros(COLUMNS * n), np.zeros(n), np.zeros(n, np.bool_),
        np.zeros(3 * MOST_CLOSE * n, np.int32), np.zeros(n, np.int64), np.full(shape, -1),
    )  # fmt: skip


class Fixed(NamedTuple):
    """What stays the same for all steps of a call, SI."""

    dt: float  # s
    half_x: float  # half of the period, m; infinite where not periodic
    half_y: float
    half_z: float
    margin: float  # by which a box of velocities is wider than it must be, m/s
    slip_limit: float  # (mu/rho)^2: Re <= 1 where (d |u - v|)^2 is not above it, m4/s2
    flow_x: float  # of a uniform flow, m/s; 0 in a Couette flow, which is added by its shear
    flow_y: float
    flow_z: float
    remarkable: float  # m/s, approach from which an impact on the surface removes or has a ledger row
    way: float  # AHEAD steps, s
    per_spacing: float  # one over the spacing of the nodes, 1/m
    around: float  # m, within which a particle may move for the map of the surface's maxima to hold
    room: float  # m, by which a look at the surface may reach ahead at most
    leeway: float  # m a step, that a particle of many may go beyond its box, see `ways.allow_ways`


@part
def fastest_flow(model):
    """The largest speed of the fluid, m/s."""
    return max(abs(model.wall_speed), math.hypot(model.flow_x, model.flow_y))


def fixed_of(model, numerics, dt, largest, mapped_within, room):
    """`Fixed` for steps of `dt`; the map of the surface looks `mapped_within` (m) around."""
    couette = model.flow == FLOW_COUETTE
    viscous = model.viscosity / model.fluid_density if model.fluid_density > 0.0 else math.inf
    return Fixed(
        dt, half_period(model.length_x), half_period(model.length_y), half_period(model.length_z),
        MARGIN * fastest_flow(model),
        viscous * viscous,
        0.0 if couette else model.flow_x, 0.0 if couette else model.flow_y, 0.0 if couette else model.flow_z,
        remarkable_speed(model, numerics.ledger_speed), AHEAD * dt,
        1.0 / model.spacing if model.has_surface else 0.0,
        SAFETY * mapped_within - 0.5 * largest, room, LEEWAY * largest / STEPS,
    )  # fmt: skip


@part
def pace_of(s, i, mean_x, mean_y):
    """The highest speed in the box of particle i, relative to a mean, m/s.

    Of one that has just gained mass it is of no use until the next step, which gives it another box first.
    """
    return fastest(s.x_low[i], s.x_high[i], s.y_low[i], s.y_high[i], s.z_low[i], s.z_high[i], mean_x, mean_y)


@inner
def renew_paces(s, pace):
    """Have `pace` (N,) be relative to the mean velocity as it is now, which is returned: (x, y), m/s."""
    n = pace.size
    mean_x, mean_y = mean(s.vx, n), mean(s.vy, n)
    for i in range(n):
        pace[i] = pace_of(s, i, mean_x, mean_y)
    return mean_x, mean_y


@part
def in_box(s, i, vx, vy, vz):
    """Whether a velocity of particle i is within its box."""
    inside = (s.x_low[i] <= vx) & (vx <= s.x_high[i])
    inside &= (s.y_low[i] <= vy) & (vy <= s.y_high[i])
    return inside & (s.z_low[i] <= vz) & (vz <= s.z_high[i])


@part
def note_way(known, i, step, dt, pace, before):
    """Note how far particle i may have gone in the box that it has left, or that another one has replaced.

    Its highest speed was `before` there, and is `pace` from now on (m/s), which it may have had in the last
    step already.
    """
    row = COLUMNS * i
    steps = step - known[row + K.since]
    if steps > 0.0:
        known[row + K.gone] += dt * (steps * before + max(0.0, pace - before))
        known[row + K.since] = step


@part
def renew(model, fixed, s, w, i, step, pad_height, mean_x, mean_y):
    """Give particle i a new box; return 1, -1 or 0: how many more may have drag that is not linear."""
    s.x_low[i], s.x_high[i], s.y_low[i], s.y_high[i], s.z_low[i], s.z_high[i], slip = velocity_box(
        model, fixed.dt, pad_height, fixed.margin, s.drag[i], s.z[i], s.vx[i], s.vy[i], s.vz[i]
    )
    w.known[COLUMNS * i + K.renewed] = step + HORIZON - AHEAD - 1
    w.pace[i] = pace_of(s, i, mean_x, mean_y)
    over = 4.0 * s.radius[i] * s.radius[i] * slip > fixed.slip_limit
    # nor can the sweep wrap a particle that crosses the box in one step
    over = over or fixed.dt * max(s.z_high[i], -s.z_low[i]) >= 2.0 * fixed.half_z
    before = w.nonlinear[i]
    w.nonlinear[i] = over
    return int(over) - int(before)
