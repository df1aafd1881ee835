"""Frames: what perception gets at one tick of a rig."""

from __future__ import annotations

from dataclasses import dataclass

from roadscope.core.image import CameraImage
from roadscope.core.imu import ImuSamples
from roadscope.core.pose import Pose
from roadscope.core.record import Record
from roadscope.core.scan import LidarScan
from roadscope.core.wheels import WheelSamples


@dataclass(frozen=True, slots=True, eq=False)
class Calibration(Record):
    """The mounting poses of the sensors as the user believes them to be.

    ego_from_sensor: pairs of a sensor's name and its mounting pose.
    """

    ego_from_sensor: tuple[tuple[str, Pose], ...] = ()

    def pose(self, sensor: str) -> Pose:
        """Return `ego_from_sensor` of the named sensor."""
        known = dict(self.ego_from_sensor)
        if sensor not in known:
            raise KeyError(f"no sensor '{sensor}' in the calibration; known: {', '.join(known)}")
        return known[sensor]


@dataclass(frozen=True, slots=True, eq=False)
class Frame(Record):
    """The measurements of one tick; any of them may be missing.

    stamp_s: seconds since reset.
    previous_from_ego: estimate of the ego's motion since the last tick; maps points of the ego
        frame at this tick into the ego frame at the last tick. None without an estimate.
    imu, wheels: samples since the last tick that had samples, up to the end of this tick's scan.
    """

    stamp_s: float
    calibration: Calibration
    lidar: LidarScan | None = None
    camera: CameraImage | None = None
    imu: ImuSamples | None = None
    previous_from_ego: Pose | None = None
    wheels: WheelSamples | None = None
