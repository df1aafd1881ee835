"""Which clusters of two scans are the same, and which of them move (Zhang 2022, eq. 4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled

ALONE = -1
"""In place of a partner."""


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
    apart = np.linalg.norm(moved[:, None] - before[None], axis=2)
    partners = one_to_one(apart)
    away = np.full(len(now), np.inf)
    met = partners != ALONE
    away[met] = np.linalg.norm((moved[met] - before[partners[met]])[:, :2], axis=1)
    return ClusterMatch(partners, away, away > thresholds_m)


@compiled()
def one_to_one(apart: np.ndarray) -> np.ndarray:
    """Return for each row of (K, L) distances the column it is matched with, (K,) int64; or -1."""
    rows, columns = apart.shape
    partners, taken = np.full(rows, ALONE), np.zeros(columns, np.bool_)
    for place in np.argsort(apart.ravel(), kind="mergesort"):
        row, column = place // columns, place % columns
        if partners[row] == ALONE and not taken[column]:
            partners[row] = column
            taken[column] = True
    return partners
