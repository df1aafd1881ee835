"""Measurements of the ego's motion by wheels and a yaw gyro."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np

from roadscope.core import Pose, WheelSamples
from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.sensors.ego_motion import EgoMotion


@lru_cache(maxsize=64)
def _episode_draws(seed: int, count: int) -> tuple[float, ...]:
    """Return standard normal numbers that are the same for all samples of an episode."""
    return tuple(np.random.default_rng(seed).standard_normal(count).tolist())


# --------------------------------------------------------------------------------------------------
# Speed from wheels.


@dataclass(frozen=True, slots=True, eq=False)
class WheelSpec(Record):
    """Speed of the rear axle from its wheels, as an anti-lock braking system reports it.

    The figures are assumptions for a production car: tyre radius changes by about a per cent with
    load, pressure and wear, and messages at 100 Hz are rounded to a few cm/s.

    rate_hz: samples per second.
    scale: standard deviation of the relative error, which is constant in an episode.
    noise_m_s: standard deviation of each sample. resolution_m_s: samples are multiples of it.
    """

    rate_hz: float = 100.0
    scale: float = 0.01
    noise_m_s: float = 0.02
    resolution_m_s: float = 0.015

    def __post_init__(self) -> None:
        require(0 < self.rate_hz < np.inf, self, "rate_hz", "a finite rate above 0", self.rate_hz)
        for name in ("scale", "noise_m_s", "resolution_m_s"):
            value = getattr(self, name)
            require(0 <= value < np.inf, self, name, "a finite value from 0 up", value)

    def scaled(self, factor: float) -> WheelSpec:
        """Return the spec with every error times a factor."""
        return replace(
            self,
            scale=self.scale * factor,
            noise_m_s=self.noise_m_s * factor,
            resolution_m_s=self.resolution_m_s * factor,
        )

    def measure(self, motion: EgoMotion, seed: int, first: int, last: int) -> WheelSamples:
        """Return the samples with numbers from first to last; sample n is taken n periods after 0.

        At rest the samples are exactly 0.
        """
        numbers = np.arange(first, last + 1)
        true = motion.speeds(numbers / self.rate_hz)
        scale = 1 + self.scale * _episode_draws(seed, 1)[0]
        draws = [np.random.default_rng([seed, n + 1]).standard_normal() for n in numbers.tolist()]
        speeds = np.where(np.abs(true) < 1e-6, 0.0, scale * true + self.noise_m_s * np.array(draws))
        if self.resolution_m_s > 0:
            speeds = self.resolution_m_s * np.rint(speeds / self.resolution_m_s)
        return WheelSamples(numbers / self.rate_hz, speeds)


# --------------------------------------------------------------------------------------------------
# Ego motion from tick to tick, from wheels and a yaw gyro.


@dataclass(frozen=True, slots=True, eq=False)
class DeadReckoning(Record):
    """Errors of wheel odometry with a yaw gyro, as standard deviations.

    The figures are assumptions for a production car with stability control, not from a data sheet:
    tyre radius changes by about a per cent with load, pressure and wear. The bias of a consumer
    gyro is measured while the car stands; a few hundredths of a degree per second remain.

    distance_scale: relative error of the distance, constant in an episode.
    gyro_bias_rad_s: error of the yaw rate, constant in an episode.
    gyro_noise_rad_sqrt_s: noise of the yaw rate, radians of heading per square root of a second.
    step_noise_m: error of each tick's displacement along either axis.
    """

    distance_scale: float = 0.01
    gyro_bias_rad_s: float = float(np.radians(0.05))
    gyro_noise_rad_sqrt_s: float = float(np.radians(0.01))
    step_noise_m: float = 0.002

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            require(0 <= value < np.inf, self, name, "a finite value from 0 up", value)

    def scaled(self, factor: float) -> DeadReckoning:
        """Return the spec with every error times a factor."""
        return replace(self, **{f.name: getattr(self, f.name) * factor for f in fields(self)})

    def estimate(self, previous_from_ego: Pose, elapsed_s: float, *, seed: int, index: int) -> Pose:
        """Return the estimated motion during a tick as a planar pose.

        previous_from_ego: the true motion. elapsed_s: duration of the tick.
        Errors that are constant in an episode depend on the seed only, the others on the seed
        and on `index`, the number of the tick.
        """
        scale, bias = _episode_draws(seed, 2)
        along, across, turn = np.random.default_rng([seed, index]).standard_normal(3)
        x, y = previous_from_ego.translation[:2] * (1 + self.distance_scale * scale)
        drift = self.gyro_bias_rad_s * bias * elapsed_s
        wander = self.gyro_noise_rad_sqrt_s * turn * np.sqrt(elapsed_s)
        return Pose.planar(
            x + self.step_noise_m * along,
            y + self.step_noise_m * across,
            previous_from_ego.yaw + drift + wander,
        )
