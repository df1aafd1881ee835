"""Rays through rain and fog."""

from __future__ import annotations

import numpy as np

from roadscope.core import WEATHER
from roadscope.core.jit import compiled
from roadscope.envs.raycast.cast import NOTHING
from roadscope.envs.raycast.depth import Surfaces
from roadscope.envs.raycast.lines import mix
from roadscope.envs.sensors.backscatter import OVERLAP_M, Echoes

STEP = np.uint64(0x9E3779B97F4A7C15)
"""From one random number to the next (Steele, Lea and Flood's SplitMix, 2014)."""


@compiled(borrowing=True)
def cloud_over(
    surfaces: Surfaces, echoes: Echoes, air: tuple[float, float], key: np.uint64
) -> None:
    """Put weather between sensor and surfaces, in place: the strongest return of a ray wins.

    Surfaces lose reflectivity; where an echo wins it takes the ray, with the reflectivity of a
    wall as bright.
    air: extinction per metre, and least power that the receiver reports.
    key: of the sweep; an echo depends on it, beam and column alone.
    """
    ranges, owners, cosines, reflectivity = surfaces
    extinction, least = air
    expected = echoes.tails[-1] if len(echoes.tails) else 0.0
    loudest = np.exp(echoes.log_powers[0]) if len(echoes.tails) else 0.0
    for j in range(ranges.shape[0]):
        for c in range(ranges.shape[1]):
            reach, rivals = np.inf, expected
            if owners[j, c] != NOTHING:
                reach = np.float64(ranges[j, c])
                reflectivity[j, c] *= np.exp(-2.0 * extinction * reach)
                signal = np.float64(reflectivity[j, c]) * np.float64(cosines[j, c])
                power = signal * _gain(reach) if signal >= least * reach * reach else 0.0
                if power > least:
                    rivals = _tail(echoes, np.log(power)) if power < loudest else 0.0
            if rivals <= 0.0:
                continue
            state = mix(key + np.uint64(j * ranges.shape[1] + c) * STEP)
            measured, power = _strongest(echoes, reach, rivals, state)
            if measured > 0.0:
                owners[j, c], ranges[j, c], cosines[j, c] = WEATHER, measured, 1.0
                reflectivity[j, c] = power / _gain(measured)


@compiled(borrowing=True)
def _strongest(
    echoes: Echoes, reach: float, rivals: float, state: np.uint64
) -> tuple[float, float]:
    """Return range and power of the strongest echo before the surface, zeros if there is none.

    rivals: expected number of echoes that are strong enough. The echoes of a Poisson process,
    strongest first, are where its tail passes the sums of exponential paths.
    state: of the ray's own random numbers.
    """
    powers, tails, quantiles = echoes
    passed = 0.0
    while True:
        passed -= np.log(_uniform(mix(state + STEP)))
        if passed >= rivals:
            break
        k = _place(tails, passed)
        share = max(passed - tails[k], 0.0) / (tails[k + 1] - tails[k])
        power = np.exp(powers[k] + share * (powers[k + 1] - powers[k]))
        state += STEP + STEP
        place = _uniform(mix(state)) * (quantiles.shape[1] - 1)
        q = min(int(place), quantiles.shape[1] - 2)
        measured = quantiles[k, q] + (place - q) * (quantiles[k, q + 1] - quantiles[k, q])
        if measured < reach:
            return measured, power
    return 0.0, 0.0


@compiled(borrowing=True)
def _uniform(bits: np.uint64) -> float:
    """Return a number above 0 and up to 1 from 64 random bits."""
    return (np.float64(bits >> np.uint64(11)) + 1.0) * 2.0**-53


@compiled(borrowing=True)
def _place(tails: np.ndarray, passed: float) -> int:
    """Return the last entry, short of the end, at which no more echoes are expected than passed."""
    low, high = 0, len(tails) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if tails[middle] <= passed:
            low = middle
        else:
            high = middle
    return low


@compiled(borrowing=True)
def _tail(echoes: Echoes, log_power: float) -> float:
    """Return the expected number of echoes stronger than a power."""
    powers, tails, _ = echoes
    step = (powers[-1] - powers[0]) / (len(powers) - 1)
    place = (log_power - powers[0]) / step
    k = min(int(place), len(powers) - 2)
    share = min(place - k, 1.0)
    tail: float = tails[k] + share * (tails[k + 1] - tails[k])
    return tail


@compiled(borrowing=True)
def _gain(reach: float) -> float:
    """Power over signal: how much the receiver sees of the beam, over range squared."""
    square = reach * reach
    gain: float = square / (square + OVERLAP_M * OVERLAP_M) ** 2
    return gain
