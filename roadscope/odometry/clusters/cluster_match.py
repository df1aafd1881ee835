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
    """Return for each of (K, 3) places the one of (L, 3) it is matched with, (K,) int64; or -1."""
    rows, columns, apart = [0], [0], [np.inf]
    for k in range(len(now)):
        for j in range(len(before)):
            square = 0.0
            for i in range(3):
                square += (now[k, i] - before[j, i]) ** 2
            if square <= reach_m * reach_m:
                rows.append(k)
                columns.append(j)
                apart.append(square)
    partners, taken = np.full(len(now), ALONE), np.zeros(len(before), np.bool_)
    # The first of the lists is there for its type alone; it comes last.
    for place in np.argsort(np.array(apart), kind="mergesort")[:-1]:
        row, column = rows[place], columns[place]
        if partners[row] == ALONE and not taken[column]:
            partners[row] = column
            taken[column] = True
    return partners
