"""Velocities of a trajectory that has none, by differences of its positions, and bounds on their errors."""

from __future__ import annotations

import numpy as np


def by_differences(
    times: np.ndarray, positions: np.ndarray, resolution: float, free: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (T, N, 3) in m/s, and bounds on their errors.

    Between the ends: central differences, whose error is taken to be their distance from those over twice the
    interval (of a smooth path they are off by a third of it).  At an end, where particles fly freely, the
    longest straight line from it: straight as long as the slopes to all points agree within the digits, of
    which the longest says most.  Where forces act, a parabola through three points, and as its error the
    distance from the slope of the first two.

    Parameters: times (T,), s; positions (T, N, 3), m, unwrapped; resolution, half a unit in their last place,
    m; free, whether nothing but contacts acts on the particles.
    """
    count = len(times)
    velocities, errors = np.empty_like(positions), np.full_like(positions, np.inf)
    end = _line if free else _parabola
    velocities[0], errors[0] = end(times, positions, resolution)
    velocities[-1], errors[-1] = end(times[::-1], positions[::-1], resolution)
    if count > 2:
        velocities[1:-1] = np.gradient(positions, times, axis=0)[1:-1]
        slopes = np.diff(positions, axis=0) / np.diff(times)[:, np.newaxis, np.newaxis]
        errors[1:-1] = np.abs(np.diff(slopes, axis=0))  # next to the ends there is no wider difference
        if count > 4:
            wide = (positions[4:] - positions[:-4]) / (times[4:] - times[:-4])[:, np.newaxis, np.newaxis]
            errors[2:-2] = np.abs(velocities[2:-2] - wide)
        errors[1:-1] += (2.0 * resolution / (times[2:] - times[:-2]))[:, np.newaxis, np.newaxis]
    return velocities, errors


def _line(times: np.ndarray, positions: np.ndarray, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """Slope (N, 3) of the longest straight line from the first point, and what the digits leave open."""
    spans = np.abs(times[1:] - times[0])
    slopes = (positions[1:] - positions[0]) / (times[1:] - times[0])[:, np.newaxis, np.newaxis]
    open_by = np.broadcast_to((2.0 * resolution / spans)[:, np.newaxis, np.newaxis], slopes.shape)
    low = np.maximum.accumulate(slopes - open_by, axis=0)
    high = np.minimum.accumulate(slopes + open_by, axis=0)
    last = np.argmin(low <= high, axis=0) - 1  # the last straight one; -1, the very last, where all are
    last = np.where((low <= high).all(axis=0), len(spans) - 1, last)[np.newaxis]
    found = np.take_along_axis(slopes, last, axis=0)[0], np.take_along_axis(open_by, last, axis=0)[0]
    if len(spans) < 2:
        return found
    alone = last[0] == 0  # two points make a line of anything
    bend = np.abs((slopes[1] - slopes[0]) * spans[0] / (spans[1] - spans[0]))
    return found[0], found[1] + np.where(alone, bend, 0.0)


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
