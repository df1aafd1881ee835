"""Which LiDAR and camera detections are one target: bearing, size and depth must agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.projection import Projection
from roadscope.fusion.assembly import Views
from roadscope.fusion.depth import depths_of
from roadscope.fusion.masses import families_of

NEVER = 1e6
GATE = 14.0
"""Greatest cost of a pair; a chi-square of three terms exceeds it in 0.3 %."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """How well each pair agrees.

    cost: (N, M) sum of squared deviations in standard deviations, `NEVER` where out of sight.
    depth: (N, M) those of depth alone. lidar_depths: (N,) metres, of centres
        along the optical axis, 0.5 at least.
    log_depths, spreads: (M,) of the camera's boxes.
    """

    cost: np.ndarray
    depth: np.ndarray
    lidar_depths: np.ndarray
    log_depths: np.ndarray
    spreads: np.ndarray

    @staticmethod
    def of(views: Views, projection: Projection) -> Agreement:
        """Compare all pairs."""
        ours, theirs = views.lidar_boxes, views.camera.boxes
        logs, spreads = depths_of(theirs, views.camera.categories, projection)
        _, middle = projection.project(views.lidar.centres)
        depths = np.maximum(middle, 0.5)
        wide = np.maximum(theirs[:, 2] - theirs[:, 0], 2.0)
        tolerance = np.hypot(0.12 * wide, 2.0)
        # An edge that the image cuts says nothing; both are cut at the same place.
        ends = (ours[:, None, [0, 2]] - theirs[None][..., [0, 2]]) / tolerance[None, :, None]
        middle_off = ends.mean(axis=-1)
        size_off = (ends[..., 1] - ends[..., 0]) / 2
        # A cluster may show a part of a vehicle, or hold a person and what stands beside.
        size_off = size_off / 2.5
        depth_off = (np.log(depths)[:, None] - logs) / np.hypot(spreads, 0.08)[None]
        cost = middle_off**2 + np.minimum(size_off**2, 9.0) + depth_off**2
        differs = families_of(views.lidar.categories)[:, None] != families_of(
            views.camera.categories
        )
        cost = cost + 2.0 * differs
        cost[~views.in_image] = NEVER
        return Agreement(cost, depth_off**2, depths, logs, spreads)

    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows of LiDAR and camera, one to one, of least total cost below the gate."""
        from scipy.optimize import linear_sum_assignment

        gain = np.minimum(self.cost - GATE, 0.0)
        rows, columns = linear_sum_assignment(gain)
        kept = self.cost[rows, columns] < GATE
        return rows[kept], columns[kept]
