"""The light of faults: the dark, and a sun that stands low ahead."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.envs.imaging.light import Light, night
from roadscope.envs.sensors.faults import Fault

HEADLIGHT_LX = 40.0
"""Of dipped beams on the road where the pictures show a light of 1, some 10 m ahead."""
BESIDE_RAD = 0.1
"""The sun stands within so much of straight ahead."""
FLARES = (1.5, 2.0, 3.0, 4.5, 7.0)
"""How much more stray light than a clean lens a windscreen brings, by severity of the glare."""


def darkness(fault: Fault, rng: np.random.Generator) -> Light:
    """Draw a night as dark as the fault says; the pictures are exposed for what headlights show.

    Of one seed all severities are the same night but for the light of the sky and the gain.
    """
    drawn = night(rng)
    share = fault.figure / HEADLIGHT_LX / float(np.mean(drawn.horizon))
    zenith, horizon, ground = (
        _times(c, share) for c in (drawn.zenith, drawn.horizon, drawn.ground)
    )
    return replace(
        drawn, sun=_times(drawn.sun, min(1.0, share)), zenith=zenith, horizon=horizon,
        ground=ground, gain=1.0, iso=2.0**fault.severity,
    )  # fmt: skip


def dazzling(fault: Fault, light: Light, ahead_rad: float, rng: np.random.Generator) -> Light:
    """Return a light that dazzles: where lamps are lit, by their halos, otherwise by a low sun.

    ahead_rad: heading of the camera, world frame, that the sun stands close to.
    """
    beside = float(rng.uniform(-BESIDE_RAD, BESIDE_RAD))
    flare = FLARES[fault.severity - 1]
    if light.lamps:
        return replace(light, flare=flare)
    elevation = float(np.radians(fault.figure))
    low = max(0.0, 1.0 - elevation / 0.5)
    sun = np.array([0.85, 0.80 - 0.18 * low, 0.70 - 0.38 * low])
    horizon = np.array([0.58, 0.66 - 0.06 * low, 0.74 - 0.18 * low])
    zenith = np.array([0.16, 0.28, 0.52])
    # The camera exposes for what falls on level ground, as it does by any day.
    fallen = float(np.mean(sun)) * np.sin(elevation) + float(np.mean(zenith + horizon)) / 2
    return Light(
        ahead_rad + beside, elevation, _times(sun, 1.0), _times(zenith, 1.0),
        _times(horizon, 1.0), clouds=0.0, gain=min(1.7, 1.1 / fallen), flare=flare,
    )  # fmt: skip


def _times(colour: object, share: float) -> tuple[float, float, float]:
    red, green, blue = (float(v) for v in np.asarray(colour, np.float64) * share)
    return red, green, blue
