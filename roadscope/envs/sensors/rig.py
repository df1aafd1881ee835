"""The sensors of a vehicle and their mounting poses."""

from __future__ import annotations

from dataclasses import dataclass, field

from roadscope.core import Calibration, Pose
from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.sensors.camera_spec import CameraSpec
from roadscope.envs.sensors.ego_motion import BodySway
from roadscope.envs.sensors.imu_spec import ImuSpec
from roadscope.envs.sensors.lidar_spec import LidarSpec
from roadscope.envs.sensors.wheels import DeadReckoning, WheelSpec


@dataclass(frozen=True, slots=True, eq=False)
class LidarMount(Record):
    """A LiDAR on the vehicle.

    name: unique in the rig.
    ego_from_lidar: mounting pose; ego is the rear axle on the ground.
    first_stamp_s: middle of the first sweep; None: the first sweep begins at 0.
    """

    name: str
    spec: LidarSpec
    ego_from_lidar: Pose
    first_stamp_s: float | None = None

    def stamp_s(self, index: int) -> float:
        """Return the stamp of the index-th sweep."""
        first = self.spec.sweep_s / 2 if self.first_stamp_s is None else self.first_stamp_s
        return first + index * self.spec.period_s


@dataclass(frozen=True, slots=True, eq=False)
class CameraMount(Record):
    """A camera on the vehicle.

    name: unique in the rig.
    ego_from_camera: mounting pose of the optical frame, z ahead, x right, y down.
    first_stamp_s: middle of the first exposure.
    """

    name: str
    spec: CameraSpec
    ego_from_camera: Pose
    first_stamp_s: float = 0.02

    def __post_init__(self) -> None:
        least = self.spec.exposure_s / 2
        require(
            self.first_stamp_s >= least,
            self,
            "first_stamp_s",
            f"at least {least} s",
            self.first_stamp_s,
        )

    def stamp_s(self, index: int) -> float:
        """Return the stamp of the index-th image."""
        return self.first_stamp_s + index * self.spec.period_s


@dataclass(frozen=True, slots=True, eq=False)
class ImuMount(Record):
    """An inertial measurement unit on the vehicle.

    name: unique in the rig.
    ego_from_imu: mounting pose.
    """

    name: str
    spec: ImuSpec
    ego_from_imu: Pose


@dataclass(frozen=True, slots=True, eq=False)
class Rig(Record):
    """The sensors of a vehicle; all but the LiDAR are optional.

    sway: pitch and roll of the body with the sensors. None: the body does not sway, and the sensors
        have exactly the recorded poses of the ego. Only a rig with inertial unit or wheels follows
        `EgoMotion` in foreign environments, whose motion jumps, and on uneven ground.
    wheels: sensor of the speed.
    """

    name: str
    lidar: LidarMount
    dead_reckoning: DeadReckoning = field(default_factory=DeadReckoning)
    camera: CameraMount | None = None
    imu: ImuMount | None = None
    wheels: WheelSpec | None = None
    sway: BodySway | None = None

    def __post_init__(self) -> None:
        height = self.lidar.ego_from_lidar.translation[2]
        require(height > 0, self, "lidar", "a sensor above the ground", f"height {height} m")

    @property
    def inertial(self) -> bool:
        """Whether samples or sway depend on the motion of the ego between recorded states."""
        return not (self.imu is None and self.wheels is None and self.sway is None)

    @property
    def memory_s(self) -> float:
        """How long the motion of the ego affects later samples, seconds."""
        swaying = 0.0 if self.sway is None else self.sway.memory_s
        if self.imu is None:
            return swaying
        return swaying + len(self.imu.spec.response()) / self.imu.spec.rate_hz

    def calibration(self) -> Calibration:
        """Return the true mounting poses."""
        poses = [(self.lidar.name, self.lidar.ego_from_lidar)]
        if self.camera is not None:
            poses.append((self.camera.name, self.camera.ego_from_camera))
        if self.imu is not None:
            poses.append((self.imu.name, self.imu.ego_from_imu))
        return Calibration(tuple(poses))
