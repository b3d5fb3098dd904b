"""Velocities of a trajectory that has none, by differences of its positions, and bounds on their errors."""

from __future__ import annotations

import numpy as np


def by_differences(
    times: np.ndarray, positions: np.ndarray, resolution: float, calm: tuple[float, float] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (T, N, 3) in m/s, and bounds on their errors.

    Between the ends: central differences, whose error is taken to be their distance from those over twice the
    interval (of a smooth path they are off by a third of it).  At an end that belongs to a free flight, the
    longest line within it: the digits leave least open there.  At another end, a parabola through three
    points, and as its error the distance from the slope of the first two.

    Parameters: times (T,), s; positions (T, N, 3), m, unwrapped; resolution, half a unit in their last place,
    m; calm, until when and from when on particles fly freely, s; None where that is not known.
    """
    count = len(times)
    velocities, errors = np.empty_like(positions), np.full_like(positions, np.inf)
    until, after = (
        (0, count) if calm is None else (int((times < calm[0]).sum()), int((times <= calm[1]).sum()))
    )
    velocities[0], errors[0] = _end(times, positions, resolution, until)
    velocities[-1], errors[-1] = _end(times[::-1], positions[::-1], resolution, count - after)
    if count > 2:
        velocities[1:-1] = np.gradient(positions, times, axis=0)[1:-1]
        slopes = np.diff(positions, axis=0) / np.diff(times)[:, np.newaxis, np.newaxis]
        errors[1:-1] = np.abs(np.diff(slopes, axis=0))  # next to the ends there is no wider difference
        if count > 4:
            wide = (positions[4:] - positions[:-4]) / (times[4:] - times[:-4])[:, np.newaxis, np.newaxis]
            errors[2:-2] = np.abs(velocities[2:-2] - wide)
        errors[1:-1] += (2.0 * resolution / (times[2:] - times[:-2]))[:, np.newaxis, np.newaxis]
    return velocities, errors


def _end(
    times: np.ndarray, positions: np.ndarray, resolution: float, free: int
) -> tuple[np.ndarray, np.ndarray]:
    """Slope (N, 3) at the first point, of which the first `free` should be on a line, and its error.

    Where they are not, by more than the digits, the distance from the line of the farthest counts as error.
    """
    if free < 2:
        return _parabola(times, positions, resolution)
    span = times[free - 1] - times[0]
    slope = (positions[free - 1] - positions[0]) / span
    line = positions[0] + slope * (times[:free] - times[0])[:, np.newaxis, np.newaxis]
    apart = np.abs(positions[:free] - line).max(axis=0)
    bent = np.maximum(apart - 2.0 * resolution, 0.0) / abs(times[1] - times[0])
    return slope, 2.0 * resolution / abs(span) + bent


def _parabola(times: np.ndarray, positions: np.ndarray, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """Slope (N, 3) at the first point of a parabola through three, and a bound on its error."""
    first = times[1] - times[0]
    slope = (positions[1] - positions[0]) / first
    digits = 2.0 * resolution / abs(first)
    if len(times) < 3:
        return slope, np.full_like(slope, np.inf)
    second = (positions[2] - positions[1]) / (times[2] - times[1])
    bend = (slope - second) * first / (times[2] - times[0])
    return slope + bend, np.abs(bend) + 3.0 * digits
