"""Rain and fog by name, and their extinction of light."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from roadscope.core.checks import require
from roadscope.core.names import unknown

KINDS = ("clear", "rain", "fog")
DEFAULT_SEVERITY = 3
"""Severity of `rain` and `fog` without a number."""
FOG_LIDAR_RATIO_SR = 18.8
RAIN_LIDAR_RATIO_SR = 50.0
"""Default lidar ratios; `fog` and `rain` say where they come from."""


@dataclass(frozen=True, slots=True)
class Weather:
    """The state of the air, the same everywhere.

    kind: one of `KINDS`.
    severity: 1 to 5, 0 for clear air and for your own weather.
    extinction_per_m: share of the light that scatters out of a beam per metre; a return from a
        surface keeps exp(-2 * extinction * range) of its signal (Beer-Lambert).
    lidar_ratio_sr: extinction over backscatter, steradian; backscatter is extinction over it.
    rain_rate_mm_h: determines size and number of the drops; 0 without rain.
    """

    kind: str = "clear"
    severity: int = 0
    extinction_per_m: float = 0.0
    lidar_ratio_sr: float = FOG_LIDAR_RATIO_SR
    rain_rate_mm_h: float = 0.0

    def __post_init__(self) -> None:
        require(self.kind in KINDS, self, "kind", " or ".join(KINDS), self.kind)
        require(self.severity in range(6), self, "severity", "0 to 5", self.severity)
        for name in ("extinction_per_m", "rain_rate_mm_h"):
            value = getattr(self, name)
            expected = self.kind != "clear" if name == "extinction_per_m" else self.kind == "rain"
            sound = 0 < value < np.inf if expected else value == 0
            require(sound, self, name, "above 0" if expected else "0", value)
        ratio = self.lidar_ratio_sr
        require(0 < ratio < np.inf, self, "lidar_ratio_sr", "above 0", ratio)

    @property
    def name(self) -> str:
        """The kind, with the severity if it has one."""
        return f"{self.kind}-{self.severity}" if self.severity else self.kind

    @property
    def summary(self) -> str:
        """One line of figures."""
        if self.kind == "clear":
            return "Nothing in the air."
        alpha = self.extinction_per_m
        amount = (
            f"{self.rain_rate_mm_h:g} mm/h"
            if self.kind == "rain"
            else f"visibility {KOSCHMIEDER / alpha:.0f} m"
        )
        remaining = 100 * np.exp(-2 * alpha * 50)
        return (
            f"{self.kind.capitalize()}, {amount}: {remaining:.2g} % of the signal left from 50 m."
        )


KOSCHMIEDER = 3.912
"""Extinction times visibility: a black object then has a contrast of 2 % to the sky."""


def rain(rate_mm_h: float, severity: int = 0) -> Weather:
    """Return rain of Marshall and Palmer's drops, N(D) = 8000 exp(-4.1 R^-0.21 D) per m3 and mm.

    Drops are far larger than the wavelength, so each extinguishes twice its cross-section. Summed
    over the distribution that is 0.365e-3 R^0.63 per metre, the law of ITU-R P.1814 for Japan (1.58
    R^0.63 dB/km, from memory). The lidar ratio is Mie theory's for spheres of 0.5 to 2 mm at
    905 nm, 36 to 90 sr by our own computation at 4 to 8 mrad from the beam's axis, as with
    lenses a few centimetres apart; on the axis it would be 3 to 6.
    """
    extinction = 1.58e-3 * np.log(10) / 10 * rate_mm_h**0.63
    return Weather("rain", severity, float(extinction), RAIN_LIDAR_RATIO_SR, rate_mm_h)


def fog(visibility_m: float, severity: int = 0) -> Weather:
    """Return fog with a visibility: black objects by day have 2 % contrast at that distance.

    Koschmieder's law gives the extinction of visible light. Droplets of 10 micrometres and more
    have the same extinction in the near infrared; Kim (2001, from memory) has no
    correction for wavelength below 500 m. The lidar ratio is O'Connor's (2004, from memory) for
    droplets of 10 to 50 micrometres at 905 nm; Mie theory gives 18 to 22 sr by our own
    computation.
    """
    return Weather("fog", severity, KOSCHMIEDER / visibility_m)


CLEAR = Weather()

RAIN_MM_H = (2.0, 10.0, 25.0, 50.0, 100.0)
"""Light, moderate, heavy and violent rain, and a cloudburst."""
VISIBILITY_M = (500.0, 200.0, 120.0, 80.0, 50.0)
"""Fog begins below 1000 m, thick fog below 200 m; at 50 m rear fog lamps are lit."""

WEATHERS: Mapping[str, Weather] = MappingProxyType(
    {
        each.name: each
        for each in (
            CLEAR,
            *(rain(rate, n) for n, rate in enumerate(RAIN_MM_H, start=1)),
            *(fog(visibility, n) for n, visibility in enumerate(VISIBILITY_M, start=1)),
        )
    }
)
"""Presets by name; `rain` and `fog` alone are severity 3."""


def weather(name: str | Weather) -> Weather:
    """Return a preset by name, or the weather itself; errors suggest or list the known names."""
    if isinstance(name, Weather):
        return name
    if not isinstance(name, str):
        raise TypeError(f"weather: expected a name or a Weather, got {name!r}")
    preset = WEATHERS.get(f"{name}-{DEFAULT_SEVERITY}" if name in ("rain", "fog") else name)
    if preset is None:
        raise ValueError(unknown("weather", name, [*WEATHERS, "rain", "fog"]))
    return preset
