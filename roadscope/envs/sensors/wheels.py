"""Speed as wheels tell it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from roadscope.core import WheelSamples
from roadscope.core.checks import require
from roadscope.core.record import Record
from roadscope.envs.sensors.ego_motion import EgoMotion


@dataclass(frozen=True, slots=True, eq=False)
class WheelSpec(Record):
    """Speed of the rear axle from its wheels, as an anti-lock braking system reports it.

    The figures are assumptions for a production car: tyre radius changes by about a per cent with
    load, pressure and wear, and a hundred messages a second round to a few cm/s.

    rate_hz: samples per second.
    scale: standard deviation of the relative error, the same through an episode.
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
        """Return the same with every error times a factor."""
        return replace(
            self, scale=self.scale * factor, noise_m_s=self.noise_m_s * factor,
            resolution_m_s=self.resolution_m_s * factor,
        )  # fmt: skip

    def measure(self, motion: EgoMotion, seed: int, first: int, last: int) -> WheelSamples:
        """Return samples number first to last; sample n is taken n periods after 0.

        A wheel that stands still says so: at rest there is no noise.
        """
        numbers = np.arange(first, last + 1)
        true = motion.speeds(numbers / self.rate_hz)
        scale = 1 + self.scale * np.random.default_rng(seed).standard_normal()
        draws = [np.random.default_rng([seed, n + 1]).standard_normal() for n in numbers.tolist()]
        speeds = np.where(np.abs(true) < 1e-6, 0.0, scale * true + self.noise_m_s * np.array(draws))
        if self.resolution_m_s > 0:
            speeds = self.resolution_m_s * np.rint(speeds / self.resolution_m_s)
        return WheelSamples(numbers / self.rate_hz, speeds)
