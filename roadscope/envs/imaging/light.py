"""Where the light comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require
from roadscope.core.record import Record

Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Light(Record):
    """Sun and sky, linear RGB; a white wall that faces the sun has a brightness of about 1.

    sun_azimuth, sun_elevation: radians, world frame, where the sun stands.
    sun, zenith, horizon, ground: colours of the sun's light, of the sky overhead and at the
        horizon, and of what the ground throws back.
    clouds: share of the sky that is covered, 0 to 1. A covered sun casts no shadow.
    lamps: whether street lamps, headlights and windows are lit.
    gain: of the camera's exposure.
    """

    sun_azimuth: float = 0.9
    sun_elevation: float = 0.75
    sun: Colour = (0.85, 0.80, 0.70)
    zenith: Colour = (0.16, 0.28, 0.52)
    horizon: Colour = (0.58, 0.66, 0.74)
    ground: Colour = (0.10, 0.10, 0.09)
    clouds: float = 0.3
    lamps: bool = False
    gain: float = 1.15

    def __post_init__(self) -> None:
        require(
            0 < self.sun_elevation <= np.pi / 2, self, "sun_elevation",
            "an angle above the horizon", self.sun_elevation,
        )  # fmt: skip
        require(0 <= self.clouds <= 1, self, "clouds", "a share in 0 to 1", self.clouds)

    @property
    def towards_sun(self) -> np.ndarray:
        """(3,) unit vector towards the sun."""
        flat = np.cos(self.sun_elevation)
        return np.array(
            [
                flat * np.cos(self.sun_azimuth), flat * np.sin(self.sun_azimuth),
                np.sin(self.sun_elevation),
            ]
        )  # fmt: skip


def daylight(rng: np.random.Generator) -> Light:
    """Draw a time of day and a sky between sunny and overcast."""
    elevation = float(rng.uniform(0.2, 1.1))
    clouds = float(rng.beta(0.8, 1.2))
    dull = max(0.0, 2.0 * clouds - 1.0)
    low = max(0.0, 1.0 - elevation / 0.5)
    sun = np.array([0.85, 0.80 - 0.18 * low, 0.70 - 0.38 * low]) * (1.0 - 0.95 * dull)
    grey = np.array([0.55, 0.57, 0.60])
    zenith = (1 - dull) * np.array([0.16, 0.28, 0.52]) + dull * grey
    horizon = (1 - dull) * np.array([0.58, 0.66 - 0.06 * low, 0.74 - 0.18 * low]) + dull * grey
    return Light(
        float(rng.uniform(-np.pi, np.pi)), elevation, _colour(sun), _colour(zenith),
        _colour(horizon), clouds=clouds, gain=float(rng.uniform(0.95, 1.3)),
    )  # fmt: skip


def _colour(values: np.ndarray) -> Colour:
    red, green, blue = (float(v) for v in values)
    return red, green, blue
