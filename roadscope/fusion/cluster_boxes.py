"""Boxes around clusters of returns: the LiDAR half of Li 2021 (section 3)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from roadscope.core import Detections, Frame
from roadscope.core.category import CATEGORY_OF_FAMILY
from roadscope.core.checks import require
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.clustering import cluster_dbscan
from roadscope.detectors.drops import without_faint
from roadscope.detectors.ground import GroundSurface, grid_above_ground
from roadscope.fusion.sizes import completed
from roadscope.fusion.weights import lidar_model

LEAST_M = 0.2
"""Least length and width of a box: a cluster of which one face is visible has hardly any depth.
Chosen by hand."""
LEAST_TOP_M = 0.3
"""Least height of a box. Chosen by hand."""
YAWS = np.radians(np.arange(0, 90, 5.0))
"""Headings of the rectangles that are tried, radians."""
LONGEST_M = 20.0
"""Longer clusters are walls, hedges and rails. Chosen by hand."""


class ClusterBoxes:
    """Removes the ground by the height span of cells and clusters the rest by DBSCAN.

    Every cluster gets a box and Dempster-Shafer masses.
    """

    def __init__(
        self,
        *,
        eps_m: float = 0.7,
        min_points: int = 3,
        min_score: float = 0.05,
        faint: float = 0.01,
    ) -> None:
        """Set the detector up.

        eps_m, min_points: of DBSCAN, see `cluster_dbscan`. Li 2021 states no values.
        min_score: detections with a lower score are not reported.
        faint: returns of less intensity than this within 15 m count as drops of fog and are left
            out.
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
        """Return the clusters that may be road users, ego frame, with (N, 4) masses.

        If the frame has no scan, the record is empty and has the frame's stamp; the caller then
        passes None to a fusion.
        """
        if frame.lidar is None:
            return Detections.empty(frame.stamp_s)
        ground, cloud = GroundSurface.levelled(self._cloud(frame))
        shapes, _ = self._boxes(cloud)
        if not len(shapes):
            return Detections.empty(frame.lidar.stamp_s)
        mount = frame.calibration.pose(frame.lidar.sensor).translation[:2]
        masses = lidar_model().probabilities(features(shapes, mount))
        scores = 1.0 - masses[:, 3]
        reported = scores >= self.min_score
        shapes, masses, scores = shapes[reported], masses[reported], scores[reported]
        categories = CATEGORY_OF_FAMILY[masses[:, :3].argmax(axis=1)]
        centres, sizes, yaws = completed(
            shapes[:, :3], shapes[:, 3:6], shapes[:, 6], mount, categories
        )
        centres[:, 2] += ground.below(centres)
        return Detections(
            centres, sizes, yaws, categories, scores, "ego", frame.lidar.stamp_s, masses
        )

    def propose(self, frame: Frame) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the boxes of all clusters, and the returns of each.

        Boxes are (N, 8): x, y, z, length, width, height, yaw, number of returns. Returns are N
        arrays (K, 3). All are in metres and radians, ego frame, z from the ground.
        """
        return self._boxes(GroundSurface.levelled(self._cloud(frame))[1])

    def _cloud(self, frame: Frame) -> Cloud:
        assert frame.lidar is not None
        scan = without_faint(frame.lidar, self.faint)
        return Cloud.of(scan, frame.calibration.pose(scan.sensor))

    def _boxes(self, cloud: Cloud) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return what `propose` returns, of a cloud whose z is the height above the ground."""
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
    """Return the box (8,) of least area around (N, 3) points, see `propose`; its yaw is in `YAWS`.

    points: metres, ego frame, z from the ground.
    """
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
    top = max(float(points[:, 2].max()), LEAST_TOP_M)
    return np.array([x, y, top / 2, length, width, top, yaw, len(points)])


def features(shapes: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the (N, 6) features from which `lidar_model` computes probabilities.

    They are length, width, height of the top and range, in metres, the log of the number of
    returns, and that plus the log of 1 m + range.

    shapes: (N, 8) as from `propose`. origin: (2,) metres, the sensor, ego frame.
    """
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
