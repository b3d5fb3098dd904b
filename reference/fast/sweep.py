"""Drag, motion and pad of all particles, as loops without branches that become vector instructions.

Paper: Eqs. (37)-(39) with Stokes's drag, which is linear and needs no iteration: with the velocity
s = v + J/m after the step's contacts, v' = s + dt k (u - s)/(m + dt k).  Particles whose drag is not
Stokes's, or that gain mass, are solved by `schemes.solve_particle` afterwards.

Positions along x and y are not wrapped here, but when pairs are listed (`near.settle`).
"""

from __future__ import annotations

import numba

from reference.compiled import inner, part
from reference.state import FLOW_COUETTE

# nothing is infinite, and the sign of a zero does not matter: then the highest of numbers is a vector
# instruction, and still the same in whatever order they are compared
comparing = numba.njit(error_model="numpy", nogil=True, fastmath={"nsz", "nnan"}, no_cfunc_wrapper=True)


@comparing
def highest_of(values):
    """The highest of numbers of which none is negative."""
    highest = 0.0
    for i in range(values.size):
        highest = values[i] if values[i] > highest else highest
    return highest


@inner
def fast_on_pad(z, vz, radius, pad_height, descent, speed):
    """How many particles meet the pad at `speed` (m/s) or faster."""
    found = 0
    for i in range(z.size):
        approach = vz[i] + descent
        found += 1 if (z[i] + radius[i] > pad_height) & (approach > 0.0) & (approach >= speed) else 0
    return found


@part
def glide_under_pad(z, vz, under_pad, contacts, yielding, flow, dt, pad_height, descent, restitution):
    """Velocity and position along z after a step under the pad; `contacts` counts who meets it.

    J = (1 + e_pad) m (v_z + V_z) downwards makes v_z to -e_pad v_z - (1 + e_pad) V_z: see `collide_pad`.
    Particles that other contacts have changed already are left out by `under_pad`, which else is the radius.
    """
    leaving = -(1.0 + restitution) * descent
    for i in range(z.size):
        v = vz[i]
        meets = (z[i] + under_pad[i] > pad_height) & (v + descent > 0.0)
        v = leaving - restitution * v if meets else v
        contacts[i] += 1.0 if meets else 0.0
        v += yielding[i] * (flow - v)
        vz[i] = v
        z[i] += dt * v


@part
def glide_upright(z, vz, yielding, flow, dt):
    """Velocity and position along z after a step without a pad, not wrapped."""
    for i in range(z.size):
        v = vz[i] + yielding[i] * (flow - vz[i])
        vz[i] = v
        z[i] += dt * v


@part
def glide_sheared(x, vx, z, yielding, shear, dt):
    """Velocity and position along x after a step, in a flow u = `shear` z at the new height."""
    for i in range(x.size):
        v = vx[i] + yielding[i] * (shear * z[i] - vx[i])
        vx[i] = v
        x[i] += dt * v


@part
def glide_along(x, vx, yielding, flow, dt):
    """Velocity and position along x or y after a step, in a uniform flow."""
    for i in range(x.size):
        v = vx[i] + yielding[i] * (flow - vx[i])
        vx[i] = v
        x[i] += dt * v


@part
def wrap_upright(z, period):
    """Positions along z within [0, period), after a step that led at most one period out of it."""
    for i in range(z.size):
        q = z[i]
        q = q - period if q >= period else q
        q = q + period if q < 0.0 else q
        z[i] = 0.0 if q >= period else q


@part
def glide(
    model, dt, flow_x, flow_y, flow_z, x, y, z, vx, vy, vz, yielding, under_pad, contacts, shear, pad_height,
    descent,
):  # fmt: skip
    """Drag, pad and motion in one step of dt; `contacts` counts who meets the pad."""
    if model.has_pad:
        glide_under_pad(
            z, vz, under_pad, contacts, yielding, flow_z, dt, pad_height, descent, model.pad_restitution
        )
    else:
        glide_upright(z, vz, yielding, flow_z, dt)
    if model.flow == FLOW_COUETTE:
        glide_sheared(x, vx, z, yielding, shear, dt)
    else:
        glide_along(x, vx, yielding, flow_x, dt)
    glide_along(y, vy, yielding, flow_y, dt)
    if model.length_z > 0.0:
        wrap_upright(z, model.length_z)
