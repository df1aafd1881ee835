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
    """An earlier scan, its stamp, and `then_from_now`: from the ego frame now into its own."""

    view: View
    stamp_s: float
    then_from_now: Pose


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
        """Forget everything seen."""
        self.now: View | None = None
        self.stamp_s = float("nan")
        self._from_now = Pose.identity()
        self._looks: list[Look] = []
        self._first: tuple[LidarScan, Pose] | None = None
        self._tick_s = float("nan")

    def add(self, frame: Frame) -> None:
        """Take the next frame; its scan becomes `now` (None when it has none)."""
        if frame.stamp_s <= self._tick_s:
            self.reset()
        motion = frame.previous_from_ego
        twist = _twist(motion, frame.stamp_s - self._tick_s)
        self._age(motion or Pose.identity(), twist)
        self._tick_s, self.now = frame.stamp_s, None
        if frame.lidar is None:
            return
        mount = frame.calibration.pose(frame.lidar.sensor)
        if not self._looks and motion is None:
            self._first = frame.lidar, mount
        self.now, self.stamp_s = View.of(frame.lidar, mount, twist), frame.lidar.stamp_s

    def back(self) -> list[Look]:
        """Return the earlier scans nearest to `AGES_S`, the youngest first."""
        found: list[Look] = []
        for age_s in AGES_S:
            near = [k for k in self._looks if abs(self.stamp_s - k.stamp_s - age_s) < SLACK_S]
            best = min(near, key=lambda k: abs(self.stamp_s - k.stamp_s - age_s), default=None)
            if best is not None and best not in found:
                found.append(best)
        return found

    def _age(self, previous_from_now: Pose, twist: np.ndarray) -> None:
        """Put the last scan with the earlier ones and lengthen everyone's way from now."""
        if self._first is not None and self._looks == [] and self.now is not None:
            self.now = View.of(*self._first, twist)
        self._first = None
        if self.now is not None:
            self._looks.insert(0, Look(self.now, self.stamp_s, Pose.identity()))
        oldest_s = self.stamp_s - AGES_S[-1] - SLACK_S
        self._looks = [
            Look(k.view, k.stamp_s, k.then_from_now @ previous_from_now)
            for k in self._looks
            if k.stamp_s >= oldest_s
        ]


def _twist(previous_from_now: Pose | None, elapsed_s: float) -> np.ndarray:
    """Velocity and yaw rate, (3,), of a motion at constant rates."""
    if previous_from_now is None or not elapsed_s > 0:
        return np.zeros(3)
    turn = previous_from_now.yaw
    x, y = previous_from_now.translation[:2]
    cos, sin = np.cos(turn / 2), np.sin(turn / 2)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn]) / elapsed_s
