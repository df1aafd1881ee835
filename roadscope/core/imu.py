"""Samples of an inertial measurement unit (IMU)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class ImuSamples(Record):
    """A block of inertial samples.

    stamps_s: (K,) float64, seconds since reset.
    angular_velocity: (K, 3) float64, rad/s, imu frame.
    specific_force: (K, 3) float64, m/s^2, imu frame; a resting level sensor reads +g on z.
    """

    stamps_s: np.ndarray
    angular_velocity: np.ndarray
    specific_force: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            stamps_s=(np.float64, ("K",)),
            angular_velocity=(np.float64, ("K", 3)),
            specific_force=(np.float64, ("K", 3)),
        )
