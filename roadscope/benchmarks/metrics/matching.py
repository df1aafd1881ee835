"""Which detection belongs to which object, one to one, by bird's-eye centre distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """What one frame offers to be matched: N detections or tracks against M objects.

    distances: (N, M) float64, metres between box centres, seen from above.
    eligible: (M,) bool; an object that is not is neither a miss nor makes a false alarm.
    counted: (N,) bool; a detection that is not (outside the range band) is no false alarm.
    """

    distances: np.ndarray
    eligible: np.ndarray
    counted: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """The fate of every detection and eligible object of one frame, all index arrays.

    detected, truth: (K,) matched pairs.
    false_alarms: detections that belong to nothing.
    misses: eligible objects that nothing belongs to.
    ignored: detections that belong to ineligible objects or lie outside the range band.
    """

    detected: np.ndarray
    truth: np.ndarray
    false_alarms: np.ndarray
    misses: np.ndarray
    ignored: np.ndarray


def centre_distances(centres: np.ndarray, truth_centres: np.ndarray) -> np.ndarray:
    """Return (N, M) distances in the ground plane between (N, 2+) and (M, 2+) centres, metres."""
    ones, others = np.asarray(centres), np.asarray(truth_centres)
    x = ones[:, 0, None] - others[:, 0]
    y = ones[:, 1, None] - others[:, 1]
    # Half the time of hypot, which guards against what metres never are.
    distances: np.ndarray = np.sqrt(x * x + y * y)
    return distances


def assign(distances: np.ndarray, gate_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Pair rows and columns one to one: as many as the gate allows, then least total distance."""
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
    """Match optimally: first with eligible objects, then what is left with ineligible ones."""
    eligible = np.flatnonzero(pairing.eligible)
    detected, column = assign(pairing.distances[:, eligible], gate_m)
    left = np.setdiff1d(np.arange(len(pairing.distances)), detected)
    others = np.flatnonzero(~pairing.eligible)
    row, _ = assign(pairing.distances[np.ix_(left, others)], gate_m)
    excused = ~pairing.counted[left]
    excused[row] = True
    return Match(
        detected=detected,
        truth=eligible[column],
        false_alarms=left[~excused],
        misses=np.setdiff1d(eligible, eligible[column]),
        ignored=left[excused],
    )


def match_all(pairings: Sequence[Pairing], gate_m: float) -> list[Match]:
    """Match frame by frame."""
    return [match(pairing, gate_m) for pairing in pairings]
