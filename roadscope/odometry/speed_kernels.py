"""Ends of things in a scan, and how well those of several scans come together at a speed."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.voxel_kernels import EMPTY, slot_of

JUMP_M, JUMP_SHARE = 0.4, 0.02
"""A beam's neighbour that reaches so much farther has missed the thing that the beam met."""
HALF = 1 << 19


@compiled()
def ends(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, rings: int, columns: int
) -> np.ndarray:
    """Return (N,) bool, at which returns a thing ends to the left or the right.

    The wall of a tunnel and the ground have no ends: there, returns stand where the beams point,
    not where something is.
    """
    reach = np.zeros((rings, columns), np.float32)
    for n in range(len(points)):
        x, y, z = points[n]
        reach[ring[n], column[n]] = np.sqrt(x * x + y * y + z * z)
    marks = np.zeros(len(points), np.bool_)
    for n in range(len(points)):
        here = reach[ring[n], column[n]]
        if not 0.0 < here < np.inf:
            continue
        least = here * (1.0 + JUMP_SHARE) + JUMP_M
        for side in (-1, 1):
            far = True
            for d in range(1, 3):
                there = reach[ring[n], (column[n] + side * d) % columns]
                if 0.0 < there < least:
                    far = False
            if far:
                marks[n] = True
    return marks


@compiled()
def gathered(
    points: np.ndarray, times_s: np.ndarray, scans: np.ndarray, rate: float, speeds: np.ndarray,
    cell_m: float,
) -> np.ndarray:  # fmt: skip
    """Return (V,) how often different scans meet in one cell of the ground plane, at each speed.

    points: (N, 2) as measured. times_s: (N,) since the first scan. scans: (N,) which of the scans,
    fewer than 32. rate: rad/s about the vertical. speeds: (V,) m/s ahead.
    """
    slots = 1024
    while slots < 2 * len(points):
        slots *= 2
    scores = np.zeros(len(speeds))
    keys, met = np.empty(slots, np.int64), np.empty(slots, np.int64)
    for s in range(len(speeds)):
        keys[:] = EMPTY
        met[:] = 0
        for n in range(len(points)):
            angle, way = rate * times_s[n], speeds[s] * times_s[n]
            cosine, sine = np.cos(angle), np.sin(angle)
            x = cosine * points[n, 0] - sine * points[n, 1] + way * np.cos(0.5 * angle)
            y = sine * points[n, 0] + cosine * points[n, 1] + way * np.sin(0.5 * angle)
            key = (np.int64(np.floor(x / cell_m)) + HALF) << 20 | (
                np.int64(np.floor(y / cell_m)) + HALF
            )
            slot = slot_of(keys, key)
            keys[slot] = key
            met[slot] |= 1 << scans[n]
        for slot in range(slots):
            bits, count = met[slot], 0
            while bits:
                bits &= bits - 1
                count += 1
            scores[s] += count * (count - 1) // 2
    return scores
