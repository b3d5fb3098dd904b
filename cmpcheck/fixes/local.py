"""What is kept of the rank's atoms from one step to the next, in the order in which LAMMPS has them.

How far each may travel, and since when the pad waits. When that order changes, and before a run, it is found
from where each was looked at last, without a search.  Nothing depends on it but the time it takes.  And room
for what is not kept, but handed from one loop to the next.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cmpcheck.fixes.kernels import uncounted
from cmpcheck.fixes.layout import CLEARANCE, FREE, MICRO, PAD, PHASE, START, WAITING

NO_CONTACT = math.nan
LEAST = 1e-300  # m: what makes a way of 0 negative


class Local(NamedTuple):
    """What is kept of the rank's atoms, for n particles in all: arrays (n,), and one by tag (n, 4)."""

    tag: np.ndarray  # of the atom that the other numbers are of; 0: none yet
    travel: np.ndarray  # way until the surface can be touched, m; 0, or with the sign turned: to be looked at
    since: np.ndarray  # step since which the pad waits to strike; `NO_CONTACT`, or -inf in a soft contact
    due: np.ndarray  # room for the numbers of those that are looked at
    push: np.ndarray  # room for that of the pad in soft contacts that go on, N; 0: none, or not known
    rising: np.ndarray  # room for velocities under that push, m/s
    seen: np.ndarray  # where the surface was searched from last, and how far it was then, m; 0: never


def empty_local(n: int) -> Local:
    """For `n` particles, none of which is known yet."""
    return Local(
        np.zeros(n, np.int32), np.zeros(n), np.full(n, NO_CONTACT), np.zeros(n, np.uint32), np.zeros(n),
        np.zeros(n), np.zeros((n, 4)),
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


@uncounted
def show_contacts(travel, since):
    """Turn the sign of `travel` of all in contact with the pad, of which only `since` may have told."""
    for i in range(travel.size):
        if since[i] == since[i]:
            travel[i] = -abs(travel[i]) - LEAST


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
