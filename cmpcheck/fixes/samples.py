"""All particles of one step by tag, in SI, and the trajectory made of them (compiled)."""

from __future__ import annotations

from cmpcheck.fixes.layout import (
    FIX_FORCE,
    FORCE,
    LAG,
    MASS,
    MICRO,
    NANO,
    PAIR_FORCE,
    PICOGRAM,
    POSITION,
    RADIUS,
    TRAJECTORY_FULL,
    VELOCITY,
)
from reference.compiled import kernel
from reference.timestep import wrap


@kernel
def is_sampled(c, step):
    """Whether the trajectory has a sample at this step."""
    return c.sample_every > 0 and step % c.sample_every == 0


@kernel
def collect_by_tag(c, tags, x, v, f, radius, mass, given, by_tag):
    """Write the rank's atoms into `by_tag` (N, BY_TAG_COLUMNS); rows of other ranks' atoms become zero."""
    for i in range(by_tag.shape[0]):
        for column in range(by_tag.shape[1]):
            by_tag[i, column] = 0.0
    model = c.model
    for i in range(tags.size):
        p = by_tag[tags[i] - 1]
        p[POSITION] = wrap(x[i, 0] * MICRO, model.length_x)
        p[POSITION + 1] = wrap(x[i, 1] * MICRO, model.length_y)
        p[POSITION + 2] = wrap(x[i, 2] * MICRO, model.length_z)
        for axis in range(3):
            p[VELOCITY + axis] = v[i, axis]
            p[PAIR_FORCE + axis] = f[i, axis] * NANO
            p[FIX_FORCE + axis] = given[i, FORCE + axis] * NANO
        p[MASS], p[RADIUS], p[LAG] = mass[i] * PICOGRAM, radius[i] * MICRO, c.lag


@kernel
def store_sample(c, step, by_tag, samples):
    """Append [time; position, velocity, mass of each particle] to `samples`, velocities of full steps."""
    if c.samples == samples.shape[0]:
        c.error, c.error_step, c.error_tag = TRAJECTORY_FULL, step, 1
        return
    out = samples[c.samples]
    out[0] = step * c.time_step
    for i in range(by_tag.shape[0]):
        p, first = by_tag[i], 1 + 7 * i
        for axis in range(3):
            out[first + axis] = p[POSITION + axis]
            force = p[PAIR_FORCE + axis] + p[FIX_FORCE + axis]
            out[first + 3 + axis] = p[VELOCITY + axis] + p[LAG] * force / p[MASS]
        out[first + 6] = p[MASS]
    c.samples += 1
