"""Inertial measurement units, from their makers' documents."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from roadscope.envs.sensors.imu_spec import ImuSpec

G = 9.80665

IMUS: Mapping[str, ImuSpec] = MappingProxyType(
    {
        # Data sheet: 0.0135 deg/s/sqrt(Hz), 0.23 mg/sqrt(Hz), bias repeatability 0.5 deg/s and
        # 20 mg, 330 Hz, 1000 deg/s, 18 g. Walks: as EuRoC gives them for its unit of this type
        # (Burri 2016), since the sheet states none.
        "adis16448": ImuSpec(
            "adis16448", 400.0,
            gyro_noise=2.36e-4, gyro_walk=1.94e-5, gyro_turn_on=float(np.radians(0.5)),
            accelerometer_noise=2.26e-3, accelerometer_walk=3.0e-3,
            accelerometer_turn_on=0.02 * G, bandwidth_hz=330.0,
            gyro_range=float(np.radians(1000.0)), accelerometer_range=18 * G,
        ),
        # Stereolabs' SDK reports 0.007 deg/s/sqrt(Hz), 1.6e-3 m/s^2/sqrt(Hz), walks of 3.4e-5 and
        # 2.5e-4 for a unit at rest and corrected. That the noise is four times as large in a car,
        # and the rest, are assumptions that make this the worse class.
        "zed2": ImuSpec(
            "zed2", 400.0,
            gyro_noise=4.9e-4, gyro_walk=3.4e-5, gyro_turn_on=float(np.radians(1.0)),
            accelerometer_noise=6.4e-3, accelerometer_walk=3.0e-3,
            accelerometer_turn_on=0.03 * G, bandwidth_hz=120.0,
            gyro_range=float(np.radians(1000.0)), accelerometer_range=8 * G,
        ),
        "ideal": ImuSpec(
            "ideal", 400.0,
            gyro_noise=0.0, gyro_walk=0.0, gyro_turn_on=0.0,
            accelerometer_noise=0.0, accelerometer_walk=0.0, accelerometer_turn_on=0.0,
            bandwidth_hz=np.inf, gyro_range=100.0, accelerometer_range=1000.0,
        ),
    }
)  # fmt: skip
"""Units by name; `ideal` errs in nothing."""
