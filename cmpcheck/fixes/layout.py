"""What the fix keeps in memory, and where: per-atom columns, the context of a run, units, error codes.

Names only; what is done with them is `particles.py`, `pairs.py` and `plain.py`.
"""

from __future__ import annotations

from typing import get_type_hints

import numpy as np

from reference.ledger import COLUMNS as LEDGER_COLUMNS
from reference.state import Model

# LAMMPS `units micro`: um, us, pg.  Velocities in um/us are m/s as they stand.
MICRO = 1e-6  # m per um, s per us
PICOGRAM = 1e-15  # kg
NANO = 1e-9  # N per pg um/us2
PER_NEWTON = 1e9

FORMS = ("soft", "impulse", "observe")
SOFT, IMPULSE, OBSERVE = 0, 1, 2

# Columns of an open contact of one particle with the surface or the pad: its ledger row, then
PHASE = len(LEDGER_COLUMNS)
START = PHASE + 1  # step of its first overlap and approach
CONTACT_COLUMNS = START + 1

# Columns of the per-atom array d2_cmpcheck: the contact with the surface, then the one with the pad, so that
# both migrate between ranks and survive a restart.
PAD = CONTACT_COLUMNS
PAD_END = PAD + CONTACT_COLUMNS
CLEARANCE = PAD_END  # travel until the surface can be touched, m; not searched before
STATE_COLUMNS = CLEARANCE + 1

# Columns of d2_cmpcheck_given, what each atom was given last, for a run that goes on from there.  An array of
# its own, because it is written for every atom at every step.
FORCE = 0  # three columns, in LAMMPS units
EVALUATED = 3  # step of that evaluation plus one; 0: never evaluated
GIVEN_COLUMNS = 4

FREE, WAITING, TOUCHING = 0.0, 1.0, 2.0

# Columns of one particle as the pairs and the trajectory see it, by tag, SI.
POSITION, VELOCITY, PAIR_FORCE, FIX_FORCE, MASS, RADIUS, LAG = 0, 3, 6, 9, 12, 13, 14
BY_TAG_COLUMNS = 15

# Columns of a native contact between two particles that is open: its ledger row, the impulse on i, and
# whether it has been the only one of both particles.
PAIR_IMPULSE = len(LEDGER_COLUMNS)
ISOLATED = PAIR_IMPULSE + 3
OPEN_COLUMNS = PAIR_IMPULSE + 4

NO_ERROR, NOT_FINITE, LEDGER_FULL, TUNNELLED, TRAJECTORY_FULL, PAIRS_FULL = range(6)
ERRORS = {
    NOT_FINITE: "position, velocity or pair force is not finite",
    LEDGER_FULL: "the contact ledger is full: raise max_contacts",
    TUNNELLED: "the centre is more than a radius below the surface: shorten the time step or the contact",
    TRAJECTORY_FULL: "the trajectory is full: raise max_samples or sample_every",
    PAIRS_FULL: "too many neighbours: the particles overlap massively",
}

_TYPES = {float: "f8", int: "i8", bool: "i8"}
MODEL = np.dtype([(name, _TYPES[kind]) for name, kind in get_type_hints(Model).items()])

# Everything a compiled callback needs, at one address.  Names ending in _at are addresses.
CONTEXT = np.dtype(
    [
        ("model", MODEL),
        ("form", "i8"),
        ("time_step", "f8"),  # s, of the step at hand
        ("spring", "f8"),  # omega0^2, 1/s2
        ("damping", "f8"),  # 2 z omega0, 1/s
        ("pad_spring", "f8"),  # the same two of the pad
        ("pad_damping", "f8"),
        ("pad_height", "f8"),  # H of the step at hand, m
        ("pad_velocity", "f8"),  # downwards, m/s
        ("largest", "f8"),  # largest diameter, m
        ("ledger_speed", "f8"),  # slower contacts that remove nothing are not kept, m/s
        ("patience", "f8"),  # longest wait for a pair force to end, s
        ("highest", "f8"),  # no node is above this, m
        ("at_pad", "i8"),  # particles in its reach at the last step that came at it, or were in contact
        ("many", "i8"),  # whether those were so many that the loop over all particles did it
        ("falls", "i8"),  # how often the surface has fallen
        ("lag", "f8"),  # the velocities seen are this much older than the positions, s
        ("last_step", "i8"),
        ("rows", "i8"),  # ledger rows in use
        ("error", "i8"),
        ("error_step", "i8"),
        ("error_tag", "i8"),
        ("observe_pairs", "i8"),
        ("pairs", "i8"),  # pairs in the neighbour list; -1: none yet
        ("open", "i8"),  # native contacts that are open
        ("sample_every", "i8"),
        ("samples", "i8"),  # trajectory samples stored
        ("particles", "i8"),
        ("local", "i8"),  # atoms of the rank at this step
        ("pushed", "i8"),  # of them with a native pair force
        ("nodes_x", "i8"),
        ("nodes_y", "i8"),
        ("max_rows", "i8"),
        ("max_pairs", "i8"),
        ("max_open", "i8"),
        ("max_samples", "i8"),
        ("address", "i8"),  # of this context
        ("observe_at", "i8"),  # compiled function that follows pairs and stores the trajectory
        ("lammps", "i8"),
        ("dt_at", "i8"),
        ("allocated_at", "i8"),  # where LAMMPS keeps the length of its per-atom arrays
        ("allocated", "i8"),  # their length when the next seven were looked up
        ("x_at", "i8"),  # first rows of LAMMPS's arrays
        ("v_at", "i8"),
        ("f_at", "i8"),
        ("radius_at", "i8"),
        ("rmass_at", "i8"),
        ("state_at", "i8"),  # first row of d2_cmpcheck
        ("given_at", "i8"),  # and of d2_cmpcheck_given
        ("extract_atom_at", "i8"),
        ("force_timeout_at", "i8"),
        ("name_id_at", "i8"),
        ("name_x_at", "i8"),
        ("name_v_at", "i8"),
        ("name_f_at", "i8"),
        ("name_radius_at", "i8"),
        ("name_rmass_at", "i8"),
        ("name_state_at", "i8"),
        ("name_given_at", "i8"),
        ("tag_at", "i8"),  # those of local.Local
        ("travel_at", "i8"),
        ("since_at", "i8"),
        ("push_at", "i8"),
        ("rising_at", "i8"),
        ("due_at", "i8"),
        ("seen_at", "i8"),
        ("place_at", "i8"),  # and those of near.Near
        ("fallen_at", "i8"),
        ("number_at", "i8"),
        ("sides_at", "i8"),
        ("corners_at", "i8"),
        ("modulus_at", "i8"),
        ("heights_at", "i8"),
        ("rows_at", "i8"),
        ("by_tag_at", "i8"),
        ("position_at", "i8"),
        ("pairs_at", "i8"),
        ("listed_at", "i8"),
        ("open_at", "i8"),
        ("samples_at", "i8"),
    ]
)
