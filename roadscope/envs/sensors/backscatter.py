"""What droplets in the air send back to a LiDAR.

Powers are in the units of a wall at normal incidence, reflectivity over range squared. The air at
a range gives pi * backscatter * half the pulse's length instead of a reflectivity, less what the
way there and back takes, and less what the receiver does not see near by (lidar equation, hard
and soft target: Rasshofer 2011, from memory).

Both kinds of weather are a Poisson process of echoes along the ray, which has a rate of echoes
stronger than a power at a range (`echo_rate`). So the strongest echo of a whole ray stays below
a power p with probability exp(-tail(p)), tail(p) being the integral of the rate over range.

Rain: drops come one by one, each with the power of its size. The pulse holds less than one of
those that can be seen, so they do not add up.
Fog: a pulse holds thousands of droplets, which add up to their mean. The receiver takes one
independent sample per pulse length; samples vary by noise and patches.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from roadscope.envs.sensors.weather import Weather

PULSE_M = 0.75
"""Half the way of light in a pulse of 5 ns; assumed for all sensors, as are the next three."""
APERTURE_M, DIVERGENCE_RAD = 0.01, 0.003
"""Width of the beam as it leaves, and by how much it grows per metre."""
OVERLAP_M = 5.0
"""Range at which the receiver sees a quarter of the beam: lenses 3 cm apart, fields of 3 mrad."""
SAMPLES = 16.0
"""Shape of the gamma distribution of a fog sample: it varies by a quarter, as a signal does that
just reaches a limit of four standard deviations of noise."""

DROPS_PER_M3_MM = 8000.0
LARGEST_MM = 8.0
"""Larger drops break up."""

LEAST_POWER = 1e-9
LEAST_TAIL = 1e-8
POWERS, RANGES, QUANTILES = 256, 600, 257


class Echoes(NamedTuple):
    """The strongest echo of a ray, as tables.

    log_powers: (K,) float64, decreasing to the receiver's limit.
    tails: (K,) float64, expected number of echoes stronger than that, increasing.
    quantiles: (K - 1, Q) float64, metres, range of an echo between two powers at Q
        probabilities from 0 to 1.
    """

    log_powers: np.ndarray
    tails: np.ndarray
    quantiles: np.ndarray


def overlap(ranges: np.ndarray) -> np.ndarray:
    """Return which share of the beam the receiver sees, 0 to 1, at ranges in metres."""
    square = ranges**2
    share: np.ndarray = (square / (square + OVERLAP_M**2)) ** 2
    return share


def echo_rate(weather: Weather, powers: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Return echoes per metre of way that are stronger than a power, at a range in metres."""
    gain = overlap(ranges) / ranges**2 * np.exp(-2 * weather.extinction_per_m * ranges)
    if weather.kind == "rain":
        return _drop_rate(weather, powers / gain, ranges)
    if weather.kind == "fog":
        from scipy.special import gammainc

        mean = np.pi * weather.extinction_per_m / weather.lidar_ratio_sr * PULSE_M
        below = gammainc(SAMPLES, SAMPLES * powers / (gain * mean))
        rate: np.ndarray = -np.log(np.maximum(below, 1e-20)) / PULSE_M
        return rate
    return np.zeros(np.broadcast_shapes(powers.shape, ranges.shape))


def _drop_rate(weather: Weather, signal: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Return drops per metre of beam that are brighter than a wall of a reflectivity."""
    area = np.pi / 4 * (APERTURE_M + DIVERGENCE_RAD * ranges) ** 2
    # A drop takes out twice its outline; over the beam's area that is extinction times length.
    square = signal * area * weather.lidar_ratio_sr / np.pi / (np.pi / 2)
    least_mm = np.minimum(1e3 * np.sqrt(square), LARGEST_MM)
    slope = 4.1 * weather.rain_rate_mm_h**-0.21
    drops = np.exp(-slope * least_mm) - np.exp(-slope * LARGEST_MM)
    rate: np.ndarray = DROPS_PER_M3_MM / slope * drops * area
    return rate


@lru_cache(maxsize=32)
def echoes(weather: Weather, near_m: float, far_m: float, least_power: float) -> Echoes:
    """Make the tables for echoes from near to far that are stronger than the receiver's limit."""
    edges = np.geomspace(max(near_m, 0.1), far_m, RANGES + 1)
    widths, middles = np.diff(edges), np.sqrt(edges[1:] * edges[:-1])
    least = max(least_power, LEAST_POWER)

    def rates(powers: np.ndarray) -> np.ndarray:
        return echo_rate(weather, powers[:, None], middles) * widths

    coarse = np.geomspace(max(1.0, 2 * least), least, POWERS)
    heard = np.flatnonzero(rates(coarse).sum(axis=1) > LEAST_TAIL)
    if len(heard) == 0:
        return Echoes(np.empty(0), np.empty(0), np.empty((0, QUANTILES)))
    powers = np.geomspace(coarse[max(heard[0] - 1, 0)], least, POWERS)
    rate = rates(powers)
    between = np.cumsum(np.maximum(np.diff(rate, axis=0), 0) + 1e-300, axis=1)
    shares = np.column_stack([np.zeros(POWERS - 1), between / between[:, -1:]])
    # A ten-thousandth of the echoes, the nearest and farthest, come from a little inside.
    chances = np.linspace(0, 1, QUANTILES).clip(5e-5, 1 - 5e-5)
    quantiles = np.stack([np.interp(chances, share, edges) for share in shares])
    return Echoes(np.log(powers), rate.sum(axis=1), quantiles)
