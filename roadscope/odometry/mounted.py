"""An odometry for a LiDAR that need not be mounted with its x axis ahead."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from typing import NamedTuple

import numpy as np

from roadscope.core import (
    ImuSamples,
    LidarScan,
    OdometryEstimate,
    OdometryStatus,
    Pose,
    WheelSamples,
)
from roadscope.odometry import ODOMETRIES
from roadscope.odometry.api import Odometry, update_with_wheels
from roadscope.odometry.estimates import propagated_covariance
from roadscope.odometry.travel import (
    GUESSES_RAD,
    STEPS,
    agreed_direction,
    matched_window,
    turned_back,
    turned_scan,
    window_direction,
)
from roadscope.odometry.voxel_map import VoxelMapOdometry

STRIDE = 6
"""Scans from window to window: half a window."""
WINDOWS = 2
"""Number of consecutive windows that have to agree on the direction. Chosen by hand."""
MOST_SCANS = 40
"""Most scans that are stored until the direction is known; the odometry then begins with the first
of them. Chosen by hand: while a LiDAR drives, its direction is known after fewer scans."""
UNKNOWN = "the direction of travel is not known yet"


class Measured(NamedTuple):
    """A scan with its samples, and the pose that `voxel-map` estimated for it."""

    scan: LidarScan
    imu: ImuSamples | None
    wheels: WheelSamples | None
    rough: OdometryEstimate


class ScanList:
    """Scans in memory."""

    def __init__(self, scans: Sequence[LidarScan]) -> None:
        self._scans = scans

    def __len__(self) -> int:
        return len(self._scans)

    def part(self, first: int, end: int) -> Sequence[LidarScan]:
        """Return the scans from `first` up to but not including `end`."""
        return self._scans[first:end]


class MountedOdometry:
    """Gives scans with x ahead to an odometry, and returns its poses in the LiDAR's own axes.

    Odometries search the first speed along x, and most assume afterwards, too, that x points ahead.
    For another mounting the rotation has to be known, or it is estimated: scans show the direction
    of travel. Until they do, poses are those of `voxel-map` and degraded; then the odometry begins
    with the stored scans.
    """

    def __init__(
        self, *, odometry: str | Odometry = "lidar-inertial", ahead_from_lidar: Pose | None = None
    ) -> None:
        """Store the settings.

        odometry: a spec, or an odometry.
        ahead_from_lidar: transform from the LiDAR's axes to x ahead, y left, z up; only its
            rotation is used. None: z points up, and the direction of travel is estimated; a LiDAR
            that always drives backwards is taken to be mounted backwards.
        """
        self._odometry = ODOMETRIES.make(odometry) if isinstance(odometry, str) else odometry
        self._mounting = None
        if ahead_from_lidar is not None:
            self._mounting = Pose.from_parts(ahead_from_lidar.rotation, np.zeros(3))
        self.reset()

    def reset(self, lidar_from_imu: Pose | None = None) -> None:
        """Clear all state; lidar_from_imu: in the LiDAR's own axes."""
        self._lidar_from_imu = lidar_from_imu
        self._start = _identity()
        self._turn: Pose | None = None
        self._rough = VoxelMapOdometry()
        self._rough.reset(lidar_from_imu)
        self._recent = deque[Measured](maxlen=MOST_SCANS)
        self._directions: list[float | None] = []
        self._count = 0
        self._wheels: WheelSamples | None = None
        if self._mounting is not None:
            self._begin(self._mounting)

    def add_wheels(self, wheels: WheelSamples) -> None:
        """Add speeds ahead for the next scan."""
        self._wheels = wheels

    def update(self, scan: LidarScan, imu: ImuSamples | None = None) -> OdometryEstimate:
        """Return the pose of a scan in the LiDAR's own axes."""
        wheels, self._wheels = self._wheels, None
        if self._turn is not None:
            return self._estimated(scan, imu, wheels, self._turn)
        rough = self._rough.update(scan, imu)
        self._recent.append(Measured(scan, imu, wheels, rough))
        self._count += 1
        if self._count > STEPS and self._count % STRIDE == 0:
            azimuth = self._direction()
            if azimuth is not None:
                return self._begin_with_recent(Pose.from_euler(0, 0, 0, yaw=-azimuth))
        return replace(rough, status=OdometryStatus.DEGRADED, reason=UNKNOWN)

    def _direction(self) -> float | None:
        """Return the azimuth of the direction of travel once windows agree on it."""
        scans = ScanList([each.scan for each in self._recent][-STEPS - 1 :])
        for guess in GUESSES_RAD:
            window = matched_window(scans, 0, guess)
            if window:  # If it has no direction, the LiDAR is slow or stands.
                self._directions.append(window_direction(window))
                break
        else:
            self._directions.append(None)
        last = [each for each in self._directions[-WINDOWS:] if each is not None]
        return agreed_direction(last) if len(last) == WINDOWS else None

    def _begin(self, turn: Pose) -> None:
        self._turn = turn
        mounting = self._lidar_from_imu
        needed = mounting is not None or not np.allclose(turn.matrix, np.eye(4))
        self._odometry.reset(turn @ (mounting or Pose.identity()) if needed else None)

    def _begin_with_recent(self, turn: Pose) -> OdometryEstimate:
        """Begin with the stored scans, the first of which has the pose estimated so far."""
        self._start = self._recent[0].rough
        self._begin(turn)
        recent, self._recent = self._recent, deque(maxlen=0)
        for each in islice(recent, len(recent) - 1):
            self._estimated(each.scan, each.imu, each.wheels, turn)
        last = recent[-1]
        return self._estimated(last.scan, last.imu, last.wheels, turn)

    def _estimated(
        self, scan: LidarScan, imu: ImuSamples | None, wheels: WheelSamples | None, turn: Pose
    ) -> OdometryEstimate:
        """Return the pose that the odometry estimates, from the start on."""
        turned = turned_scan(scan, turn.rotation)
        answer = turned_back(update_with_wheels(self._odometry, turned, imu, wheels), turn)
        before = self._start.start_from_lidar
        motion = answer.start_from_lidar
        covariance = propagated_covariance(self._start.covariance, motion.matrix, answer.covariance)
        return replace(
            answer, start_from_lidar=before @ motion, covariance=(covariance + covariance.T) / 2
        )


def _identity() -> OdometryEstimate:
    """Return the estimate of a start, which is certain."""
    return OdometryEstimate(Pose.identity(), np.zeros((6, 6)), np.zeros(0, bool), 0.0)
