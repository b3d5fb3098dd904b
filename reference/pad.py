"""The pad: how low it may come, how fast it descends, and where it is a step later (Section 4).

What it does to particles is `collisions.py`, or in LAMMPS the fix of `cmpcheck/fixes`.
"""

from __future__ import annotations

from reference.compiled import formula


@formula
def lowest_pad_height(model, highest, largest):
    """The least height of the pad above the base plane, in m: H_min, or a particle on the highest node.

    Paper: Section 4.  `highest` node and `largest` diameter in m; max(z_max + d_max/2, H_min).
    """
    return max(highest + 0.5 * largest, model.pad_minimum)


@formula
def pad_velocity(model, pad_height, lowest):
    """The speed V_z at which the pad descends, in m/s; zero where it may come no lower."""
    return model.pad_descent if pad_height > lowest else 0.0


@formula
def lowered_pad(model, pad_height, lowest, time_step):
    """Height of the pad after a step, in m: it never rises, and never descends faster than V_z."""
    return min(pad_height, max(pad_height - model.pad_descent * time_step, lowest))
