"""Level rays to the outline of a cluster and past its ends: compiled."""

from __future__ import annotations

import math

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import EMPTY, HIT, PASSED, Rays

MOST = 32
"""Outline points looked at."""
BESIDE = 3
"""Columns looked at beyond either end of the outline."""
NOISE_M = (0.02, 0.15)
"""Least and greatest noise of an outline that is believed."""

Around = tuple[np.ndarray, np.ndarray, float, tuple[float, float]]
"""Azimuths, ranges and step of a `Horizon`, and its view; infinite for a full turn."""


@compiled()
def outline_rays(outline: np.ndarray, origin: np.ndarray, around: Around) -> Rays:
    """Return the level rays to an outline (M, 2), metres, and those that pass beside it.

    origin: (2,) metres, the sensor. A ray that meets something nearer says nothing, for its reach
    ends there.
    """
    every = -(-len(outline) // MOST)
    seen = -(-len(outline) // every)
    azimuths, reach = np.empty(seen + 2 * BESIDE), np.empty(seen + 2 * BESIDE)
    kinds = np.full(seen + 2 * BESIDE, HIT)
    for i in range(seen):
        x, y = outline[i * every, 0] - origin[0], outline[i * every, 1] - origin[1]
        azimuths[i], reach[i] = math.atan2(y, x), math.hypot(x, y)
    noise, count = _noise(reach[:seen]), seen
    for side in range(2):
        end = outline[-side]
        azimuth = math.atan2(end[1] - origin[1], end[0] - origin[0])
        for k in range(1, BESIDE + 1):
            beside = azimuth + (2 * side - 1) * k * around[2]
            if _in_view(beside, around[3]):
                azimuths[count], reach[count] = beside, _met(beside, around)
                kinds[count] = PASSED if reach[count] < np.inf else EMPTY
                count += 1
    rays = Rays(
        np.empty((count, 3)), np.empty((count, 2)), np.zeros(count), reach[:count], kinds[:count],
        np.full(count, noise), np.zeros(count), np.zeros(count),
    )  # fmt: skip
    for i in range(count):
        rays.origin[i] = origin[0], origin[1], 1.0
        rays.direction[i] = math.cos(azimuths[i]), math.sin(azimuths[i])
    return rays


@compiled()
def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


@compiled()
def _in_view(azimuth: float, view: tuple[float, float]) -> bool:
    """Whether a direction lies between the right and the left end of the field of view."""
    right, left = view
    if not np.isfinite(right):
        return True
    return bool(_wrapped(azimuth - right) <= _wrapped(left - right))


@compiled()
def _met(azimuth: float, around: Around) -> float:
    """Range of the nearest return in the column of a direction, inf without one."""
    azimuths, ranges, step, _ = around
    nearest, least = -1, np.inf
    for i in range(len(azimuths)):
        off = abs(azimuths[i] - azimuth)
        # Divisions are slow, and most columns are far away either way around.
        if min(off, 2 * np.pi - off) > 3 * step:
            continue
        off = abs(_wrapped(azimuths[i] - azimuth))
        if off < least:
            nearest, least = i, off
    return float(ranges[nearest]) if least < 0.6 * step else np.inf


@compiled()
def _noise(reach: np.ndarray) -> float:
    """Estimate the noise of ranges in order, from how far each is from its neighbours' mean."""
    if len(reach) < 3:
        return NOISE_M[1]
    bends = np.abs(reach[1:-1] - (reach[:-2] + reach[2:]) / 2)
    return float(min(max(np.median(bends) / 0.6745 / np.sqrt(1.5), NOISE_M[0]), NOISE_M[1]))
