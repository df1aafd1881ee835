"""How much fusion finds, what it makes up, and whether its distances are right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.fused import FusedDetections
from roadscope.core.record import Record
from roadscope.fusion.evidence import FAMILIES, families_of
from roadscope.fusion.overlap import ious

LEAST_IOU = 0.5
GATE_M = 2.0
NEAR_SHARE, NEAR_M = 0.1, 1.0
FALSE, IGNORED = -1, -2


@dataclass(frozen=True, slots=True, eq=False)
class Targets(Record):
    """What was to be found at one moment, ego frame of the scan.

    families: (N,) int64, columns of `FAMILIES`. centres: (N, 3) metres.
    image_boxes: (N, 4) pixels, without extent where not in the image.
    eligible: (N,) bool; what is not is neither missed nor makes a false alarm.
    hidden: (N,) share of the outline in the image that something else covers.
    """

    families: np.ndarray
    centres: np.ndarray
    image_boxes: np.ndarray
    eligible: np.ndarray
    hidden: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            families=(np.int64, ("N",)),
            centres=(np.float64, ("N", 3)),
            image_boxes=(np.float64, ("N", 4)),
            eligible=(np.bool_, ("N",)),
            hidden=(np.float64, ("N",)),
        )

    def __len__(self) -> int:
        return len(self.families)

    @property
    def distances_m(self) -> np.ndarray:
        """(N,) from the ego over ground."""
        return np.asarray(np.hypot(self.centres[:, 0], self.centres[:, 1]))


@dataclass(frozen=True, slots=True, eq=False)
class Judged(Record):
    """The fate of every fused target of many moments, pooled.

    scores: (K,). target: (K,) int64, number of the eligible target found, counted over all
        moments, or `FALSE` or `IGNORED`.
    right_distance, right_family: (K,) bool, of those that found one.
    families: (E,) of all eligible targets. hidden: (E,). moments: their number.
    """

    scores: np.ndarray
    target: np.ndarray
    right_distance: np.ndarray
    right_family: np.ndarray
    families: np.ndarray
    hidden: np.ndarray
    moments: int


def judge(found: Sequence[FusedDetections], targets: Sequence[Targets]) -> Judged:
    """Match greedily by score, one to one, eligible targets first.

    A target that the camera found matches in the image, by an IoU of 0.5; others in space,
    within 2 m seen from above. What has neither a place in the image nor one within the
    farthest target's distance is not counted.
    """
    parts, start = [], 0
    for fused, real in zip(found, targets, strict=True):
        numbers = np.full(len(real), IGNORED)
        numbers[real.eligible] = start + np.arange(int(real.eligible.sum()))
        start += int(real.eligible.sum())
        parts.append(_judged(fused, real, numbers))
    scores, target, distance, family = (
        np.concatenate([part[k] for part in parts] or [np.empty(0)]) for k in range(4)
    )
    return Judged(
        scores, target.astype(np.int64), distance.astype(bool), family.astype(bool),
        np.concatenate([t.families[t.eligible] for t in targets] or [np.empty(0, np.int64)]),
        np.concatenate([t.hidden[t.eligible] for t in targets] or [np.empty(0)]), len(targets),
    )  # fmt: skip


def threshold_at(judged: Judged, false_per_moment: float) -> float:
    """Return the least score that gives no more false alarms than this; above all if none does."""
    false = np.sort(judged.scores[judged.target == FALSE])[::-1]
    allowed = int(np.floor(false_per_moment * judged.moments + 1e-9))
    return float(np.nextafter(false[allowed], 2.0)) if allowed < len(false) else 0.0


@dataclass(frozen=True, slots=True)
class FusionRates:
    """Rates from 0 to 1 above one threshold; nan where nothing was to be found.

    found: share of eligible targets, of all and by family. false_per_moment beside them.
    distance: share of found ones whose distance is within 10 % or 1 m. family: whose family is
        right. hidden_distance: like distance, of those more than a third hidden.
    targets: number of eligible ones by family.
    """

    all_found: float
    found: tuple[float, ...]
    false_per_moment: float
    distance: float
    hidden_distance: float
    family: float
    targets: tuple[int, ...]


def rates(judged: Judged, least_score: float = 0.0) -> FusionRates:
    """Count what has at least this score."""
    above = judged.scores >= least_score
    hit = above & (judged.target >= 0)
    numbers = judged.target[hit]
    totals = [int((judged.families == k).sum()) for k in range(len(FAMILIES))]
    counts = [int((judged.families[numbers] == k).sum()) for k in range(len(FAMILIES))]
    covered = judged.hidden[numbers] > 1 / 3
    return FusionRates(
        _share(sum(counts), sum(totals)),
        tuple(_share(a, b) for a, b in zip(counts, totals, strict=True)),
        _share(int((above & (judged.target == FALSE)).sum()), judged.moments),
        _share(int(judged.right_distance[hit].sum()), len(numbers)),
        _share(int(judged.right_distance[hit][covered].sum()), int(covered.sum())),
        _share(int(judged.right_family[hit].sum()), len(numbers)),
        tuple(totals),
    )


def _judged(
    fused: FusedDetections, real: Targets, numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    nearness = _nearness(fused, real)
    order = np.argsort(-fused.scores, kind="stable")
    target = np.full(len(fused), FALSE)
    row = np.full(len(fused), -1)
    free = np.ones(len(real), bool)
    for kind in (real.eligible, ~real.eligible):
        for k in order:
            if row[k] >= 0 or not len(real):
                continue
            open_to = np.where(free & kind, nearness[k], 0.0)
            best = int(open_to.argmax())
            if open_to[best] > 0:
                row[k], free[best], target[k] = best, False, numbers[best]
    # A second box on what is not to be found, parked or far, is no false alarm either.
    excused = (nearness[:, ~real.eligible] > 0).any(axis=1) | ~_counted(fused)
    target[(row < 0) & excused] = IGNORED
    true_m = np.append(real.distances_m, np.nan)[row]
    off = np.abs(fused.distances_m - true_m)
    right = (fused.distances_m >= 0) & (off <= np.maximum(NEAR_SHARE * true_m, NEAR_M))
    family = families_of(fused.categories) == np.append(real.families, -1)[row]
    return fused.scores, target, right & (row >= 0), family & (row >= 0)


def _nearness(fused: FusedDetections, real: Targets) -> np.ndarray:
    """(K, N) above 0 where a target may be meant, the more the nearer."""
    overlap = ious(fused.image_boxes, real.image_boxes)
    apart = np.linalg.norm(fused.centres[:, None, :2] - real.centres[None, :, :2], axis=-1)
    in_image = np.where(overlap >= LEAST_IOU, overlap, 0.0)
    in_space = np.where(apart <= GATE_M, 1.0 - apart / (2 * GATE_M), 0.0)
    near: np.ndarray = np.where(fused.by_camera[:, None], in_image, in_space)
    return near


FARTHEST_M = 60.0


def _counted(fused: FusedDetections) -> np.ndarray:
    inside = fused.by_camera | fused.has_image_box
    counted: np.ndarray = inside & (fused.distances_m <= FARTHEST_M)
    return counted


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
