"""One scan as later ones look back at it: a range image, and points freed of the own motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.core.record import Record
from roadscope.detectors.moving.view_kernels import Rays, carried, imaged, sensor_at, unskew


@dataclass(frozen=True, slots=True, eq=False)
class View(Record):
    """What a scan saw, and where its rays went.

    points: (N, 3) float64, metres, ego frame at the stamp: each is carried there from its own
        time by the sensor's motion, so what stands still is where it stands.
    times_s: (N,) float64, seconds after the stamp.
    image: (R, C) float32, metres, range of the nearest return by beam and column; nan for none.
    slopes: (R,) float64, increasing, tangent of each beam's elevation.
    azimuth, step: radians of the first column and from column to column, in the lidar frame.
    column_times_s: (C,) float64, seconds after the stamp.
    twist: (3,) float64, velocity in x and y, m/s, and yaw rate, rad/s, of the ego.
    lidar_from_ego: (4, 4) float64.
    """

    points: np.ndarray
    times_s: np.ndarray
    image: np.ndarray
    slopes: np.ndarray
    azimuth: float
    step: float
    column_times_s: np.ndarray
    twist: np.ndarray
    lidar_from_ego: np.ndarray

    @staticmethod
    def of(scan: LidarScan, ego_from_lidar: Pose, twist: np.ndarray) -> View:
        """Take a scan and the own motion during it.

        twist: (3,) velocity in x and y, m/s, and yaw rate, rad/s, of the ego, its own frame.
        """
        times_s = scan.time_offset_s.astype(np.float64)
        points = unskew(carried(scan.points, ego_from_lidar.matrix), times_s, twist)
        lidar_from_ego = inverse_of(ego_from_lidar)
        # A return at the sensor itself has no direction; some drivers put there what never came.
        if not scan.points[:, :2].any():
            image, none = np.empty((0, 0), np.float32), np.empty(0)
            nowhere, never = points[:0], times_s[:0]
            return View(nowhere, never, image, none, 0.0, 0.0, none, twist, lidar_from_ego)
        image, slopes, grid, column_times_s = imaged(scan.points, scan.ring, scan.column, times_s)
        return View(points, times_s, image, slopes, *grid, column_times_s, twist, lidar_from_ego)

    @property
    def rays(self) -> Rays:
        """What kernels ask of a view."""
        return Rays(
            self.image, self.slopes, (self.azimuth, self.step),
            self.column_times_s, self.twist, self.lidar_from_ego,
        )  # fmt: skip

    def origin(self, time_s: float = 0.0) -> np.ndarray:
        """Return where the sensor was some seconds after the stamp.

        (2,) metres, ego frame at the stamp.
        """
        return np.asarray(sensor_at(self.lidar_from_ego, self.twist, time_s))


def inverse_of(pose: Pose) -> np.ndarray:
    """Return the (4, 4) matrix of a pose's inverse."""
    matrix, rotation = np.eye(4), pose.matrix[:3, :3].T
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ pose.matrix[:3, 3]
    return matrix
