"""Contacts with the pad, drag and motion of all particles, as loops without branches: vector instructions.

Paper: Eqs. (37)-(39) with Stokes's drag, which is linear and needs no iteration: with the velocity
w = v + J/m after the step's contacts, v' = w + dt k (u - w)/(m + dt k).  Particles whose drag is not
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
def depart(
    z, vx, vy, vz, wx, wy, wz, jx, jy, jz, per_mass, radius, contacts, x_low, x_high, y_low, y_high, z_low,
    z_high, outside, pad_height, descent, restitution,
):  # fmt: skip
    """Velocities w after the contacts of a step, those with the pad too; return how many leave their boxes.

    J = (1 + e_pad) m (v_z + V_z) downwards makes v_z to -e_pad v_z - (1 + e_pad) V_z: see `collide_pad`.
    `contacts` counts who meets it, `outside` is 1 for those that leave.
    """
    leaving, left = -(1.0 + restitution) * descent, 0
    for i in range(z.size):
        v, per = vz[i], per_mass[i]
        meets = (z[i] + radius[i] > pad_height) & (v + descent > 0.0)
        v = leaving - restitution * v if meets else v
        contacts[i] += 1.0 if meets else 0.0
        x, y, v = vx[i] + jx[i] * per, vy[i] + jy[i] * per, v + jz[i] * per
        wx[i], wy[i], wz[i] = x, y, v
        inside = (x_low[i] <= x) & (x <= x_high[i]) & (y_low[i] <= y) & (y <= y_high[i])
        inside = inside & (z_low[i] <= v) & (v <= z_high[i])
        outside[i] = 0.0 if inside else 1.0
        left += 0 if inside else 1
    return left


@part
def glide_sheared(x, v, w, j, z, yielding, shear, dt):
    """Velocity and position along x after a step, in a flow u = `shear` z at the new height; no impulse."""
    for i in range(x.size):
        s = w[i] + yielding[i] * (shear * z[i] - w[i])
        v[i] = s
        x[i] += dt * s
        j[i] = 0.0


@part
def glide_along(x, v, w, j, yielding, flow, dt):
    """Velocity and position along an axis after a step, in a uniform flow; no impulse any more."""
    for i in range(x.size):
        s = w[i] + yielding[i] * (flow - w[i])
        v[i] = s
        x[i] += dt * s
        j[i] = 0.0


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
    model, dt, flow_x, flow_y, flow_z, x, y, z, vx, vy, vz, wx, wy, wz, jx, jy, jz, yielding, shear
):  # fmt: skip
    """Drag and motion in one step of dt; impulses are 0 afterwards."""
    glide_along(z, vz, wz, jz, yielding, flow_z, dt)
    if model.flow == FLOW_COUETTE:
        glide_sheared(x, vx, wx, jx, z, yielding, shear, dt)
    else:
        glide_along(x, vx, wx, jx, yielding, flow_x, dt)
    glide_along(y, vy, wy, jy, yielding, flow_y, dt)
    if model.length_z > 0.0:
        wrap_upright(z, model.length_z)
