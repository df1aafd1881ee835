"""Light of sun and sky: day, dusk, night, overcast."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from roadscope.core.checks import require
from roadscope.core.names import unknown
from roadscope.core.record import Record
from roadscope.envs.world.materials import Colour

GREY = (0.55, 0.57, 0.60)
"""Colour of a closed cloud cover; chosen by hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Light(Record):
    """Sun and sky, linear RGB; a white wall that faces the sun has a brightness of about 1.

    sun_azimuth, sun_elevation: radians, world frame, where the sun (at night the moon) stands.
    sun, zenith, horizon, ground: colours of the sun's light, of the sky overhead and at the
        horizon, and of the light that the ground reflects.
    clouds: share of the sky that is covered, 0 to 1.
    lamps: whether street lamps, headlights and windows are lit.
    flare: stray light of the lens, as a multiple of that of a clean one.
    gain: factor of the camera's exposure. iso: the part of it that is amplification in the sensor,
        which adds noise: white light fills 1 / iso of a pixel's well.
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
    iso: float = 1.0
    flare: float = 1.0

    def __post_init__(self) -> None:
        require(
            0 < self.sun_elevation <= np.pi / 2,
            self,
            "sun_elevation",
            "an angle above the horizon",
            self.sun_elevation,
        )
        require(0 <= self.clouds <= 1, self, "clouds", "a share in 0 to 1", self.clouds)
        require(0 < self.gain < np.inf, self, "gain", "above 0", self.gain)
        require(0 < self.iso < np.inf, self, "iso", "above 0", self.iso)
        require(0 <= self.flare < np.inf, self, "flare", "from 0 up", self.flare)

    @property
    def towards_sun(self) -> np.ndarray:
        """The (3,) unit vector towards the sun, world frame."""
        flat = np.cos(self.sun_elevation)
        return np.array(
            [
                flat * np.cos(self.sun_azimuth),
                flat * np.sin(self.sun_azimuth),
                np.sin(self.sun_elevation),
            ]
        )


class Sky(NamedTuple):
    """Colours of the sun's light, and of the sky overhead and at the horizon, (3,) linear RGB."""

    sun: np.ndarray
    zenith: np.ndarray
    horizon: np.ndarray


def clear_sky(elevation: float) -> Sky:
    """Return a sky without clouds. elevation: of the sun, radians; a low sun is redder."""
    low = max(0.0, 1.0 - elevation / 0.5)
    return Sky(
        np.array([0.85, 0.80 - 0.18 * low, 0.70 - 0.38 * low]),
        np.array([0.16, 0.28, 0.52]),
        np.array([0.58, 0.66 - 0.06 * low, 0.74 - 0.18 * low]),
    )


def exposure_gain(sky: Sky, elevation: float) -> float:
    """Return the gain of a camera that exposes for the light which falls on level ground."""
    from_sky = float(np.mean(sky.zenith + sky.horizon)) / 2
    return float(min(1.7, 1.1 / (float(np.mean(sky.sun)) * np.sin(elevation) + from_sky)))


def daylight(rng: np.random.Generator) -> Light:
    """Draw a time of day and a sky between sunny and overcast."""
    elevation = float(rng.uniform(0.2, 1.1))
    clouds = float(rng.beta(0.8, 1.2))
    dull = max(0.0, 2.0 * clouds - 1.0)
    clear, grey = clear_sky(elevation), np.array(GREY)
    sky = Sky(
        clear.sun * (1.0 - 0.95 * dull),
        (1 - dull) * clear.zenith + dull * grey,
        (1 - dull) * clear.horizon + dull * grey,
    )
    return Light(
        float(rng.uniform(-np.pi, np.pi)),
        elevation,
        colour_of(sky.sun),
        colour_of(sky.zenith),
        colour_of(sky.horizon),
        clouds=clouds,
        gain=exposure_gain(sky, elevation) * float(rng.uniform(0.95, 1.3)),
    )


def overcast(rng: np.random.Generator) -> Light:
    """Draw a closed grey sky with almost no shadows."""
    return Light(
        float(rng.uniform(-np.pi, np.pi)),
        float(rng.uniform(0.3, 1.0)),
        (0.04, 0.04, 0.04),
        GREY,
        (0.60, 0.61, 0.62),
        clouds=1.0,
        gain=float(rng.uniform(1.4, 1.8)),
    )


def dusk(rng: np.random.Generator) -> Light:
    """Draw the light of a low sun or of the minutes after sunset; lamps are lit."""
    late = float(rng.random())
    warm = np.array([0.55, 0.26, 0.10]) * (1 - late)
    zenith = np.array([0.07, 0.10, 0.22]) * (1 - 0.5 * late)
    horizon = np.array([0.46, 0.30, 0.24]) * (1 - 0.5 * late)
    return Light(
        float(rng.uniform(-np.pi, np.pi)),
        float(rng.uniform(0.04, 0.12)),
        colour_of(warm),
        colour_of(zenith),
        colour_of(horizon),
        (0.05, 0.045, 0.04),
        clouds=float(rng.uniform(0.1, 0.6)),
        lamps=True,
        gain=float(rng.uniform(1.3, 1.8)),
        iso=2.0,
    )


def night(rng: np.random.Generator) -> Light:
    """Draw a night under the glow of a town."""
    town = float(rng.uniform(0.5, 1.5))
    return Light(
        float(rng.uniform(-np.pi, np.pi)),
        float(rng.uniform(0.5, 1.2)),
        (0.004, 0.005, 0.007),
        colour_of(town * np.array([0.004, 0.0045, 0.007])),
        colour_of(town * np.array([0.018, 0.015, 0.012])),
        (0.004, 0.004, 0.003),
        clouds=float(rng.uniform(0.0, 0.7)),
        lamps=True,
        gain=float(rng.uniform(0.9, 1.2)),
        iso=8.0,
    )


LIGHTS: Mapping[str, Callable[[np.random.Generator], Light]] = MappingProxyType(
    {"day": daylight, "overcast": overcast, "dusk": dusk, "night": night}
)


def light_named(name: str | Light, rng: np.random.Generator) -> Light:
    """Draw a light of a named kind, or return the light itself; raise `ValueError` otherwise."""
    if isinstance(name, Light):
        return name
    if name not in LIGHTS:
        raise ValueError(unknown("light", str(name), LIGHTS))
    return LIGHTS[name](rng)


def colour_of(values: np.ndarray) -> Colour:
    """Return a (3,) colour as a tuple of floats."""
    red, green, blue = (float(v) for v in values)
    return red, green, blue
