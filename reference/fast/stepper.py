"""The fast stepper: the same contacts, impulses and removal as `timestep.advance`, which is the answer key.

Few particles are moved by the loop of `few.py`, many by that of `many.py`, in threads; each is compiled
where it is first needed.  Books are kept of contacts and removal; those of the fluid and of energy are the
answer key's.
"""

from __future__ import annotations

import math

import numpy as np

from reference.fast.ceiling import ceiling_over
from reference.fast.few import march_few
from reference.fast.groups import PIECE
from reference.fast.known import fastest_flow, fixed_of, know_all
from reference.fast.many import CROWDED, march_many
from reference.fast.swarm import MANY, bring_back, swarm_of
from reference.fast.threads import as_many_as_help
from reference.fast.watch import AHEAD, MARGIN
from reference.neighbors import by_cells
from reference.timestep import P, advance

BOOKED = ("contacts", "removals", "removed_volume", "removed_mass", "depth_sum")  # of the sums of a run


def in_tiles(position, largest, periods):
    """Numbers of the particles, cell by cell within tiles of as many as a piece has; where tiles begin."""
    order, _ = by_cells(position, 2.0 * largest, periods)
    tile = np.sqrt(PIECE / len(position) * np.prod(np.ptp(position[:, :2], axis=0)))
    tile_order, tiles = by_cells(position[order], max(tile, 2.0 * largest), periods)
    return order[tile_order], tiles


def advance_fast(model, numerics, progress, t_end, steps_left, p, heights, rows):
    """Advance as `timestep.advance` does, with the scheme `point_implicit`; the same arguments and status."""
    if not np.isfinite(p.position).all():  # what is looked up by position would be anything
        return advance(model, numerics, progress, t_end, steps_left, p, heights, rows)
    n, t_start, before = len(p.mass), progress[P.time], progress[P.steps]
    dt = (t_end - t_start) / max(steps_left, 1)
    periods = np.array([model.length_x, model.length_y, model.length_z])
    largest = p.diameter.max(initial=0.0)
    many = n >= MANY
    order, tiles = in_tiles(p.position, largest, periods) if many else (np.arange(n), None)
    s, w = swarm_of(model, dt, p, order), know_all(n, (0, 0) if many else heights.shape)
    ahead = (1.0 + MARGIN) * AHEAD * dt
    way = ahead * fastest_flow(model)
    ceiling = ceiling_over(heights, model.spacing, 0.5 * largest + way)
    room = math.inf  # pieces of many have a part of the surface alone
    if many:
        room = way if way > 0.0 else ahead * np.linalg.norm(p.velocity, axis=1).max()
    fixed = fixed_of(model, numerics, dt, largest, ceiling.reach, room)
    arguments = (
        model, numerics, fixed, progress, t_start, steps_left, largest, periods, s, w, ceiling, heights, rows,
    )  # fmt: skip
    if many:
        with as_many_as_help(n):
            status = march_many(*arguments, order, tiles)
        if status == CROWDED:  # nothing that it had in memory of its own is of use to the answer key
            bring_back(model, s, p, order)
            left = steps_left - int(progress[P.steps] - before)
            return advance(model, numerics, progress, t_end, left, p, heights, rows)
    else:
        status = march_few(*arguments)
    bring_back(model, s, p, order)
    return status
