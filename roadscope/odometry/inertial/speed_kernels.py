"""How well ends of things, seen in several scans, come together at a speed."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, slot_of

STEPS, REACH = 6, 3.0
"""Of Gauss and Newton; standard deviations beyond which a pair does not count."""


@compiled()
def gathered(
    points: np.ndarray, ahead: np.ndarray, scans: np.ndarray, speeds: np.ndarray, cell_m: float
) -> np.ndarray:
    """Return (V,) how often different scans meet in one cell of the ground plane, at each speed.

    points: (N, 2) metres, turned as the sensor was at first. ahead: (N, 2) s, where they are moved
    by a speed. scans: (N,) which of the scans, fewer than 32. speeds: (V,) m/s ahead.
    """
    slots = 1024
    while slots < 2 * len(points):
        slots *= 2
    scores = np.zeros(len(speeds))
    keys, met = np.full(slots, EMPTY), np.zeros(slots, np.int64)
    cells, taken = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for s in range(len(speeds)):
        for n in range(len(points)):
            x, y = points[n, 0] + speeds[s] * ahead[n, 0], points[n, 1] + speeds[s] * ahead[n, 1]
            i, j = np.int32(np.floor(x / cell_m)), np.int32(np.floor(y / cell_m))
            cells[n] = (1 << 62) + np.int64(i) * (1 << 32) + j
        size = 0
        for n in range(len(points)):
            slot = slot_of(keys, cells[n])
            taken[size] = slot
            size += keys[slot] == EMPTY
            keys[slot] = cells[n]
            met[slot] |= 1 << scans[n]
        pairs = 0
        for k in range(size):
            bits, count = met[taken[k]], 0
            while bits:
                bits &= bits - 1
                count += 1
            pairs += count * (count - 1) // 2
            keys[taken[k]], met[taken[k]] = EMPTY, 0
        scores[s] = pairs
    return scores


@compiled()
def joined(
    points: np.ndarray, ahead: np.ndarray, scans: np.ndarray, speed: float, near_m: float
) -> tuple[float, float]:
    """Return the speed near another at which points of different scans meet best, and its weight.

    As `gathered`, without cells: least squares over all pairs, weighed by Welsch's function of
    how far they are apart. The weight, s^2, is what the pairs that meet say of the speed together;
    0 where none do. near_m: the standard deviation of that function. points: in order of the
    second axis, as they are moved by the speed.
    """
    weight = 0.0
    for _ in range(STEPS):
        weight, vector = 0.0, 0.0
        for i in range(len(points)):
            for j in range(i - 1, -1, -1):
                along, aside = ahead[i, 0] - ahead[j, 0], ahead[i, 1] - ahead[j, 1]
                y = points[i, 1] - points[j, 1] + speed * aside
                if y > 2 * REACH * near_m:
                    break
                x = points[i, 0] - points[j, 0] + speed * along
                if scans[i] == scans[j] or max(abs(x), abs(y)) > REACH * near_m:
                    continue
                share = np.exp(-0.5 * (x * x + y * y) / (near_m * near_m))
                weight += share * (along * along + aside * aside)
                vector += share * (along * x + aside * y)
        if weight <= 0.0:
            return speed, 0.0
        speed -= vector / weight
    return speed, weight


@compiled()
def count_apart(points: np.ndarray, apart_m: float) -> int:
    """Return how many of (N, 2) points are so far apart, one after the other being taken."""
    taken = np.empty((len(points), 2))
    count = 0
    for n in range(len(points)):
        alone = True
        for k in range(count):
            x, y = points[n, 0] - taken[k, 0], points[n, 1] - taken[k, 1]
            alone &= x * x + y * y > apart_m * apart_m
        if alone:
            taken[count] = points[n]
            count += 1
    return count
