"""Drag, motion and pad of all particles, as loops without branches that become vector instructions.

Paper: Eqs. (37)-(39) with Stokes's drag, which is linear and needs no iteration: with the velocity
s = v + J/m after the step's contacts, v' = s + dt k (u - s)/(m + dt k).  Particles whose drag is not
Stokes's, or that gain mass, are solved by `schemes.solve_particle` afterwards.
"""

from __future__ import annotations

import numba

from reference.compiled import inlined
from reference.state import FLOW_COUETTE

# sums may be taken in any order, and nothing is infinite; selections then become vector instructions
vectorised = numba.njit(error_model="numpy", nogil=True, fastmath={"reassoc", "nsz", "nnan"})


@vectorised
def highest_of(values):
    """The highest of numbers of which none is negative."""
    highest = 0.0
    for i in range(values.size):
        highest = values[i] if values[i] > highest else highest
    return highest


@vectorised
def fast_on_pad(z, vz, radius, pad_height, descent, speed):
    """How many particles meet the pad at `speed` (m/s) or faster."""
    found = 0.0
    for i in range(z.size):
        approach = vz[i] + descent
        found += 1.0 if (z[i] + radius[i] > pad_height) & (approach > 0.0) & (approach >= speed) else 0.0
    return found


@vectorised
def glide_under_pad(z, vz, under_pad, yielding, flow, dt, pad_height, descent, restitution):
    """Velocity and position along z after a step under the pad; return how many particles meet the pad.

    J = (1 + e_pad) m (v_z + V_z) downwards makes v_z to -e_pad v_z - (1 + e_pad) V_z: see `collide_pad`.
    Particles that other contacts have changed already are left out by `under_pad`, which else is the radius.
    """
    hits, leaving = 0.0, -(1.0 + restitution) * descent
    for i in range(z.size):
        v = vz[i]
        meets = (z[i] + under_pad[i] > pad_height) & (v + descent > 0.0)
        v = leaving - restitution * v if meets else v
        hits += 1.0 if meets else 0.0
        v += yielding[i] * (flow - v)
        vz[i] = v
        z[i] += dt * v
    return hits


@vectorised
def glide_upright(z, vz, yielding, flow, dt):
    """Velocity and position along z after a step without a pad, not wrapped."""
    for i in range(z.size):
        v = vz[i] + yielding[i] * (flow - vz[i])
        vz[i] = v
        z[i] += dt * v


@vectorised
def glide_sheared(x, vx, z, yielding, shear, dt, period):
    """Velocity and position along x after a step, in a flow u = `shear` z at the new height."""
    for i in range(x.size):
        v = vx[i] + yielding[i] * (shear * z[i] - vx[i])
        vx[i] = v
        q = x[i] + dt * v
        q = q - period if q >= period else q
        q = q + period if q < 0.0 else q
        x[i] = 0.0 if q >= period else q


@vectorised
def glide_along(x, vx, yielding, flow, dt, period):
    """Velocity and position along x or y after a step, in a uniform flow."""
    for i in range(x.size):
        v = vx[i] + yielding[i] * (flow - vx[i])
        vx[i] = v
        q = x[i] + dt * v
        q = q - period if q >= period else q
        q = q + period if q < 0.0 else q
        x[i] = 0.0 if q >= period else q


@vectorised
def wrap_upright(z, period):
    """Positions along z within [0, period), after a step that led at most one period out of it."""
    for i in range(z.size):
        q = z[i]
        q = q - period if q >= period else q
        q = q + period if q < 0.0 else q
        z[i] = 0.0 if q >= period else q


@vectorised
def accelerate(ax, ay, az, rate, z, vx, vy, vz, flow_x, flow_y, flow_z, shear):
    """External force over mass, k (u - v)/m with Stokes's k, m/s2; `rate` is k/m, 1/s."""
    for i in range(z.size):
        ax[i] = rate[i] * (flow_x + shear * z[i] - vx[i])
        ay[i] = rate[i] * (flow_y - vy[i])
        az[i] = rate[i] * (flow_z - vz[i])


@inlined
def glide(model, fixed, x, y, z, vx, vy, vz, yielding, under_pad, shear, pad_height, descent):
    """Drag, pad and motion in one step; return how many meet the pad."""
    dt, hits = fixed.dt, 0
    if model.has_pad:
        hits = int(
            glide_under_pad(
                z, vz, under_pad, yielding, fixed.flow_z, dt, pad_height, descent, model.pad_restitution
            )
        )
    else:
        glide_upright(z, vz, yielding, fixed.flow_z, dt)
    if model.flow == FLOW_COUETTE:
        glide_sheared(x, vx, z, yielding, shear, dt, model.length_x)
    else:
        glide_along(x, vx, yielding, fixed.flow_x, dt, model.length_x)
    glide_along(y, vy, yielding, fixed.flow_y, dt, model.length_y)
    if model.length_z > 0.0:
        wrap_upright(z, model.length_z)
    return hits
