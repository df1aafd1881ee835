"""A stand-in for the method that Li 2021 compares with: box centres matched by ICP.

Lu, Xu and Li 2017 (its reference 6) join Faster R-CNN's boxes and LiDAR's by an improved ICP. We do
not have that text, so this is the plain form: all camera boxes are shifted together until their
centres lie nearest to the centres of the projected LiDAR boxes, and pairs within a gate are joined.
"""

from __future__ import annotations

import numpy as np

from roadscope.core import Detections, ImageDetections
from roadscope.core.checks import require
from roadscope.core.fused import FusedDetections
from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views
from roadscope.fusion.baselines import ImageFirstFusion

LEAST_WIDTH_PX = 2.0
"""Narrower camera boxes have the gate of this width. Chosen by hand."""
SMALL_STEP_PX = 0.1
"""ICP ends with a shift smaller than this along both axes. Chosen by hand."""


class IcpBoxFusion(ImageFirstFusion):
    """The camera's targets; LiDAR adds position and distance where centres match after ICP."""

    def __init__(self, *, gate: float = 0.5, turns: int = 10) -> None:
        """Set the fusion up; both values are chosen by hand.

        gate: greatest distance between the centres of a pair after ICP, in widths of the camera's
            box. While ICP runs it is twice as wide.
        turns: greatest number of iterations.
        """
        super().__init__()
        require(0 < gate < np.inf, self, "gate", "positive widths", gate)
        require(turns >= 0, self, "turns", "a number from 0 up", turns)
        self.gate = gate
        self.turns = turns

    def fuse(
        self, lidar: Detections | None, camera: ImageDetections | None, projection: Projection
    ) -> FusedDetections:
        """Join both sensors' targets."""
        views = Views.of(lidar, camera, projection)
        if lidar is None or camera is None:
            return self._of_one(views)
        rows = np.flatnonzero(views.in_image)
        boxes = views.camera.boxes
        if not len(rows) or not len(boxes):
            no_pairs = np.empty(0, np.int64)
            return self._joined(views, no_pairs, no_pairs)
        lidar_centres, camera_centres = _centres(views.lidar_boxes[rows]), _centres(boxes)
        gates_px = self.gate * np.maximum(boxes[:, 2] - boxes[:, 0], LEAST_WIDTH_PX)
        shift = np.zeros(2)
        for _ in range(self.turns):
            nearest, distances = _nearest(camera_centres + shift, lidar_centres)
            close = distances < 2 * gates_px
            if not close.any():
                break
            step = (lidar_centres[nearest] - camera_centres - shift)[close].mean(axis=0)
            shift = shift + step
            if np.abs(step).max() < SMALL_STEP_PX:
                break
        nearest, distances = _nearest(camera_centres + shift, lidar_centres)
        columns = np.flatnonzero(distances < gates_px)
        return self._joined(views, rows[nearest[columns]], columns)


def _centres(boxes: np.ndarray) -> np.ndarray:
    middles: np.ndarray = (boxes[:, :2] + boxes[:, 2:]) / 2
    return middles


def _nearest(points: np.ndarray, others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each of (N, 2) points the row and distance of the nearest of (M, 2) others."""
    distances = np.linalg.norm(points[:, None] - others[None], axis=-1)
    rows = distances.argmin(axis=1)
    return rows, distances[np.arange(len(points)), rows]
