"""Which clusters of two scans are the same, and which of them move (Zhang 2022, eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled

ALONE = -1
"""In place of a partner."""
REACH_M = 5.0
"""Farther off nobody is looked for, as with features: no prediction is so wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class ClusterMatch:
    """The clusters of a scan beside those of the scan before.

    partners: (K,) int64, cluster of the scan before; -1 where there is none.
    moved_m: (K,) float64, how far the centre moved over the ground beside what the own motion
        explains; inf without a partner.
    dynamic: (K,) bool, moved farther than the threshold, or has no partner: walls that only one
        of the scans shows are dropped too, as the paper says.
    """

    partners: np.ndarray
    moved_m: np.ndarray
    dynamic: np.ndarray


def match_clusters(
    now: np.ndarray, before: np.ndarray, before_from_now: np.ndarray,
    thresholds_m: np.ndarray | float,
) -> ClusterMatch:  # fmt: skip
    """Move (K, 3) centres as the own motion says (eq. 4) and match each to the nearest of before.

    before: (L, 3). thresholds_m: (K,) or one for all. One to one: of all pairs the nearest is taken
    first, then the nearest of what is left, and so on: our reading of the paper's nearest
    neighbour iteration. How far a centre moved is counted over the ground, x and y: its height
    changes by half the gap between two beams as soon as one of them passes over the thing.
    """
    moved = now @ before_from_now[:3, :3].T + before_from_now[:3, 3]
    partners = one_to_one(moved, before, REACH_M)
    away = np.full(len(now), np.inf)
    met = partners != ALONE
    away[met] = np.linalg.norm((moved[met] - before[partners[met]])[:, :2], axis=1)
    return ClusterMatch(partners, away, away > thresholds_m)


@compiled()
def one_to_one(now: np.ndarray, before: np.ndarray, reach_m: float) -> np.ndarray:
    """Return for each of (K, 3) places the one of (L, 3) it is matched with, (K,) int64; or -1.

    Two that are nearest to each other among all that is left are the nearest pair that either is
    in: so the nearest pairs first, without sorting them; of equal ones the first.
    """
    partners, sought = np.full(len(now), ALONE), np.ones(len(now), np.bool_)
    taken, found = np.zeros(len(before), np.bool_), True
    theirs, ours = np.empty(len(now), np.int64), np.empty(len(before), np.int64)
    while found:
        theirs[:], ours[:], found = ALONE, ALONE, False
        _nearest((now, before, reach_m * reach_m), (sought, taken), (theirs, ours))
        for k in range(len(now)):
            sought[k] = sought[k] and theirs[k] != ALONE
            if sought[k] and ours[theirs[k]] == k:
                partners[k], taken[theirs[k]], sought[k], found = theirs[k], True, False, True
    return partners


@compiled()
def _nearest(
    places: tuple[np.ndarray, np.ndarray, float], left: tuple[np.ndarray, np.ndarray],
    nearest: tuple[np.ndarray, np.ndarray],
) -> None:  # fmt: skip
    """Write who is nearest to each of both, within the square root of the last of places."""
    (now, before, most), (sought, taken), (theirs, ours) = places, left, nearest
    least = np.full(len(before), most)
    for k in range(len(now)):
        if not sought[k]:
            continue
        shortest = most
        for j in range(len(before)):
            square = 0.0
            for i in range(3):
                square += (now[k, i] - before[j, i]) ** 2
            if taken[j] or not square <= most:
                continue
            if square < shortest or theirs[k] == ALONE:
                shortest, theirs[k] = square, j
            if square < least[j] or ours[j] == ALONE:
                least[j], ours[j] = square, k
