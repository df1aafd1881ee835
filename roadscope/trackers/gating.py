"""Which pairs of track and detection are possible at all, and what each would cost."""

from __future__ import annotations

import numpy as np

from roadscope.core import Category, Family
from roadscope.core.box_overlap import box_overlaps_3d, generalised_overlaps_3d
from roadscope.core.jit import compiled

FAMILIES = np.array([list(Family).index(category.family) for category in Category])
"""For each value of `Category` the number of its family."""

OVERLAPS = {"iou": 0.0, "giou": -1.0}
"""Overlaps of boxes, and what each is at the least."""


def same_family(categories: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return (N, M) bool: a car may turn out to be a van, but never a pedestrian."""
    same: np.ndarray = FAMILIES[categories][:, None] == FAMILIES[others]
    return same


@compiled()
def barred(costs: np.ndarray, possible: np.ndarray) -> np.ndarray:
    """Return (N, M) costs with infinity where a pair is not possible."""
    allowed = costs.copy()
    for i in range(costs.shape[0]):
        for j in range(costs.shape[1]):
            if not possible[i, j]:
                allowed[i, j] = np.inf
    return allowed


def overlap_costs(
    boxes: np.ndarray, others: np.ndarray, *, overlap: str, least: float
) -> np.ndarray:
    """Return (N, M) 1 minus the overlap of (N, 7) and (M, 7) boxes, infinity up to `least`.

    overlap: `iou` or `giou`, both in space.
    """
    if overlap == "giou":
        shares = generalised_overlaps_3d(boxes, others, least)
    else:
        shares = box_overlaps_3d(boxes, others)
    return _costs(shares, least)


@compiled()
def _costs(shares: np.ndarray, least: float) -> np.ndarray:
    costs = np.full(shares.shape, np.inf)
    for i in range(shares.shape[0]):
        for j in range(shares.shape[1]):
            if shares[i, j] > least:
                costs[i, j] = 1 - shares[i, j]
    return costs


def check_overlap(overlap: str, least: float) -> None:
    """Refuse overlaps that do not exist and thresholds that they cannot have."""
    if overlap not in OVERLAPS:
        raise ValueError(f"no overlap '{overlap}'; possible: {', '.join(OVERLAPS)}")
    lowest = OVERLAPS[overlap]
    if not lowest <= least < 1:
        raise ValueError(f"the least {overlap} must lie in {lowest:g} to 1, got {least!r}")


def chi_square_gate(share: float, dimensions: int) -> float:
    """Return the squared Mahalanobis distance that a share of right pairs does not exceed."""
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(dimensions / 2, share))


@compiled()
def centre_distances(places: np.ndarray, others: np.ndarray, gate_m: float) -> np.ndarray:
    """Return (N, M) distances of (N, 2) and (M, 2) places, infinity from the gate on."""
    distances = np.full((len(places), len(others)), np.inf)
    for i in range(len(places)):
        for j in range(len(others)):
            dx, dy = places[i, 0] - others[j, 0], places[i, 1] - others[j, 1]
            squared = dx * dx + dy * dy
            if squared < gate_m * gate_m:
                distances[i, j] = np.sqrt(squared)
    return distances


@compiled()
def gated_distances(
    expected: np.ndarray, covariances: np.ndarray, measured: np.ndarray, gate: float
) -> np.ndarray:
    """Return (N, M) squared Mahalanobis distances in the plane, infinity from the gate on.

    expected: (N, 2); covariances: (N, 2, 2) of the innovations; measured: (M, 2).
    """
    distances = np.full((len(expected), len(measured)), np.inf)
    for i in range(len(expected)):
        a, b, c = covariances[i, 0, 0], covariances[i, 0, 1], covariances[i, 1, 1]
        determinant = a * c - b * b
        for j in range(len(measured)):
            dx, dy = measured[j, 0] - expected[i, 0], measured[j, 1] - expected[i, 1]
            # Along each axis alone a pair beyond the gate is beyond it in the plane too.
            if dx * dx >= gate * a or dy * dy >= gate * c:
                continue
            squared = (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / determinant
            if squared < gate:
                distances[i, j] = squared
    return distances
