"""Ends of things in a scan, and how well those of several scans come together at a speed."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import EMPTY, Index, cube_of, slot_of

JUMP_M, JUMP_SHARE = 0.4, 0.02
"""A beam's neighbour that reaches so much farther has missed the thing that the beam met."""
UPRIGHT = 2
"""Columns by which an upright end may be off in the beam above or below."""
STEPS, REACH = 6, 3.0
"""Of Gauss and Newton; standard deviations beyond which a pair does not count."""


@compiled()
def reaches(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, rings: int, columns: int
) -> np.ndarray:
    """Return (rings, columns) float32, how far each beam went, metres; 0 where nothing came."""
    reach = np.zeros((rings, columns), np.float32)
    for n in range(len(points)):
        x, y, z = points[n]
        reach[ring[n], column[n]] = np.sqrt(x * x + y * y + z * z)
    return reach


@compiled()
def ends(reach: np.ndarray, ring: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return (N,) bool, at which returns a thing ends to the left or the right.

    The wall of a tunnel and the ground have no ends: there, returns stand where the beams point,
    not where something is.
    """
    rings, columns = reach.shape
    edges = np.zeros((rings, columns), np.bool_)
    for r in range(rings):
        for c in range(columns):
            here = reach[r, c]
            if not 0.0 < here < np.inf:
                continue
            least = here * (1.0 + JUMP_SHARE) + JUMP_M
            for side in (-1, 1):
                near = False
                for d in range(1, 3):
                    there = reach[r, (c + side * d) % columns]
                    near |= 0.0 < there < least
                edges[r, c] |= not near
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        r, c = ring[n], column[n]
        marks[n] = edges[r, c] and (
            _upright(edges, reach, r, c, -1) or _upright(edges, reach, r, c, 1)
        )
    return marks


@compiled()
def slim(
    reach: np.ndarray, ring: np.ndarray, column: np.ndarray, asked: np.ndarray, widest_m: float
) -> np.ndarray:
    """Return (N,) bool, where the middle of a slim thing is, of (N,) bool returns asked for.

    It is no wider than so many metres and stands free: on either side beams go farther. What
    hides a part of a thing does not make it slim.
    """
    columns = reach.shape[1]
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        here = reach[ring[n], column[n]]
        if not asked[n] or not 0.0 < here < np.inf:
            continue
        most = max(int(widest_m / here * columns / (2.0 * np.pi)), 1)
        left = _columns_to_the_side(reach, ring[n], column[n], -1, most)
        right = _columns_to_the_side(reach, ring[n], column[n], 1, most)
        marks[n] = right >= 0 and 0 <= left - right <= 1 and left + right < most
    return marks


@compiled()
def _columns_to_the_side(reach: np.ndarray, r: Index, c: Index, side: int, most: int) -> int:
    """Return how many more columns to one side meet the same thing; -1 if it does not end there.

    It ends where two beams in a row go farther: one may have got no answer.
    """
    columns, here = reach.shape[1], reach[r, c]
    margin = here * JUMP_SHARE + JUMP_M
    same, missed = 0, 0
    for d in range(1, most + 3):
        there = reach[r, (c + side * d) % columns]
        if 0.0 < there < here - margin:
            return -1
        if 0.0 < there < here + margin:
            same, missed = d, 0
            continue
        missed += 1
        if missed == 2:
            return same
    return -1


@compiled()
def _upright(edges: np.ndarray, reach: np.ndarray, r: Index, c: Index, up: int) -> bool:
    """Say whether the beam above or below ends at the same thing in nearly the same direction.

    Where beams leave a wall over its top, they do so one after the other, at places that travel
    with the sensor.
    """
    if not 0 <= r + up < reach.shape[0]:
        return False
    here = reach[r, c]
    for d in range(-UPRIGHT, UPRIGHT + 1):
        k = (c + d) % reach.shape[1]
        if edges[r + up, k] and abs(reach[r + up, k] - here) < JUMP_M + JUMP_SHARE * here:
            return True
    return False


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
    keys, met = np.empty(slots, np.int64), np.empty(slots, np.int64)
    for s in range(len(speeds)):
        keys[:] = EMPTY
        met[:] = 0
        for n in range(len(points)):
            x, y = points[n, 0] + speeds[s] * ahead[n, 0], points[n, 1] + speeds[s] * ahead[n, 1]
            key = cube_of(x, y, 0.0, cell_m)
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
