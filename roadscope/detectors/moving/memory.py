"""The last second of scans, each with the way from now to then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Frame, LidarScan, Pose
from roadscope.detectors.moving.view import View

AGES_S = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""How far back to look: a slow car needs long to leave its place, a fast one is soon far away."""
SLACK_S = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """An earlier scan, its stamp, and the way from the ego frame now into its own.

    then_from_now: (4, 4) float64.
    """

    view: View
    stamp_s: float
    then_from_now: np.ndarray


class Memory:
    """Keeps what was seen lately, in frames tied together by the estimate of the own motion.

    A frame that brings no estimate is taken as the sensor standing still since the last one:
    so it is with a sensor by the road. On a moving sensor without odometry the roadside then
    appears to move. The first frame of a drive brings none either; its scan is read again when
    the second one says how fast the ego goes.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything seen; the drive's frame, `drive_from_ego`, begins anew."""
        self.now: View | None = None
        self.stamp_s = float("nan")
        self.drive_from_ego = Pose.identity()
        self._kept: list[tuple[float, View, Pose]] = []
        self._first: tuple[LidarScan, Pose] | None = None

    def add(self, frame: Frame) -> None:
        """Take the next frame; its scan becomes `now` (None when it has none)."""
        if frame.stamp_s <= self.stamp_s:
            self.reset()
        motion = frame.previous_from_ego
        twist = _twist(motion, frame.stamp_s - self.stamp_s)
        self._keep(twist)
        self.stamp_s, self.now = frame.stamp_s, None
        if motion is not None:
            self.drive_from_ego = self.drive_from_ego @ motion
        if frame.lidar is not None:
            mount = frame.calibration.pose(frame.lidar.sensor)
            self.now = View.of(frame.lidar, mount, twist)
            self._first = (frame.lidar, mount) if motion is None and not self._kept else None

    def back(self) -> list[Look]:
        """Return the earlier scans nearest to `AGES_S`, the youngest first."""
        ages_s = np.array([self.stamp_s - stamp_s for stamp_s, _, _ in self._kept])
        if not len(ages_s):
            return []
        nearest = [int(np.abs(ages_s - age_s).argmin()) for age_s in AGES_S]
        rows = [r for r, a in zip(nearest, AGES_S, strict=True) if abs(ages_s[r] - a) < SLACK_S]
        if not rows:
            return []
        looks = [self._kept[row] for row in dict.fromkeys(rows)]
        ways = np.linalg.inv([then.matrix for _, _, then in looks]) @ self.drive_from_ego.matrix
        return [Look(v, stamp_s, way) for (stamp_s, v, _), way in zip(looks, ways, strict=True)]

    def _keep(self, twist: np.ndarray) -> None:
        """Put the last scan with the earlier ones, and drop the old."""
        if self.now is None:
            return
        now = self.now if self._first is None else View.of(*self._first, twist)
        self._kept.insert(0, (self.stamp_s, now, self.drive_from_ego))
        oldest_s = self.stamp_s - AGES_S[-1] - SLACK_S
        self._kept = [kept for kept in self._kept if kept[0] >= oldest_s]


def _twist(previous_from_now: Pose | None, elapsed_s: float) -> np.ndarray:
    """Velocity and yaw rate, (3,), of a motion at constant rates."""
    if previous_from_now is None or not elapsed_s > 0:
        return np.zeros(3)
    turn = previous_from_now.yaw
    x, y = previous_from_now.translation[:2]
    cos, sin = np.cos(turn / 2), np.sin(turn / 2)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn]) / elapsed_s
