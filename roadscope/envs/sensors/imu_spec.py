"""What an inertial measurement unit is: rate, noise, biases, limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core.checks import require
from roadscope.core.record import Record

NOISE = (
    "gyro_noise", "gyro_walk", "gyro_turn_on",
    "accelerometer_noise", "accelerometer_walk", "accelerometer_turn_on",
)  # fmt: skip


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
