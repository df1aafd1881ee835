"""Which objects and tracks count on recorded data, by the rules of KITTI and of MOTChallenge.

KITTI (Geiger et al. 2012): the rules of the benchmark's own evaluation on image boxes, as TrackEval
has them. They decide what counts for 3-D boxes and distances of centres too, so all three scores
are of the same objects and tracks. (AB3DMOT, Weng et al. 2020, finds distractors by overlap in
space.) Some objects may be detected but need not be: vans beside cars, sitting people
beside pedestrians, and objects whose occlusion is unknown (level 3) or that are truncated at all. A
track on such a distractor counts neither as a hit nor as a false alarm. Neither does an unmatched
track that is small in the image or in a region without labels.

MOTChallenge (Milan et al. 2016): pedestrians count. A track on a distractor (people on vehicles,
standing or sitting people, reflections) counts neither as a hit nor as a false alarm.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from roadscope.benchmarks.formats.kitti_frames import centres_from_bottoms, yaws_from_rotations
from roadscope.benchmarks.formats.kitti_labels import KittiObjects, KittiType
from roadscope.benchmarks.formats.motchallenge import (
    DISTRACTOR,
    NON_MOTOR_VEHICLE,
    PEDESTRIAN,
    PERSON_ON_VEHICLE,
    REFLECTION,
    STATIC_PERSON,
    MotRows,
)
from roadscope.benchmarks.metrics.matching import centre_distances, image_overlaps
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence, similarity_by_distance

MAX_OCCLUDED = 2
MAX_TRUNCATED = 0
MIN_HEIGHT_PX = 25.0
MIN_REGION_SHARE = 0.5
"""A track is in a DontCare region if more than this share of its image box is. Like the limits
above it comes from KITTI's evaluation."""
KITTI_DISTRACTORS: Mapping[KittiType, tuple[KittiType, ...]] = {
    KittiType.CAR: (KittiType.VAN,),
    KittiType.PEDESTRIAN: (KittiType.PERSON,),
    KittiType.CYCLIST: (),
}
MOT_DISTRACTORS = (PERSON_ON_VEHICLE, STATIC_PERSON, DISTRACTOR, REFLECTION)
"""Classes that are distractors in MOT16 and MOT17."""
MOT20_DISTRACTORS = (*MOT_DISTRACTORS, NON_MOTOR_VEHICLE)
IMAGE_THRESHOLD = 0.5
"""Image boxes with this intersection over union can be of the same object."""
EPSILON = float(np.finfo(float).eps)


class BoxSimilarity(NamedTuple):
    """A measure of how similar boxes are.

    measure: M labels, N tracks -> (M, N) float64 from 0 to 1.
    threshold: boxes of at least this similarity can be of the same object.
    """

    measure: Callable[[KittiObjects, KittiObjects], np.ndarray]
    threshold: float


class CountedFrame(NamedTuple):
    """The M objects and N tracks of one frame that count.

    object_ids: (M,) int64.
    track_ids: (N,) int64.
    similarities: (M, N) float64.
    scores: (N,) float64, of the tracks.
    distances_m: (M, N) float64, between the centres seen from above; empty for MOTChallenge.
    """

    object_ids: np.ndarray
    track_ids: np.ndarray
    similarities: np.ndarray
    scores: np.ndarray
    distances_m: np.ndarray


def overlap_in_image(labels: KittiObjects, tracks: KittiObjects) -> np.ndarray:
    """Return (M, N) intersection over union of image boxes."""
    return image_overlaps(labels.boxes, tracks.boxes)


def overlap_in_space(labels: KittiObjects, tracks: KittiObjects) -> np.ndarray:
    """Return (M, N) intersection over union of 3-D boxes."""
    from roadscope.core.box_overlap import box_overlaps_3d

    overlaps: np.ndarray = box_overlaps_3d(boxes_3d(labels), boxes_3d(tracks))
    return overlaps


def centre_similarity(labels: KittiObjects, tracks: KittiObjects) -> np.ndarray:
    """Return (M, N): 1 for the same centre seen from above, 0.5 at 2 m, 0 from 4 m on."""
    return similarity_by_distance(centre_distances_m(labels, tracks))


def centre_distances_m(labels: KittiObjects, tracks: KittiObjects) -> np.ndarray:
    """Return (M, N) metres between centres, seen from above."""
    return centre_distances(boxes_3d(labels), boxes_3d(tracks))


BOX_SIMILARITIES: Mapping[str, BoxSimilarity] = {
    "iou_2d": BoxSimilarity(overlap_in_image, 0.5),
    "iou_3d": BoxSimilarity(overlap_in_space, 0.25),
    "centre": BoxSimilarity(centre_similarity, 0.5),
}
"""Of KITTI's evaluation, of AB3DMOT's, and of our boards of simulated traffic."""


def apply_kitti_rules(
    labels: Sequence[KittiObjects],
    tracks: Sequence[KittiObjects],
    kind: KittiType,
    similarity: str = "iou_2d",
) -> TrackedSequence:
    """Return the objects and tracks that count under KITTI's rules.

    labels: all labels of each frame, of every type.
    tracks: a tracker's rows of each frame; rows of other types than `kind` are left out.
    similarity: a key of `BOX_SIMILARITIES`, of the objects and tracks that count.
    """
    frames = [
        _kitti_frame(objects, rows, kind, BOX_SIMILARITIES[similarity])
        for objects, rows in zip(labels, tracks, strict=True)
    ]
    return _tracked_sequence(frames, [frame.distances_m for frame in frames])


