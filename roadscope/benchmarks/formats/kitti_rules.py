"""KITTI's rules of what counts (Geiger et al. 2012).

On image boxes they are those of the benchmark's own evaluation; the same rules serve 3-D boxes
(Weng et al. 2020) and centre distance.

Detectors may find what the labels do not ask for: vans beside cars, people who sit beside
pedestrians, what is largely hidden or cut off by the image's border. Tracks that follow such an
object count neither for nor against; no more do unmatched ones that are small in the image or lie
in a region that nobody labelled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from roadscope.benchmarks.formats.kitti_frames import centres_from_bottoms, yaws_from_rotations
from roadscope.benchmarks.formats.kitti_objects import KittiObjects, KittiType
from roadscope.benchmarks.metrics.matching import centre_distances, image_overlaps
from roadscope.benchmarks.metrics.tracking.sequence import (
    TrackedSequence,
    similarity_by_distance,
)

MAX_OCCLUDED = 2
MAX_TRUNCATED = 0
MIN_HEIGHT_PX = 25.0
REGION_SHARE = 0.5
"""A track is in a DontCare region with more than this share of its image box."""
EPSILON = float(np.finfo(float).eps)
JudgedFrame = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""(M,) and (N,) ids of objects and tracks that count, (M, N) similarities and metres, (N,) scores.
"""
NOTHING: JudgedFrame = (
    np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 0)), np.empty((0, 0)), np.empty(0),
)  # fmt: skip
DISTRACTORS: Mapping[KittiType, tuple[KittiType, ...]] = {
    KittiType.CAR: (KittiType.VAN,),
    KittiType.PEDESTRIAN: (KittiType.PERSON,),
    KittiType.CYCLIST: (),
}


@dataclass(frozen=True, slots=True)
class Similarity:
    """How alike boxes are.

    of: (M,) labels, (N,) tracks -> (M, N) float64, 0 to 1.
    threshold: from which on they can be the same object.
    """

    of: Callable[[KittiObjects, KittiObjects], np.ndarray]
    threshold: float


def image_alikeness(labels: KittiObjects, tracked: KittiObjects) -> np.ndarray:
    """Return (M, N) intersection over union of image boxes."""
    return image_overlaps(labels.boxes, tracked.boxes)


def space_overlaps(labels: KittiObjects, tracked: KittiObjects) -> np.ndarray:
    """Return (M, N) intersection over union of 3-D boxes."""
    from roadscope.core.box_overlap import box_overlaps_3d

    overlaps: np.ndarray = box_overlaps_3d(_boxes(labels), _boxes(tracked))
    return overlaps


def closeness(labels: KittiObjects, tracked: KittiObjects) -> np.ndarray:
    """Return (M, N), 1 for the same centre seen from above, 0.5 at the gate, 0 at twice it."""
    return similarity_by_distance(distances(labels, tracked))


def distances(labels: KittiObjects, tracked: KittiObjects) -> np.ndarray:
    """Return (M, N) metres between centres, seen from above."""
    return centre_distances(_boxes(labels), _boxes(tracked))


SIMILARITIES: Mapping[str, Similarity] = {
    "iou_2d": Similarity(image_alikeness, 0.5),
    "iou_3d": Similarity(space_overlaps, 0.25),
    "centre": Similarity(closeness, 0.5),
}
"""The benchmark's own, AB3DMOT's, and ours on simulated traffic."""


def judged(
    labelled: Sequence[KittiObjects],
    tracked: Sequence[KittiObjects],
    kind: KittiType,
    similarity: str = "iou_2d",
) -> TrackedSequence:
    """Leave out what does not count, frame by frame; the rest goes to the metrics.

    labelled: all labels of each frame, of every type.
    tracked: a tracker's rows of each frame; those of other types are left out.
    """
    measure = SIMILARITIES[similarity]
    frames = [
        _frame(labels, rows, kind, measure) if len(labels) or len(rows) else NOTHING
        for labels, rows in zip(labelled, tracked, strict=True)
    ]
    ids, followers, alike, apart, scores = (
        [frame[k] for frame in frames] for k in range(len(NOTHING))
    )
    return TrackedSequence.of(ids, followers, alike, distances_m=apart, scores=scores)


def _frame(
    labels: KittiObjects, rows: KittiObjects, kind: KittiType, measure: Similarity
) -> JudgedFrame:
    known = np.isin(labels.types, [kind, *DISTRACTORS[kind]]) & (labels.ids >= 0)
    objects = labels.select(known)
    tracks = rows.select((rows.types == kind) & (rows.ids >= 0))
    alikeness = measure.of(objects, tracks)
    regions = labels.boxes[labels.types == KittiType.DONT_CARE]
    counts = _counting(objects, kind)
    kept = ~_excused(alikeness, counts, tracks.boxes, regions, measure.threshold)
    apart = distances(objects.select(counts), tracks.select(kept))
    return (
        objects.ids[counts], tracks.ids[kept], alikeness[np.ix_(counts, kept)], apart,
        tracks.scores[kept],
    )  # fmt: skip


def _counting(objects: KittiObjects, kind: KittiType) -> np.ndarray:
    """Return (M,) bool, objects that must be tracked; the others are distractors."""
    counting: np.ndarray = (
        (objects.types == kind)
        & (objects.occluded <= MAX_OCCLUDED)
        & (objects.truncated <= MAX_TRUNCATED)
    )
    return counting


def _excused(
    alike: np.ndarray,
    counts: np.ndarray,
    boxes: np.ndarray,
    regions: np.ndarray,
    threshold: float,
) -> np.ndarray:
    """Return (N,) bool, tracks that are no false alarms although they match nothing that counts.

    alike: (M, N); counts: (M,) bool; boxes: (N, 4) and regions (D, 4) in pixels.
    """
    from scipy.optimize import linear_sum_assignment

    possible = np.where(alike < threshold - EPSILON, 0.0, alike)
    row, column = linear_sum_assignment(-possible)
    real = possible[row, column] > EPSILON
    row, column = row[real], column[real]
    small = boxes[:, 3] - boxes[:, 1] <= MIN_HEIGHT_PX + EPSILON
    share = _shares(_common_areas(boxes, regions), _areas(boxes)[:, None])
    excused: np.ndarray = small | np.any(share > REGION_SHARE + EPSILON, axis=1)
    excused[column] = ~counts[row]
    return excused


def _areas(boxes: np.ndarray) -> np.ndarray:
    areas: np.ndarray = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    return areas


def _common_areas(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    size = np.maximum(np.minimum(one[:, None, 2:], other[None, :, 2:]) - low, 0.0)
    areas: np.ndarray = size[..., 0] * size[..., 1]
    return areas


def _shares(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Divide areas; nothing has a share of nothing."""
    full = np.broadcast_to(whole, part.shape)
    shares: np.ndarray = np.divide(part, full, out=np.zeros(part.shape), where=full > EPSILON)
    return shares


def _boxes(objects: KittiObjects) -> np.ndarray:
    """Return (N, 7) centre, size and yaw in the ego frame."""
    centres = centres_from_bottoms(objects.bottoms, objects.sizes)
    return np.column_stack([centres, objects.sizes, yaws_from_rotations(objects.rotations_y)])
