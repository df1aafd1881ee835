"""Which pairs of track and detection are possible at all, and what each would cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Category, Family
from roadscope.core.box_overlap import overlapping_pairs, pair_overlaps
from roadscope.core.jit import compiled

FAMILIES = np.array([list(Family).index(category.family) for category in Category])
"""For each value of `Category` the number of its family."""

OVERLAPS = {"iou": 0.0, "giou": -1.0}
"""Overlaps of boxes, and what each is at the least."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """The P pairs of N rows and M columns that are possible; all others cost infinity.

    shape: N and M.
    rows, columns: (P,) int64, by row, then by column.
    costs: (P,) float64.
    """

    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    costs: np.ndarray

    def __len__(self) -> int:
        return len(self.costs)

    def costing(self, costs: np.ndarray) -> Candidates:
        """Give (P,) other costs."""
        return replace(self, costs=costs)

    def where(self, possible: np.ndarray) -> Candidates:
        """Keep the pairs of a (P,) mask."""
        if possible.all():
            return self
        return Candidates(
            self.shape, self.rows[possible], self.columns[possible], self.costs[possible]
        )

    def within_families(self, categories: np.ndarray, others: np.ndarray) -> Candidates:
        """Keep pairs of one family: a car may turn out to be a van, but never a pedestrian.

        categories, others: (N,) and (M,) values of `Category`.
        """
        return self.where(FAMILIES[categories][self.rows] == FAMILIES[others][self.columns])


def overlapping(
    near: Candidates, boxes: np.ndarray, others: np.ndarray, *, overlap: str, least: float
) -> Candidates:
    """Keep those candidates whose (N, 7) and (M, 7) boxes overlap by more than `least`.

    Costs as of `candidates_by_overlap`, which looks at all pairs.
    """
    pairs = near.rows, near.columns
    shares = pair_overlaps(boxes, others, pairs, overlap == "giou", least)
    return near.costing(1 - shares).where(shares > least)


def candidates_by_overlap(
    boxes: np.ndarray, others: np.ndarray, *, overlap: str, least: float
) -> Candidates:
    """Return pairs of (N, 7) and (M, 7) boxes that overlap by more than `least`.

    overlap: `iou` or `giou`, both in space. Costs are 1 minus the overlap.
    """
    rows, columns, shares = overlapping_pairs(boxes, others, overlap == "giou", least)
    return Candidates((len(boxes), len(others)), rows, columns, 1 - shares)


def check_overlap(overlap: str, least: float) -> None:
    """Refuse overlaps that do not exist and thresholds that they cannot have."""
    if overlap not in OVERLAPS:
        raise ValueError(f"no overlap '{overlap}'; possible: {', '.join(OVERLAPS)}")
    lowest = OVERLAPS[overlap]
    if not lowest <= least < 1:
        raise ValueError(f"the least {overlap} must lie in {lowest:g} to 1, got {least!r}")


def chi_square_gate(share: float, dimensions: int) -> float:
    """Return the squared Mahalanobis distance that a share of right pairs does not exceed."""
    if not 0 < share < 1:
        raise ValueError(f"gate_share must lie between 0 and 1, got {share!r}")
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(dimensions / 2, share))


def candidates_by_distance(places: np.ndarray, others: np.ndarray, gates: np.ndarray) -> Candidates:
    """Return pairs of (N, 2) and (M, 2) places nearer than the (N,) gates; costs: distances."""
    places, others = np.ascontiguousarray(places), np.ascontiguousarray(others)
    rows, columns = neighbours(places, others, np.column_stack([gates, gates]))
    apart = places[rows] - others[columns]
    distances = np.hypot(apart[:, 0], apart[:, 1])
    found = Candidates((len(places), len(others)), rows, columns, distances)
    return found.where(distances < gates[rows])


def candidates_by_likelihood(
    expected: np.ndarray, covariances: np.ndarray, measured: np.ndarray, gate: float
) -> Candidates:
    """Return pairs within a gate of squared Mahalanobis distances in the plane, the costs.

    expected: (N, 2); covariances: (N, 2, 2) of the innovations; measured: (M, 2).
    """
    # Along each axis alone a pair beyond the gate is beyond it in the plane too.
    reach = np.ascontiguousarray(np.sqrt(gate * covariances[:, [0, 1], [0, 1]]))
    expected, measured = np.ascontiguousarray(expected), np.ascontiguousarray(measured)
    rows, columns = neighbours(expected, measured, reach)
    squares = _mahalanobis_squared(expected, covariances, measured, rows, columns)
    found = Candidates((len(expected), len(measured)), rows, columns, squares)
    return found.where(squares < gate)


@compiled()
def neighbours(
    places: np.ndarray, others: np.ndarray, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (P,) rows and columns of (N, 2) and (M, 2) places nearer along both axes than reach.

    By row, then by column; reach: (N, 2), along x and along y.
    """
    order = np.argsort(others[:, 0], kind="mergesort")
    xs, ys = others[order, 0], others[order, 1]
    first = np.searchsorted(xs, places[:, 0] - reach[:, 0], "right")
    last = np.searchsorted(xs, places[:, 0] + reach[:, 0], "left")
    most = np.maximum(last - first, 0).sum()
    rows, columns = np.empty(most, np.int64), np.empty(most, np.int64)
    size = 0
    for i in range(len(places)):
        start = size
        for k in range(first[i], last[i]):
            if abs(ys[k] - places[i, 1]) < reach[i, 1]:
                at = size
                while at > start and columns[at - 1] > order[k]:
                    columns[at] = columns[at - 1]
                    at -= 1
                rows[size], columns[at] = i, order[k]
                size += 1
    return rows[:size], columns[:size]


@compiled()
def _mahalanobis_squared(
    expected: np.ndarray,
    covariances: np.ndarray,
    measured: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
) -> np.ndarray:
    squares = np.empty(len(rows))
    for k in range(len(rows)):
        i, j = rows[k], columns[k]
        a, b, c = covariances[i, 0, 0], covariances[i, 0, 1], covariances[i, 1, 1]
        dx, dy = measured[j, 0] - expected[i, 0], measured[j, 1] - expected[i, 1]
        squares[k] = (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / (a * c - b * b)
    return squares


def determinants(covariances: np.ndarray) -> np.ndarray:
    """Return (N,) determinants of (N, 2, 2) symmetric matrices."""
    found: np.ndarray = covariances[:, 0, 0] * covariances[:, 1, 1] - covariances[:, 0, 1] ** 2
    return found