def apply_mot_rules(
    truth: Sequence[MotRows],
    tracks: Sequence[MotRows],
    distractors: Collection[int] = MOT_DISTRACTORS,
) -> TrackedSequence:
    """Return the objects and tracks that count under MOTChallenge's rules, by image boxes.

    truth: rows of ground truth of each frame; rows with confidence 0 do not count.
    tracks: a tracker's rows of each frame; rows without an id or a box are left out.
    distractors: numbers of classes, see `distractors_of`.
    """
    frames = [
        _mot_frame(objects, rows, distractors) for objects, rows in zip(truth, tracks, strict=True)
    ]
    return _tracked_sequence(frames)


def distractors_of(sequence: str) -> tuple[int, ...]:
    """Return the distractor classes of a MOTChallenge sequence by its name."""
    return MOT20_DISTRACTORS if sequence.startswith("MOT20") else MOT_DISTRACTORS


def _tracked_sequence(
    frames: Sequence[CountedFrame], distances_m: Sequence[np.ndarray] | None = None
) -> TrackedSequence:
    return TrackedSequence.of(
        [frame.object_ids for frame in frames],
        [frame.track_ids for frame in frames],
        [frame.similarities for frame in frames],
        distances_m=distances_m,
        scores=[frame.scores for frame in frames],
    )


def _kitti_frame(
    labels: KittiObjects, rows: KittiObjects, kind: KittiType, similarity: BoxSimilarity
) -> CountedFrame:
    is_known = np.isin(labels.types, [kind, *KITTI_DISTRACTORS[kind]]) & (labels.ids >= 0)
    objects = labels.select(is_known)
    tracks = rows.select((rows.types == kind) & (rows.ids >= 0))
    counts = objects.types == kind
    counts &= (objects.occluded <= MAX_OCCLUDED) & (objects.truncated <= MAX_TRUNCATED)
    regions = labels.boxes[labels.types == KittiType.DONT_CARE]
    shares = shares_in_regions(tracks.boxes, regions)
    excused = tracks.boxes[:, 3] - tracks.boxes[:, 1] <= MIN_HEIGHT_PX + EPSILON
    excused |= np.any(shares > MIN_REGION_SHARE + EPSILON, axis=1)
    object_rows, track_rows = _assigned_pairs(overlap_in_image(objects, tracks), IMAGE_THRESHOLD)
    excused[track_rows] = ~counts[object_rows]
    objects, tracks = objects.select(counts), tracks.select(~excused)
    return CountedFrame(
        object_ids=objects.ids,
        track_ids=tracks.ids,
        similarities=similarity.measure(objects, tracks),
        scores=tracks.scores,
        distances_m=centre_distances_m(objects, tracks),
    )


def _mot_frame(objects: MotRows, rows: MotRows, distractors: Collection[int]) -> CountedFrame:
    has_box = np.all(rows.boxes[:, 2:] > rows.boxes[:, :2], axis=1)
    tracks = rows.select((rows.ids >= 0) & has_box)
    similarities = image_overlaps(objects.boxes, tracks.boxes)
    counts = (objects.classes == PEDESTRIAN) & (objects.confidences != 0)
    object_rows, track_rows = _assigned_pairs(similarities, IMAGE_THRESHOLD)
    excused = np.zeros(len(tracks), bool)
    excused[track_rows] = np.isin(objects.classes, list(distractors))[object_rows]
    return CountedFrame(
        object_ids=objects.ids[counts],
        track_ids=tracks.ids[~excused],
        similarities=similarities[np.ix_(counts, ~excused)],
        scores=tracks.confidences[~excused],
        distances_m=np.empty((0, 0)),
    )


def _assigned_pairs(similarities: np.ndarray, threshold: float) -> tuple[np.ndarray, np.ndarray]:
    """Return rows of objects and of tracks that belong together, for the largest total similarity.

    Pairs below the threshold are left out.
    """
    from scipy.optimize import linear_sum_assignment

    possible = np.where(similarities < threshold - EPSILON, 0.0, similarities)
    objects, tracks = linear_sum_assignment(-possible)
    is_pair = possible[objects, tracks] > EPSILON
    return objects[is_pair], tracks[is_pair]


def shares_in_regions(boxes: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """Return (N, D), the share of each of (N, 4) image boxes that is in each of (D, 4) regions."""
    low = np.maximum(boxes[:, None, :2], regions[None, :, :2])
    size = np.maximum(np.minimum(boxes[:, None, 2:], regions[None, :, 2:]) - low, 0.0)
    common = size[..., 0] * size[..., 1]
    areas = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    whole = np.broadcast_to(areas[:, None], common.shape)
    shares: np.ndarray = np.divide(common, whole, out=np.zeros(common.shape), where=whole > EPSILON)
    return shares


def boxes_3d(objects: KittiObjects) -> np.ndarray:
    """Return (N, 7) centre, size and yaw in the ego frame."""
    centres = centres_from_bottoms(objects.bottoms, objects.sizes)
    return np.column_stack([centres, objects.sizes, yaws_from_rotations(objects.rotations_y)])
