"""Which pairs of tracks and detections are possible at all, and what each costs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import Category, Detections
from roadscope.core.box_overlap import overlapping_pairs, pair_overlaps
from roadscope.core.category import families_of

FAMILIES = families_of(list(Category))
"""For each value of `Category` the number of its family."""

LOWEST_OVERLAPS = {"iou": 0.0, "giou": -1.0}
"""The measures of overlap of two boxes, and the lowest value of each."""


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePairs:
    """The P possible pairs of N rows and M columns; all others cost infinity.

    shape: N and M. Rows are tracks and columns detections, if nothing else is said.
    rows, columns: (P,) int64, sorted by row, then by column.
    costs: (P,) float64.
    """

    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    costs: np.ndarray

    def __len__(self) -> int:
        return len(self.costs)

    def with_costs(self, costs: np.ndarray) -> CandidatePairs:
        """Return the same pairs with (P,) other costs."""
        return replace(self, costs=costs)

    def where(self, possible: np.ndarray) -> CandidatePairs:
        """Return the pairs of a (P,) mask."""
        if possible.all():
            return self
        return CandidatePairs(
            self.shape, self.rows[possible], self.columns[possible], self.costs[possible]
        )

    def within_families(
        self, row_categories: np.ndarray, column_categories: np.ndarray
    ) -> CandidatePairs:
        """Return pairs within one family: a car may turn out to be a van, never a pedestrian.

        row_categories, column_categories: (N,) and (M,) values of `Category`.
        """
        row_families, column_families = FAMILIES[row_categories], FAMILIES[column_categories]
        return self.where(row_families[self.rows] == column_families[self.columns])


def boxes_of(detections: Detections) -> np.ndarray:
    """Return (N, 7) centre x y z, length width height, yaw."""
    return np.column_stack([detections.centres, detections.sizes, detections.yaws])


def pairs_by_overlap(
    boxes: np.ndarray, other_boxes: np.ndarray, *, overlap: str, least: float
) -> CandidatePairs:
    """Return pairs of (N, 7) and (M, 7) boxes that overlap by more than `least`.

    overlap: `iou` or `giou` (generalised IoU), both in space. Costs are 1 minus the overlap.
    """
    rows, columns, overlaps = overlapping_pairs(
        boxes, other_boxes, generalised=overlap == "giou", least=least
    )
    return CandidatePairs((len(boxes), len(other_boxes)), rows, columns, 1 - overlaps)


def pairs_that_overlap(
    candidates: CandidatePairs,
    boxes: np.ndarray,
    other_boxes: np.ndarray,
    *,
    overlap: str,
    least: float,
) -> CandidatePairs:
    """Return those candidates whose boxes overlap, like `pairs_by_overlap` of all pairs."""
    overlaps = pair_overlaps(
        boxes, other_boxes, candidates.rows, candidates.columns, overlap == "giou", least
    )
    return candidates.with_costs(1 - overlaps).where(overlaps > least)


def check_overlap(overlap: str, least: float) -> None:
    """Raise `ValueError` for a measure that does not exist or a threshold outside its range."""
    if overlap not in LOWEST_OVERLAPS:
        raise ValueError(f"no overlap '{overlap}'; possible: {', '.join(LOWEST_OVERLAPS)}")
    lowest = LOWEST_OVERLAPS[overlap]
    if not lowest <= least < 1:
        raise ValueError(f"the least {overlap} must lie in {lowest:g} to 1, got {least!r}")


def suppressed(detections: Detections, most_overlap: float) -> Detections:
    """Return what non-maximum suppression leaves.

    A detection is dropped if it overlaps one of its family that has a higher score and stays.

    most_overlap: IoU in space above which two detections are of one object. Of equal scores the
        first stays.
    """
    boxes, categories = boxes_of(detections), detections.categories
    near = pairs_by_overlap(boxes, boxes, overlap="iou", least=most_overlap)
    near = near.within_families(categories, categories)
    starts = np.searchsorted(near.rows, np.arange(len(detections) + 1)).tolist()
    stays = np.ones(len(detections), bool)
    for row in np.argsort(-detections.scores, kind="stable").tolist():
        if stays[row]:
            stays[near.columns[starts[row] : starts[row + 1]]] = False
            stays[row] = True
    return detections.select(stays)


def chi_square_gate(share: float, dimensions: int) -> float:
    """Return the squared Mahalanobis distance that a share of right pairs does not exceed.

    share: between 0 and 1. dimensions: of the measurement.
    """
    if not 0 < share < 1:
        raise ValueError(f"gate_share must lie between 0 and 1, got {share!r}")
    from scipy.special import gammaincinv

    return float(2 * gammaincinv(dimensions / 2, share))


def pairs_by_distance(
    positions: np.ndarray, other_positions: np.ndarray, gates_m: np.ndarray
) -> CandidatePairs:
    """Return pairs of positions nearer than a gate; costs are distances.

    positions: (N, 2) and other_positions: (M, 2), metres. gates_m: (N,).
    """
    rows, columns = pairs_within_reach(
        positions, other_positions, np.column_stack([gates_m, gates_m])
    )
    offsets = positions[rows] - other_positions[columns]
    distances = np.hypot(offsets[:, 0], offsets[:, 1])
    shape = len(positions), len(other_positions)
    return CandidatePairs(shape, rows, columns, distances).where(distances < gates_m[rows])


def pairs_by_likelihood(
    expected: np.ndarray, covariances: np.ndarray, measured: np.ndarray, gate: float
) -> CandidatePairs:
    """Return pairs within a gate; costs are squared Mahalanobis distances in the plane.

    expected: (N, 2) metres. covariances: (N, 2, 2) m2, of the innovations. measured: (M, 2) metres.
    gate: squared Mahalanobis distance, see `chi_square_gate`.
    """
    # A pair beyond the gate along x or y alone is beyond it in the plane, too.
    reach = np.sqrt(gate * covariances[:, [0, 1], [0, 1]])
    rows, columns = pairs_within_reach(expected, measured, reach)
    a, b, c = (covariances[rows, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
    dx, dy = (measured[columns] - expected[rows]).T
    squared = (c * dx * dx - 2 * b * dx * dy + a * dy * dy) / (a * c - b * b)
    shape = len(expected), len(measured)
    return CandidatePairs(shape, rows, columns, squared).where(squared < gate)


def pairs_within_reach(
    positions: np.ndarray, other_positions: np.ndarray, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return (P,) rows and columns of positions nearer to each other than reach along both axes.

    positions, other_positions: (N, 2) and (M, 2). reach: (N, 2) along x and along y.
    Pairs are sorted by row, then by column.
    """
    order = np.argsort(other_positions[:, 0], kind="stable")
    xs = other_positions[order, 0]
    first = np.searchsorted(xs, positions[:, 0] - reach[:, 0], "right")
    last = np.searchsorted(xs, positions[:, 0] + reach[:, 0], "left")
    counts = np.maximum(last - first, 0)
    rows = np.repeat(np.arange(len(positions)), counts)
    starts = np.cumsum(counts) - counts
    columns = order[np.arange(len(rows)) + np.repeat(first - starts, counts)]
    near = np.abs(other_positions[columns, 1] - positions[rows, 1]) < reach[rows, 1]
    rows, columns = rows[near], columns[near]
    by_row_and_column = np.argsort(rows * len(other_positions) + columns)
    return rows[by_row_and_column], columns[by_row_and_column]


def determinants(covariances: np.ndarray) -> np.ndarray:
    """Return (N,) determinants of (N, 2, 2) symmetric matrices."""
    values: np.ndarray = covariances[:, 0, 0] * covariances[:, 1, 1] - covariances[:, 0, 1] ** 2
    return values
