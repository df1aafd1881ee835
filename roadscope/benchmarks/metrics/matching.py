"""Distances and overlaps of boxes, and one-to-one matching by distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """The N detections or tracks and the M objects of one frame, which can be matched.

    distances: (N, M) float64, metres between box centres, seen from above.
    eligible: (M,) bool; an object that is not eligible is no miss, and what is matched with it is
        no false alarm.
    counted: (N,) bool; a detection that is not counted (outside the range band) is no false alarm.
    """

    distances: np.ndarray
    eligible: np.ndarray
    counted: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """The matched pairs of one frame, and what is left of it; all are index arrays.

    detected, truth: (K,) rows of the matched pairs.
    false_alarms: detections that are matched with no object.
    misses: eligible objects that are matched with no detection.
    ignored: detections that are matched with an ineligible object or lie outside the range band.
    """

    detected: np.ndarray
    truth: np.ndarray
    false_alarms: np.ndarray
    misses: np.ndarray
    ignored: np.ndarray


def centre_distances(centres: np.ndarray, truth_centres: np.ndarray) -> np.ndarray:
    """Return (N, M) distances in the ground plane between (N, 2+) and (M, 2+) centres, metres."""
    first, second = np.asarray(centres), np.asarray(truth_centres)
    x = first[:, 0, None] - second[:, 0]
    y = first[:, 1, None] - second[:, 1]
    # Twice as fast as np.hypot, which guards against an overflow that metres never cause.
    distances: np.ndarray = np.sqrt(x * x + y * y)
    return distances


def image_overlaps(boxes: np.ndarray, truth_boxes: np.ndarray) -> np.ndarray:
    """Return (N, M) intersection over union of (N, 4) and (M, 4) image boxes, 0 to 1.

    Boxes: left top right bottom; one without an area overlaps nothing.
    """
    first, second = np.asarray(boxes, float)[:, None], np.asarray(truth_boxes, float)[None]
    low = np.maximum(first[..., :2], second[..., :2])
    high = np.minimum(first[..., 2:], second[..., 2:])
    common = np.prod(np.maximum(high - low, 0), axis=-1)
    union = np.prod(first[..., 2:] - first[..., :2], axis=-1)
    union = union + np.prod(second[..., 2:] - second[..., :2], axis=-1) - common
    overlaps: np.ndarray = np.divide(common, union, out=np.zeros_like(common), where=union > 0)
    return overlaps


def assign(distances: np.ndarray, gate_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows and columns of the best one-to-one pairs within the gate.

    The number of pairs is as large as possible; among such pairings the total distance is least.

    distances: (N, M) metres. gate_m: metres, inclusive.
    """
    from scipy.optimize import linear_sum_assignment

    if distances.size == 0:
        return np.empty(0, np.int64), np.empty(0, np.int64)
    # A pair beyond the gate must cost more than all pairs within it together, so that no pair
    # within the gate is given up for a shorter total.
    beyond = (min(distances.shape) + 1.0) * max(gate_m, 1.0)
    rows, columns = linear_sum_assignment(np.where(distances <= gate_m, distances, beyond))
    close = distances[rows, columns] <= gate_m
    return rows[close], columns[close]


def match(pairing: Pairing, gate_m: float) -> Match:
    """Match with eligible objects first, then match the other detections with ineligible ones."""
    eligible = np.flatnonzero(pairing.eligible)
    detected, column = assign(pairing.distances[:, eligible], gate_m)
    unmatched = other_rows(len(pairing.distances), detected)
    ineligible = np.flatnonzero(~pairing.eligible)
    row, _ = assign(pairing.distances[np.ix_(unmatched, ineligible)], gate_m)
    ignored = ~pairing.counted[unmatched]
    ignored[row] = True
    return Match(
        detected=detected,
        truth=eligible[column],
        false_alarms=unmatched[~ignored],
        misses=eligible[other_rows(len(eligible), column)],
        ignored=unmatched[ignored],
    )


def other_rows(count: int, rows: np.ndarray) -> np.ndarray:
    """Return the numbers from 0 to `count` - 1 that are not among rows."""
    other = np.ones(count, bool)
    other[rows] = False
    return np.flatnonzero(other)


def match_all(pairings: Sequence[Pairing], gate_m: float) -> list[Match]:
    """Return the match of each frame."""
    return [match(pairing, gate_m) for pairing in pairings]
