"""Noise and biases of inertial samples, the same in whatever pieces they are asked for."""

from __future__ import annotations

import numpy as np

from roadscope.envs.sensors.imu_spec import ImuSpec

PAGE = 1024
"""Samples that are drawn at once."""


class ImuNoise:
    """White noise and wandering biases of the six axes, gyroscopes first.

    All depends on the seed and the numbers of the samples alone; drawing goes on where it ended.
    """

    def __init__(self, spec: ImuSpec, seed: int) -> None:
        """Draw the biases at turning on."""
        self._seed = seed
        rate = spec.rate_hz
        gyro, force = np.ones(3), np.ones(3)
        self._white = np.sqrt(rate) * np.append(
            spec.gyro_noise * gyro, spec.accelerometer_noise * force
        )
        self._step = np.append(spec.gyro_walk * gyro, spec.accelerometer_walk * force) / rate**0.5
        turn_on = np.append(spec.gyro_turn_on * gyro, spec.accelerometer_turn_on * force)
        self._starts = [turn_on * np.random.default_rng(seed).standard_normal(6)]
        self._pages: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def white(self, first: int, last: int) -> np.ndarray:
        """(N, 6) noise of samples first to last, in rad/s and m/s^2; none has a number below 0."""
        return self._collect(0, first, last)

    def biases(self, first: int, last: int) -> np.ndarray:
        """(N, 6) biases of samples first to last, in rad/s and m/s^2."""
        return self._collect(1, first, last)

    def _collect(self, kind: int, first: int, last: int) -> np.ndarray:
        begin = first // PAGE
        pages = [self._page(number)[kind] for number in range(begin, last // PAGE + 1)]
        return np.concatenate(pages)[first - begin * PAGE : last + 1 - begin * PAGE]

    def _page(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """White noise and biases of a page, (PAGE, 6) each."""
        for missing in range(len(self._starts) - 1, number):
            self._draw(missing)
        if number not in self._pages:
            self._draw(number)
        return self._pages[number]

    def _draw(self, number: int) -> None:
        """Draw a page whose start is known, and with it the start of the next."""
        # Of seed and 0 come the same numbers as of the seed alone.
        draws = np.random.default_rng([self._seed, number + 1]).standard_normal((2, PAGE, 6))
        ends = self._starts[number] + np.cumsum(self._step * draws[1], axis=0)
        if number + 1 == len(self._starts):
            self._starts.append(ends[-1])
        if len(self._pages) > 4:
            self._pages.clear()
        self._pages[number] = self._white * draws[0], ends
