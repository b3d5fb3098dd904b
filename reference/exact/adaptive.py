"""The paper's adaptive step on Stokes drag, where each iterate and its error are known in closed form.

With q = dt/tau the iterates of implicit Euler are partial sums of a geometric series, so that the number of
iterations, the steps that are taken and those that are rejected follow by counting alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class AdaptiveRun(NamedTuple):
    """What the adaptive scheme does on the way to the last time."""

    accepted: int  # steps
    rejected: int
    velocity: np.ndarray  # (3,), m/s, at the end


def iterate(velocity: np.ndarray, flow: np.ndarray, q: float, k: int) -> np.ndarray:
    """Velocity of the k-th iterate, from v^0 = v of the start: v + (u - v) (q - q^2 + ... +- q^k).

    >>> iterate(np.array([1.0]), np.array([3.0]), 0.5, 2).tolist()
    [1.5]
    """
    return velocity + (flow - velocity) * q * (1.0 - (-q) ** k) / (1.0 + q)


def adaptive_stokes(
    stops: Sequence[float], velocity: ArrayLike, flow: ArrayLike, tau: float, largest_step: float,
    tolerance: float = 1e-6, iterations: int = 8,
) -> AdaptiveRun:  # fmt: skip
    """Steps of the paper's scheme for one sphere in a uniform flow at Re <= 1, free of contacts.

    Paper: Eqs. (39)-(43), p = 1; the error of iteration k is its change of position over the way from the
    start of the step.  A step within the tolerance is followed by one Phi times as long, at most twice and at
    most `largest_step`; one that is not converged after `iterations` is repeated with Phi between 0.05 and
    0.9.  A step that is cut to end at one of the `stops` does not lengthen the next.
    Parameters: stops (n,), s, ascending; velocity and flow (3,), m/s; tau and largest_step, s.

    >>> adaptive_stokes([1.0], [1.0, 0, 0], [0, 0, 0], tau=1e3, largest_step=0.25).accepted
    4
    """
    v, u = np.asarray(velocity, float), np.asarray(flow, float)
    now, step, accepted, rejected = 0.0, largest_step, 0, 0
    for stop in stops:
        while stop - now > 1e-9 * largest_step:
            dt = min(step, stop - now)
            q, slip = dt / tau, float(np.linalg.norm(u - v))
            errors: list[float] = []
            while len(errors) < iterations and not (errors and errors[-1] <= tolerance):
                k = len(errors) + 1
                way = float(np.linalg.norm(iterate(v, u, q, k)))
                errors.append(slip * q**k / way)
            k, factor = len(errors), math.inf
            if k > 1:
                contraction = (errors[-1] / errors[0]) ** (1.0 / (k - 1))
                factor = (tolerance / errors[0]) ** (1.0 / (iterations - 1)) / contraction
            if errors[-1] > tolerance:
                rejected += 1
                step = dt * min(max(factor, 0.05), 0.9)
                continue
            if dt == step or factor < 1.0:
                step = min(largest_step, min(factor, 2.0) * dt)
            v, now, accepted = iterate(v, u, q, k), now + dt, accepted + 1
    return AdaptiveRun(accepted, rejected, v)
