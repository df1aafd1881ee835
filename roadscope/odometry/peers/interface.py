"""Interface to a library's odometry: its input and its output."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from roadscope.core import ImuSamples

BOUNDS_M = (1.0, 100.0)
"""Ranges that libraries use; nearer is the own vehicle. 100 m is the default of all of them."""


@dataclass(frozen=True, slots=True, eq=False)
class LibraryScan:
    """A scan as a library gets it.

    points: (N, 3) float64, metres, the LiDAR's frame at each point's own time; all finite.
    after_s: (N,) float64, time of each point after the stamp.
    stamp_s: on a clock that never goes back.
    elapsed_s: since the stamp of the library's previous scan; 0 for its first.
    imu: the samples since then, on the same clock, in the IMU's frame.
    """

    points: np.ndarray
    after_s: np.ndarray
    stamp_s: float
    elapsed_s: float
    imu: ImuSamples

    @property
    def swept(self) -> bool:
        """Whether the points were measured one after the other."""
        return bool(np.ptp(self.after_s) > 0)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A library's pose of the LiDAR: (4, 4) `world_from_lidar`, and its time."""

    world_from_lidar: np.ndarray
    at_s: float


class OdometryLibrary(Protocol):
    """A newly started odometry of a library."""

    def place(self, scan: LibraryScan) -> Placed:
        """Return the pose of a scan; an exception becomes the reason why there is none."""
