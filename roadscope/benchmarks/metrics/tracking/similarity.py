"""How alike objects and tracks are, 0 to 1, by what is asked: place, box or image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from roadscope.benchmarks.metrics.matching import centre_distances
from roadscope.benchmarks.metrics.tracking.sequence import GATE_M as GATE_M
from roadscope.benchmarks.metrics.tracking.sequence import TrackedSequence
from roadscope.benchmarks.metrics.tracking.sequence import near as near
from roadscope.core import Detections, Tracks, Truth

Boxes = Detections | Tracks | Truth
Similarity = Callable[[Boxes, Boxes], np.ndarray]
"""Takes the objects and the tracks of a frame, returns (objects, tracks) in 0 to 1."""


def by_centres(truth: Boxes, tracks: Boxes, gate_m: float = GATE_M) -> np.ndarray:
    """Return 1 for the same place seen from above, 0.5 at the gate, 0 from twice that on."""
    return near(centre_distances(truth.centres, tracks.centres), gate_m)


def by_area(truth: Boxes, tracks: Boxes) -> np.ndarray:
    """Return intersection over union seen from above."""
    from roadscope.core.box_overlap import box_overlaps

    flat = [np.column_stack([b.centres[:, :2], b.sizes[:, :2], b.yaws]) for b in (truth, tracks)]
    shares: np.ndarray = box_overlaps(*flat)
    return shares


def by_volume(truth: Boxes, tracks: Boxes) -> np.ndarray:
    """Return intersection over union in space."""
    from roadscope.core.box_overlap import box_overlaps_3d

    return box_overlaps_3d(
        *(np.column_stack([b.centres, b.sizes, b.yaws]) for b in (truth, tracks))
    )


def image_overlaps(truth: np.ndarray, tracks: np.ndarray) -> np.ndarray:
    """Return (M, N) intersection over union of (M, 4) and (N, 4) boxes: left top right bottom."""
    one, other = np.asarray(truth, float)[:, None], np.asarray(tracks, float)[None]
    low, high = np.maximum(one[..., :2], other[..., :2]), np.minimum(one[..., 2:], other[..., 2:])
    common = np.prod(np.maximum(high - low, 0), axis=-1)
    whole = np.prod(one[..., 2:] - one[..., :2], axis=-1)
    whole = whole + np.prod(other[..., 2:] - other[..., :2], axis=-1) - common
    shares: np.ndarray = np.divide(common, whole, out=np.zeros_like(common), where=whole > 0)
    return shares


SIMILARITIES: Mapping[str, Similarity] = {
    "centre": by_centres,
    "iou_bev": by_area,
    "iou_3d": by_volume,
}
"""By name; in the image `image_overlaps` takes plain boxes."""


def tracked_sequence(
    tracks: Sequence[Tracks],
    truths: Sequence[Truth],
    similarity: Similarity | str = "centre",
    *,
    gate_m: float = GATE_M,
) -> TrackedSequence:
    """Compare tracks and objects frame by frame, both in the same coordinate frame.

    similarity: a name of `SIMILARITIES` or a function like those. gate_m: for `centre`.
    """
    alike = named(similarity, gate_m)
    frames = list(zip(tracks, truths, strict=True))
    return TrackedSequence.of(
        [truth.ids for _, truth in frames],
        [tracked.ids for tracked, _ in frames],
        [alike(truth, tracked) for tracked, truth in frames],
        distances_m=[centre_distances(truth.centres, tracked.centres) for tracked, truth in frames],
        scores=[tracked.scores for tracked, _ in frames],
    )


def named(similarity: Similarity | str, gate_m: float = GATE_M) -> Similarity:
    """Return what is meant by a name; refuse an unknown one."""
    if callable(similarity):
        return similarity
    if similarity not in SIMILARITIES:
        raise ValueError(f"no similarity '{similarity}'; known: {', '.join(SIMILARITIES)}")
    return (
        partial(by_centres, gate_m=gate_m) if similarity == "centre" else SIMILARITIES[similarity]
    )
