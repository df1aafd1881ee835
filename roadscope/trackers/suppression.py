"""Non-maximum suppression: of detections that overlap the surest stays."""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections
from roadscope.core.jit import compiled
from roadscope.trackers.gating import candidates_by_overlap
from roadscope.trackers.tracklets import boxes_of


def suppressed(targets: Detections, most: float) -> Detections:
    """Drop detections that overlap a surer one that stays, of their family, by more than `most`.

    most: intersection over union in space. Of equal scores the first stays.
    """
    boxes, kinds = boxes_of(targets), targets.categories
    near = candidates_by_overlap(boxes, boxes, overlap="iou", least=most)
    near = near.within_families(kinds, kinds)
    starts = np.searchsorted(near.rows, np.arange(len(targets) + 1))
    order = np.argsort(-targets.scores, kind="stable")
    return targets.select(_left(order, starts, near.columns))


@compiled()
def _left(order: np.ndarray, starts: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Return (N,) bool; starts: (N + 1,) where in columns each one's neighbours start."""
    left = np.ones(len(order), np.bool_)
    for row in order:
        if left[row]:
            for k in range(starts[row], starts[row + 1]):
                if columns[k] != row:
                    left[columns[k]] = False
    return left
