"""Where things end in a scan, and where slim ones are."""

from __future__ import annotations

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import Index

JUMP_M, JUMP_SHARE = 0.4, 0.02
"""A beam's neighbour that reaches so much farther has missed the thing that the beam met."""
UPRIGHT = 2
"""Columns by which an upright end may be off in the beam above or below."""
WIDEST_GAP = 32
"""Columns from return to return, at most, that may be the sensor's own step."""
SAMPLED = 8
"""Of so many pairs of neighbours the angle of one is asked."""
OUTSIDE = -1.0
"""How far a beam went that is none of the sensor's."""


@compiled()
def nearest(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, rings: int, columns: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return (rings, columns) metres to the nearest return of each beam, 0 without, and its number.

    The number is int64, -1 without.
    """
    reach, number = np.zeros((rings, columns)), np.full((rings, columns), -1, np.int64)
    for n in range(len(points)):
        x, y, z = points[n]
        here, r, c = np.sqrt(x * x + y * y + z * z), ring[n], column[n]
        if here > 0.0 and (number[r, c] < 0 or here < reach[r, c]):
            reach[r, c], number[r, c] = here, n
    return reach, number


@compiled()
def spacing(points: np.ndarray, number: np.ndarray) -> tuple[int, float]:
    """Return columns from beam to beam, and radians from column to column; 0 of both if unknown.

    Columns may be finer than the sensor's own steps: then many are empty.
    """
    counts, asked = np.zeros(WIDEST_GAP + 1, np.int64), np.zeros(WIDEST_GAP + 1, np.int64)
    angles = np.zeros(WIDEST_GAP + 1)
    for r in range(number.shape[0]):
        last = -1
        for c in range(number.shape[1]):
            if number[r, c] < 0:
                continue
            gap = c - last
            if last >= 0 and gap <= WIDEST_GAP:
                if counts[gap] % SAMPLED == 0:
                    one, other = points[number[r, last]], points[number[r, c]]
                    cross = one[0] * other[1] - one[1] * other[0]
                    angles[gap] += abs(np.arctan2(cross, one[0] * other[0] + one[1] * other[1]))
                    asked[gap] += 1
                counts[gap] += 1
            last = c
    half, gap = counts.sum() / 2, 0
    while gap < WIDEST_GAP and counts[: gap + 1].sum() < max(half, 1):
        gap += 1
    return (gap, angles[gap] / (asked[gap] * gap)) if asked[gap] else (0, 0.0)


@compiled()
def _beside(reach: np.ndarray, r: Index, c: Index, closed: bool) -> float:
    """Return how far a beam went whose column may be beyond the first or the last."""
    columns = reach.shape[1]
    if not closed and not 0 <= c < columns:
        return OUTSIDE
    far: float = reach[r, c % columns]
    return far


@compiled()
def ends(reach: np.ndarray, ring: np.ndarray, column: np.ndarray, closed: bool) -> np.ndarray:
    """Return (N,) bool, at which returns a thing ends to the left or the right.

    closed: whether the last column is beside the first. The wall of a tunnel and the ground have
    no ends: there, returns stand where the beams point, not where something is.
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
                    there = _beside(reach, r, c + side * d, closed)
                    near |= there == OUTSIDE or 0.0 < there < least
                edges[r, c] |= not near
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        r, c = ring[n], column[n]
        marks[n] = edges[r, c] and (
            _upright(edges, reach, r, c, -1) or _upright(edges, reach, r, c, 1)
        )
    return marks


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
def slim(
    reach: np.ndarray, ring: np.ndarray, column: np.ndarray, asked: np.ndarray, closed: bool,
    widest_columns: float,
) -> np.ndarray:  # fmt: skip
    """Return (N,) bool, where the middle of a slim thing is, of (N,) bool returns asked for.

    It is no wider than so many columns at a metre and stands free: on either side beams go
    farther. What hides a part of a thing does not make it slim, nor does the edge of the field.
    """
    marks = np.zeros(len(ring), np.bool_)
    for n in range(len(ring)):
        here = reach[ring[n], column[n]]
        if not asked[n] or not 0.0 < here < np.inf:
            continue
        most = max(int(widest_columns / here), 1)
        left = _columns_to_the_side(reach, ring[n], column[n], (-1, most), closed)
        right = _columns_to_the_side(reach, ring[n], column[n], (1, most), closed)
        marks[n] = right >= 0 and 0 <= left - right <= 1 and left + right < most
    return marks


@compiled()
def _columns_to_the_side(
    reach: np.ndarray, r: Index, c: Index, way: tuple[int, int], closed: bool
) -> int:
    """Return how many more columns to one side meet the same thing; -1 if it does not end there.

    way: to which side, and how many at most. It ends where two beams in a row go farther: one may
    have got no answer.
    """
    side, most = way
    here = reach[r, c]
    margin = here * JUMP_SHARE + JUMP_M
    same, missed = 0, 0
    for d in range(1, most + 3):
        there = _beside(reach, r, c + side * d, closed)
        if there == OUTSIDE or 0.0 < there < here - margin:
            return -1
        if 0.0 < there < here + margin:
            same, missed = d, 0
            continue
        missed += 1
        if missed == 2:
            return same
    return -1
