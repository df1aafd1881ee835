"""Weighted box fusion (Solovyev, Wang and Gabruseva 2021) of both sensors' boxes in the image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Detections, ImageDetections
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.evidence import camera_masses, lidar_masses
from roadscope.fusion.overlap import ious


class WeightedBoxFusion:
    """Overlapping boxes are averaged by score; a box of one sensor alone gets half its score.

    The paper fuses boxes of one class. Here families may differ, because the family of a cluster of
    returns is uncertain.
    """

    def __init__(self, *, least_iou: float = 0.4) -> None:
        """Take the intersection over union above which a box joins the mean of others."""
        if not 0 < least_iou < 1:
            raise ValueError(f"least_iou must be between 0 and 1, got {least_iou!r}")
        self.least_iou = least_iou

    def reset(self) -> None:
        """Do nothing: a fusion keeps no state."""

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join both sensors' targets."""
        views = Views.of(lidar, camera, projection)
        models = 2 - (lidar is None) - (camera is None)
        inside = np.flatnonzero(views.in_image)
        outside = np.flatnonzero(~views.in_image)
        sources = np.concatenate([np.zeros(len(inside), int), np.ones(len(views.camera), int)])
        rows = np.concatenate([inside, np.arange(len(views.camera))])
        boxes = np.concatenate([views.lidar_boxes[inside], views.camera.boxes])
        scores = np.concatenate([views.lidar.scores[inside], views.camera.scores])
        groups = _grouped(boxes, scores, self.least_iou)
        best = np.full((2, len(groups)), -1)
        mean, confidence = np.empty((len(groups), 4)), np.empty(len(groups))
        for k, members in enumerate(groups):
            weights = np.maximum(scores[members], 1e-6)
            mean[k] = weights @ boxes[members] / weights.sum()
            confidence[k] = scores[members].mean() * min(len(members), models) / models
            for source in (0, 1):
                own = members[sources[members] == source]
                if len(own):
                    best[source, k] = rows[own[scores[own].argmax()]]
        masses = _masses(views, best)
        fused = assemble(
            views,
            np.concatenate([best[0], outside]),
            np.concatenate([best[1], np.full(len(outside), -1)]),
            np.concatenate([masses, lidar_masses(views.lidar)[outside]]),
            np.concatenate([confidence, views.lidar.scores[outside] / models]),
        )
        image_boxes = fused.image_boxes.copy()
        image_boxes[: len(groups)] = mean
        return replace(fused, image_boxes=image_boxes)


def _grouped(boxes: np.ndarray, scores: np.ndarray, least_iou: float) -> list[np.ndarray]:
    """Return the rows of (N, 4) boxes in each group; means of groups are the fused boxes.

    In the order of falling (N,) scores, each box joins the group whose mean it overlaps most.
    """
    groups: list[list[int]] = []
    means = np.empty((0, 4))
    for row in np.argsort(-scores, kind="stable"):
        overlap = ious(boxes[row : row + 1], means)[0]
        if len(overlap) and overlap.max() > least_iou:
            group = groups[int(overlap.argmax())]
            group.append(int(row))
            weights = np.maximum(scores[group], 1e-6)
            means[int(overlap.argmax())] = weights @ boxes[group] / weights.sum()
        else:
            groups.append([int(row)])
            means = np.concatenate([means, boxes[row : row + 1]])
    return [np.array(group) for group in groups]


def _masses(views: Views, best: np.ndarray) -> np.ndarray:
    """Return the (K, 4) masses of K groups: the camera's where it has a box, otherwise the LiDAR's.

    best: (2, K) row of the best LiDAR and of the best camera detection of each group, -1 for none.
    """
    masses = np.zeros((best.shape[1], 4))
    by_camera = best[1] >= 0
    masses[by_camera] = camera_masses(views.camera)[best[1][by_camera]]
    masses[~by_camera] = lidar_masses(views.lidar)[best[0][~by_camera]]
    return masses
