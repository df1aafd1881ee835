"""Fusions for comparison: simple rules without evidence theory.

If the detections of one sensor are None, every rule returns the targets of the other.
"""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, ImageDetections
from roadscope.core.checks import require
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views, assemble
from roadscope.fusion.candidates import leftovers, matched
from roadscope.fusion.evidence import camera_masses, lidar_masses


class UnionFusion:
    """All targets of both sensors; where their boxes match, one target with the better score."""

    def __init__(self, *, least_iou: float = 0.3) -> None:
        """Take the least intersection over union of two boxes that match."""
        require(0 < least_iou < 1, self, "least_iou", "between 0 and 1", least_iou)
        self.least_iou = least_iou

    def reset(self) -> None:
        """Do nothing: a fusion keeps no state."""

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join both sensors' targets."""
        views = Views.of(lidar, camera, projection)
        if lidar is None or camera is None:
            return self._of_one(views)
        rows, columns = matched(views, self.least_iou)
        return self._joined(views, rows, columns)

    def _of_one(self, views: Views) -> FusedDetections:
        """Return all targets of the only sensor with a measurement, whatever the rule for both."""
        no_pairs = np.empty(0, np.int64)
        return UnionFusion._joined(self, views, no_pairs, no_pairs)

    def _joined(self, views: Views, rows: np.ndarray, columns: np.ndarray) -> FusedDetections:
        """Return the targets; rows, columns: (P,) LiDAR and camera detections of matched pairs."""
        lidar_only = leftovers(len(views.lidar), rows)
        camera_only = leftovers(len(views.camera), columns)
        of_lidar = lidar_masses(views.lidar)
        of_camera = camera_masses(views.camera)
        better = views.lidar.scores[rows] > views.camera.scores[columns]
        masses = np.where(better[:, None], of_lidar[rows], of_camera[columns])
        return assemble(
            views,
            np.concatenate([rows, lidar_only, np.full(len(camera_only), -1)]),
            np.concatenate([columns, np.full(len(lidar_only), -1), camera_only]),
            np.concatenate([masses, of_lidar[lidar_only], of_camera[camera_only]]),
            np.concatenate(
                [
                    self._score(views.lidar.scores[rows], views.camera.scores[columns]),
                    views.lidar.scores[lidar_only],
                    views.camera.scores[camera_only],
                ]
            ),
        )

    def _score(self, lidar: np.ndarray, camera: np.ndarray) -> np.ndarray:
        """Return the (P,) scores of pairs from those of both sensors."""
        better: np.ndarray = np.maximum(lidar, camera)
        return better


class BayesFusion(UnionFusion):
    """Union of targets; log odds of scores add up in pairs, as if sensors erred independently."""

    def __init__(self, *, least_iou: float = 0.3, prior: float = 0.5) -> None:
        """Set the fusion up.

        least_iou: least intersection over union of two boxes that match.
        prior: share of all candidates that are targets.
        """
        super().__init__(least_iou=least_iou)
        require(0 < prior < 1, self, "prior", "between 0 and 1", prior)
        self.prior = prior

    def _score(self, lidar: np.ndarray, camera: np.ndarray) -> np.ndarray:
        log_odds = _logit(lidar) + _logit(camera) - _logit(np.array(self.prior))
        result: np.ndarray = 1 / (1 + np.exp(-log_odds))
        return result


class ImageFirstFusion(UnionFusion):
    """The camera's targets; LiDAR adds position and distance where boxes match."""

    def _joined(self, views: Views, rows: np.ndarray, columns: np.ndarray) -> FusedDetections:
        lidar_rows = np.full(len(views.camera), -1)
        lidar_rows[columns] = rows
        masses = camera_masses(views.camera)
        camera_rows = np.arange(len(views.camera))
        return assemble(views, lidar_rows, camera_rows, masses, views.camera.scores)


class LidarFirstFusion(UnionFusion):
    """LiDAR's targets; the camera adds box and class where boxes match."""

    def _joined(self, views: Views, rows: np.ndarray, columns: np.ndarray) -> FusedDetections:
        camera_rows = np.full(len(views.lidar), -1)
        camera_rows[rows] = columns
        masses = lidar_masses(views.lidar).copy()
        masses[rows] = camera_masses(views.camera)[columns]
        lidar_rows = np.arange(len(views.lidar))
        return assemble(views, lidar_rows, camera_rows, masses, views.lidar.scores)


def _logit(scores: np.ndarray) -> np.ndarray:
    # Scores of 0 and 1 would be certain; the bounds are chosen by hand.
    bounded = np.clip(scores, 0.01, 0.99)
    result: np.ndarray = np.log(bounded / (1 - bounded))
    return result
