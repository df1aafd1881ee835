"""What an inertial measurement unit is: rate, noise, biases, limits; and some on the market."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from roadscope.core.checks import require
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# What an inertial measurement unit is: rate, noise, biases, limits.

NOISE = (
    "gyro_noise",
    "gyro_walk",
    "gyro_turn_on",
    "accelerometer_noise",
    "accelerometer_walk",
    "accelerometer_turn_on",
)


@dataclass(frozen=True, slots=True, eq=False)
class ImuSpec(Record):
    """Three gyroscopes and three accelerometers; all axes are alike and independent.

    rate_hz: samples per second.
    gyro_noise: rad/s/sqrt(Hz), density of the white noise.
    gyro_walk: rad/s^2/sqrt(Hz), density of the noise that the bias sums up.
    gyro_turn_on: rad/s, standard deviation of the bias at the start of an episode.
    accelerometer_noise, accelerometer_walk, accelerometer_turn_on: likewise in m/s^2/sqrt(Hz),
        m/s^3/sqrt(Hz) and m/s^2.
    bandwidth_hz: where a low-pass of first order has taken half the power of motion and noise.
    gyro_range, accelerometer_range: rad/s and m/s^2; what goes beyond reads as the limit.
    """

    name: str
    rate_hz: float
    gyro_noise: float
    gyro_walk: float
    gyro_turn_on: float
    accelerometer_noise: float
    accelerometer_walk: float
    accelerometer_turn_on: float
    bandwidth_hz: float
    gyro_range: float
    accelerometer_range: float

    def __post_init__(self) -> None:
        for name in NOISE:
            value = getattr(self, name)
            require(0 <= value < np.inf, self, name, "a finite value from 0 up", value)
        for name in ("rate_hz", "gyro_range", "accelerometer_range"):
            value = getattr(self, name)
            require(0 < value < np.inf, self, name, "a finite value above 0", value)
        require(self.bandwidth_hz > 0, self, "bandwidth_hz", "above 0", self.bandwidth_hz)

    def scaled(self, factor: float) -> ImuSpec:
        """Return the same with every noise and bias times a factor."""
        return replace(self, **{name: getattr(self, name) * factor for name in NOISE})

    def response(self) -> np.ndarray:
        """(J,) weights of this and earlier samples, newest first, that the low-pass gives."""
        kept = float(np.exp(-2 * np.pi * self.bandwidth_hz / self.rate_hz))
        count = 1 if kept < 1e-6 else min(int(np.ceil(np.log(1e-6) / np.log(kept))), 400)
        weights = kept ** np.arange(count)
        answer: np.ndarray = weights / weights.sum()
        return answer


# --------------------------------------------------------------------------------------------------
# Inertial measurement units, from their makers' documents.

G = 9.80665

IMUS: Mapping[str, ImuSpec] = MappingProxyType(
    {
        # Data sheet: 0.0135 deg/s/sqrt(Hz), 0.23 mg/sqrt(Hz), bias repeatability 0.5 deg/s and
        # 20 mg, 330 Hz, 1000 deg/s, 18 g. Walks: as EuRoC gives them for its unit of this type
        # (Burri 2016), since the sheet states none.
        "adis16448": ImuSpec(
            "adis16448",
            400.0,
            gyro_noise=2.36e-4,
            gyro_walk=1.94e-5,
            gyro_turn_on=float(np.radians(0.5)),
            accelerometer_noise=2.26e-3,
            accelerometer_walk=3.0e-3,
            accelerometer_turn_on=0.02 * G,
            bandwidth_hz=330.0,
            gyro_range=float(np.radians(1000.0)),
            accelerometer_range=18 * G,
        ),
        # Stereolabs' SDK reports 0.007 deg/s/sqrt(Hz), 1.6e-3 m/s^2/sqrt(Hz), walks of 3.4e-5 and
        # 2.5e-4 for a unit at rest and corrected. That the noise is four times as large in a car,
        # and the rest, are assumptions that make this the worse class.
        "zed2": ImuSpec(
            "zed2",
            400.0,
            gyro_noise=4.9e-4,
            gyro_walk=3.4e-5,
            gyro_turn_on=float(np.radians(1.0)),
            accelerometer_noise=6.4e-3,
            accelerometer_walk=3.0e-3,
            accelerometer_turn_on=0.03 * G,
            bandwidth_hz=120.0,
            gyro_range=float(np.radians(1000.0)),
            accelerometer_range=8 * G,
        ),
        "ideal": ImuSpec(
            "ideal",
            400.0,
            gyro_noise=0.0,
            gyro_walk=0.0,
            gyro_turn_on=0.0,
            accelerometer_noise=0.0,
            accelerometer_walk=0.0,
            accelerometer_turn_on=0.0,
            bandwidth_hz=np.inf,
            gyro_range=100.0,
            accelerometer_range=1000.0,
        ),
    }
)
"""Units by name; `ideal` errs in nothing."""
