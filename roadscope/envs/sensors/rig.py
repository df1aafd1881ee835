"""Which sensors a vehicle carries, and where."""

from __future__ import annotations

from dataclasses import dataclass, field

from roadscope.core import Calibration, Pose
from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.sensors.dead_reckoning import DeadReckoning
from roadscope.envs.sensors.lidar_spec import LidarSpec


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
class Rig(Record):
    """The sensors of a vehicle."""

    name: str
    lidar: LidarMount
    dead_reckoning: DeadReckoning = field(default_factory=DeadReckoning)

    def __post_init__(self) -> None:
        height = self.lidar.ego_from_lidar.translation[2]
        require(height > 0, self, "lidar", "a sensor above the ground", f"height {height} m")

    def calibration(self) -> Calibration:
        """Return the true mounting poses."""
        return Calibration(((self.lidar.name, self.lidar.ego_from_lidar),))
