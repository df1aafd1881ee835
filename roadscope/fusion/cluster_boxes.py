"""Boxes around clusters of returns: the LiDAR half of Li 2021 (section 3)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from roadscope.core import Category, Detections, Frame
from roadscope.core.checks import require
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import cluster_dbscan
from roadscope.detectors.drops import without_faint
from roadscope.detectors.ground import GroundSurface, grid_above_ground
from roadscope.fusion.sizes import completed
from roadscope.fusion.weights import lidar_model

LEAST_M = 0.2
"""A cluster seen from one side has no depth; boxes get this much."""
YAWS = np.radians(np.arange(0, 90, 5.0))
LONGEST_M = 20.0
"""Longer clusters are walls, hedges and rails."""
CATEGORY_OF_FAMILY = np.array([Category.CAR, Category.CYCLIST, Category.PEDESTRIAN], np.int8)


class ClusterBoxes:
    """Ground by the height span of cells, DBSCAN, a box and class masses for every cluster."""

    def __init__(
        self,
        *,
        eps_m: float = 0.7,
        min_points: int = 3,
        min_score: float = 0.05,
        faint: float = 0.01,
    ) -> None:
        """Set the detector up.

        eps_m, min_points: of DBSCAN.
        min_score: detections with a lower score are not reported.
        faint: returns within 15 m of lower intensity are taken for drops of fog and left out.
        """
        require(0 < eps_m < np.inf, self, "eps_m", "a positive distance", eps_m)
        require(min_points >= 1, self, "min_points", "at least 1", min_points)
        require(0 <= min_score <= 1, self, "min_score", "a score in 0 to 1", min_score)
        self.eps_m = eps_m
        self.min_points = min_points
        self.min_score = min_score
        self.faint = faint

    def reset(self) -> None:
        """Do nothing: the detector keeps no state."""

    def detect(self, frame: Frame) -> Detections:
        """Return the clusters that may be road users, ego frame, with masses.

        None, at the frame's stamp, where the scan was dropped; a fusion is then given None.
        """
        if frame.lidar is None:
            return Detections.empty(frame.stamp_s)
        cloud = self._cloud(frame)
        ground = GroundSurface.of(cloud)
        shapes, _ = self._boxes(ground.levelled(cloud))
        if not len(shapes):
            return Detections.empty(frame.lidar.stamp_s)
        mount = frame.calibration.pose(frame.lidar.sensor).translation[:2]
        chances = lidar_model().probabilities(features(shapes, mount))
        scores = 1.0 - chances[:, 3]
        reported = scores >= self.min_score
        shapes, chances, scores = shapes[reported], chances[reported], scores[reported]
        categories = CATEGORY_OF_FAMILY[chances[:, :3].argmax(axis=1)]
        centres, sizes, yaws = completed(
            shapes[:, :3], shapes[:, 3:6], shapes[:, 6], mount, categories
        )
        centres[:, 2] += ground.below(centres)
        return Detections(
            centres, sizes, yaws, categories, scores, "ego", frame.lidar.stamp_s, chances
        )

    def propose(self, frame: Frame) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return (N, 8) x, y, z, length, width, height, yaw, returns, and the points of each.

        Heights are those above the ground.
        """
        cloud = self._cloud(frame)
        return self._boxes(GroundSurface.of(cloud).levelled(cloud))

    def _cloud(self, frame: Frame) -> Cloud:
        assert frame.lidar is not None
        scan = without_faint(frame.lidar, self.faint)
        return Cloud.of(scan, frame.calibration.pose(scan.sensor))

    def _boxes(self, cloud: Cloud) -> tuple[np.ndarray, list[np.ndarray]]:
        cloud = cloud.select(grid_above_ground(cloud))
        labels = cluster_dbscan(cloud, eps_m=self.eps_m, min_points=self.min_points)
        shapes, rows = [], []
        for members in _groups(labels):
            shape = enclosing(cloud.points[members])
            if shape[3] <= LONGEST_M:
                shapes.append(shape)
                rows.append(members)
        points = [cloud.points[members] for members in rows]
        return np.array(shapes).reshape(-1, 8), points


def enclosing(points: np.ndarray) -> np.ndarray:
    """(8,) upright rectangle of least area, in steps of 5 degrees, around (N, 3) points."""
    axes = np.stack([np.cos(YAWS), np.sin(YAWS)])
    along = points[:, :2] @ axes
    across = points[:, :2] @ np.stack([-axes[1], axes[0]])
    lengths, widths = np.ptp(along, axis=0), np.ptp(across, axis=0)
    best = int(((lengths + LEAST_M) * (widths + LEAST_M)).argmin())
    yaw, cosine, sine = YAWS[best], axes[0, best], axes[1, best]
    u = (along[:, best].max() + along[:, best].min()) / 2
    v = (across[:, best].max() + across[:, best].min()) / 2
    x, y = u * cosine - v * sine, u * sine + v * cosine
    length, width = max(lengths[best], LEAST_M), max(widths[best], LEAST_M)
    if width > length:
        length, width, yaw = width, length, yaw - np.pi / 2
    top = max(float(points[:, 2].max()), 0.3)
    return np.array([x, y, top / 2, length, width, top, yaw, len(points)])


def features(shapes: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """(N, 6) length, width, top and range in metres, log of returns, log of returns times range."""
    ranges = np.hypot(shapes[:, 0] - origin[0], shapes[:, 1] - origin[1])
    count = np.log(shapes[:, 7])
    return np.column_stack(
        [shapes[:, 3], shapes[:, 4], shapes[:, 5], ranges, count, count + np.log(ranges + 1.0)]
    )


def _groups(labels: np.ndarray) -> Iterator[np.ndarray]:
    order = np.argsort(labels, kind="stable")
    order = order[labels[order] >= 0]
    if len(order):
        yield from np.split(order, np.flatnonzero(np.diff(labels[order])) + 1)
