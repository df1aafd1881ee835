"""Specifications of inertial measurement units: rate, noise, biases, limits; presets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from roadscope.core.checks import require
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Specification.

NOISE = (
    "gyro_noise",
    "gyro_walk",
    "gyro_turn_on",
    "accelerometer_noise",
    "accelerometer_walk",
    "accelerometer_turn_on",
)
"""The fields that `ImuSpec.scaled` multiplies."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuSpec(Record):
    """Three gyroscopes and three accelerometers; all axes are equal and independent.

    rate_hz: samples per second.
    gyro_noise: rad/s/sqrt(Hz), density of the white noise.
    gyro_walk: rad/s^2/sqrt(Hz), density of the noise whose integral is the bias.
    gyro_turn_on: rad/s, standard deviation of the bias at the start of an episode.
    accelerometer_noise, accelerometer_walk, accelerometer_turn_on: the same in m/s^2/sqrt(Hz),
        m/s^3/sqrt(Hz) and m/s^2.
    bandwidth_hz: cut-off (-3 dB) of a first-order low-pass filter of motion and noise.
    gyro_range, accelerometer_range: rad/s and m/s^2; larger values are clipped.
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
        """Return the spec with every noise and bias times a factor."""
        return replace(self, **{name: getattr(self, name) * factor for name in NOISE})

    def response(self) -> np.ndarray:
        """Return the (J,) weights of the low-pass filter, newest sample first."""
        decay = float(np.exp(-2 * np.pi * self.bandwidth_hz / self.rate_hz))
        count = 1 if decay < 1e-6 else min(int(np.ceil(np.log(1e-6) / np.log(decay))), 400)
        weights = decay ** np.arange(count)
        normalised: np.ndarray = weights / weights.sum()
        return normalised


# --------------------------------------------------------------------------------------------------
# Inertial measurement units, from their makers' documents.

STANDARD_GRAVITY_M_S2 = 9.80665
"""Standard gravity (CGPM 1901); in the world frame gravity points down."""

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
            accelerometer_turn_on=0.02 * STANDARD_GRAVITY_M_S2,
            bandwidth_hz=330.0,
            gyro_range=float(np.radians(1000.0)),
            accelerometer_range=18 * STANDARD_GRAVITY_M_S2,
        ),
        # Stereolabs' SDK reports 0.007 deg/s/sqrt(Hz), 1.6e-3 m/s^2/sqrt(Hz), walks of 3.4e-5 and
        # 2.5e-4 for a corrected unit at rest. Only the gyro's walk is taken from there. We assume
        # four times its noise in a car, and all other figures, so that this unit stands for a worse
        # class than the first.
        "zed2": ImuSpec(
            "zed2",
            400.0,
            gyro_noise=4.9e-4,
            gyro_walk=3.4e-5,
            gyro_turn_on=float(np.radians(1.0)),
            accelerometer_noise=6.4e-3,
            accelerometer_walk=3.0e-3,
            accelerometer_turn_on=0.03 * STANDARD_GRAVITY_M_S2,
            bandwidth_hz=120.0,
            gyro_range=float(np.radians(1000.0)),
            accelerometer_range=8 * STANDARD_GRAVITY_M_S2,
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
"""Units by name; `ideal` has no errors."""
