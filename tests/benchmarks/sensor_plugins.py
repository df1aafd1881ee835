"""An odometry, camera detectors and fusions as users bring them, some of them bad."""

import numpy as np

from roadscope import Detections, ImageDetections, OdometryEstimate, OdometryStatus, Pose
from roadscope.fusion import UnionFusion


class Steady:
    """Goes on at 10 m/s, whatever the scan shows."""

    def __init__(self, *, step_m=1.0):
        self.step_m = step_m

    def reset(self, lidar_from_imu=None):
        self.x = -self.step_m

    def update(self, scan, imu=None):
        self.x += self.step_m
        empty = len(scan) == 0
        return OdometryEstimate(
            start_from_lidar=Pose.planar(self.x, 0.0, 0.0),
            covariance=np.zeros((6, 6)),
            dynamic=np.zeros(len(scan), bool),
            stamp_s=scan.stamp_s,
            status=OdometryStatus.DEGRADED if empty else OdometryStatus.OK,
            reason="no returns" if empty else "",
        )


class OneBox:
    """A camera detector with one box in every image; nothing says its kind."""

    def reset(self): ...

    def detect(self, frame):
        width = float(frame.camera.pixels.shape[1])
        return ImageDetections([[10.0, 10.0, width, 90.0]], [0], [0.9], frame.stamp_s)


class RaisingCamera(OneBox):
    kind = "camera detector"

    def detect(self, frame):
        raise KeyError("what is this")


class SpatialBox:
    """A LiDAR detector that says so."""

    kind = "detector"

    def reset(self): ...

    def detect(self, frame):
        return Detections.empty(frame.stamp_s)


class MyUnion(UnionFusion):
    """A good fusion."""


class NeedsBoth(UnionFusion):
    def fuse(self, lidar, camera, projection):
        assert len(camera.boxes) >= 0
        return super().fuse(lidar, camera, projection)
