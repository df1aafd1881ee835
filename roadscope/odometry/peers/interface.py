"""What a library's odometry is given of a scan and what it answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from roadscope.core import ImuSamples

BOUNDS_M = (1.0, 100.0)
"""Ranges that libraries look at; nearer is the own vehicle. 100 m is the default of them all."""


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What a library is given of a scan.

    points: (N, 3) float64, metres, the LiDAR's frame at each point's own time; numbers all.
    after_s: (N,) float64, when each was seen, after the stamp.
    stamp_s: on a clock that never goes back.
    elapsed_s: since the stamp of the scan that the library took last; 0 for its first.
    imu: the samples since then, on the same clock, in the IMU's frame.
    """

    points: np.ndarray
    after_s: np.ndarray
    stamp_s: float
    elapsed_s: float
    imu: ImuSamples

    @property
    def swept(self) -> bool:
        """Whether the points were seen one after the other."""
        return bool(np.ptp(self.after_s) > 0)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Where a library puts the LiDAR: (4, 4) `world_from_lidar`, at which time."""

    world_from_lidar: np.ndarray
    at_s: float


class Library(Protocol):
    """One odometry of a library, started afresh."""

    def place(self, given: Given) -> Placed:
        """Place a scan; whatever is raised is told as the reason why it could not be placed."""
