"""Inertial and wheel-speed samples of a vehicle's motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Frame, ImuSamples, WheelSamples
from roadscope.envs.sensors.ego_motion import EgoMotion
from roadscope.envs.sensors.imu_spec import STANDARD_GRAVITY_M_S2, ImuSpec
from roadscope.envs.sensors.rig import ImuMount, LidarMount, Rig

# --------------------------------------------------------------------------------------------------
# Noise and biases of inertial samples; they do not depend on the order of requests.

PAGE = 1024
"""Number of samples that are drawn at once."""


class ImuNoise:
    """White noise and random-walk biases of the six axes, gyroscopes first.

    Everything depends only on the seed and the numbers of the samples.
    """

    def __init__(self, spec: ImuSpec, seed: int) -> None:
        """Draw the turn-on biases."""
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
        """Return (N, 6) noise of samples first to last, rad/s and m/s^2; numbers start at 0."""
        return self._collect(0, first, last)

    def biases(self, first: int, last: int) -> np.ndarray:
        """Return (N, 6) biases of samples first to last, rad/s and m/s^2."""
        return self._collect(1, first, last)

    def _collect(self, kind: int, first: int, last: int) -> np.ndarray:
        begin = first // PAGE
        pages = [self._page(number)[kind] for number in range(begin, last // PAGE + 1)]
        return np.concatenate(pages)[first - begin * PAGE : last + 1 - begin * PAGE]

    def _page(self, number: int) -> tuple[np.ndarray, np.ndarray]:
        """Return white noise and biases of a page, (PAGE, 6) each."""
        for missing in range(len(self._starts) - 1, number):
            self._draw_page(missing)
        if number not in self._pages:
            self._draw_page(number)
        return self._pages[number]

    def _draw_page(self, number: int) -> None:
        """Draw a page whose bias at the start is known, and store that of the next page."""
        # A seed with 0 appended gives the same numbers as the seed alone, hence number + 1.
        draws = np.random.default_rng([self._seed, number + 1]).standard_normal((2, PAGE, 6))
        ends = self._starts[number] + np.cumsum(self._step * draws[1], axis=0)
        if number + 1 == len(self._starts):
            self._starts.append(ends[-1])
        if len(self._pages) > 4:
            self._pages.clear()
        self._pages[number] = self._white * draws[0], ends


# --------------------------------------------------------------------------------------------------
# Inertial samples of a vehicle's motion.


def measure(
    motion: EgoMotion, mount: ImuMount, noise: ImuNoise, first: int, last: int
) -> ImuSamples:
    """Return samples number first to last; sample n is taken n periods after 0.

    The unit's low-pass filter delays them slightly.
    """
    spec = mount.spec
    weights = spec.response()
    numbers = np.arange(first - len(weights) + 1, last + 1)
    values = true_samples(motion, mount, numbers / spec.rate_hz)
    drawn = np.maximum(numbers, 0)
    values = values + noise.white(int(drawn[0]), int(drawn[-1]))[drawn - drawn[0]]
    filtered = np.zeros((last - first + 1, 6))
    for lag, weight in enumerate(weights):
        end = len(values) - lag
        filtered += weight * values[end - len(filtered) : end]
    filtered += noise.biases(first, last)
    gyro = np.clip(filtered[:, :3], -spec.gyro_range, spec.gyro_range)
    force = np.clip(filtered[:, 3:], -spec.accelerometer_range, spec.accelerometer_range)
    return ImuSamples(np.arange(first, last + 1) / spec.rate_hz, gyro, force)


def true_samples(motion: EgoMotion, mount: ImuMount, stamps_s: np.ndarray) -> np.ndarray:
    """Return (T, 6) true angular velocity (rad/s) and specific force (m/s^2), frame `imu`."""
    here = motion.at(stamps_s, mount.ego_from_imu.translation)
    ego_from_imu = mount.ego_from_imu.rotation
    gravity = np.array([0.0, 0.0, -STANDARD_GRAVITY_M_S2])
    force = np.einsum("tji,tj->ti", here.rotations @ ego_from_imu, here.accelerations - gravity)
    turn = np.einsum("ji,tj->ti", ego_from_imu, here.angular_velocities)
    return np.concatenate([turn, force], axis=1)


# --------------------------------------------------------------------------------------------------
# Inertial and wheel samples of each sweep, every sample exactly once.


class InertialSampler:
    """Adds the samples since the end of the previous sweep to the frame of a sweep."""

    def __init__(self, rig: Rig, seed: int) -> None:
        """Draw the biases; the random numbers of the LiDAR do not depend on these."""
        *_, imu, wheels = np.random.SeedSequence(seed).generate_state(8)
        self._wheel_seed = int(wheels)
        self._noise = None if rig.imu is None else ImuNoise(rig.imu.spec, int(imu))

    def with_samples(self, frame: Frame, rig: Rig, motion: EgoMotion, index: int) -> Frame:
        """Return the frame of the index-th sweep with its inertial and wheel samples."""
        samples: dict[str, ImuSamples | WheelSamples] = {}
        if rig.imu is not None and self._noise is not None:
            span = samples_of(rig.lidar, index, rig.imu.spec.rate_hz)
            samples["imu"] = measure(motion, rig.imu, self._noise, *span)
        if rig.wheels is not None:
            span = samples_of(rig.lidar, index, rig.wheels.rate_hz)
            samples["wheels"] = rig.wheels.measure(motion, self._wheel_seed, *span)
        return replace(frame, **samples)  # type: ignore[arg-type]


def samples_of(mount: LidarMount, index: int, rate_hz: float) -> tuple[int, int]:
    """Return the numbers of the first and the last sample of a sweep.

    They lie after the end of the previous sweep, up to the end of this one; the first sweep also
    has a sample at its beginning. There are no samples before 0.
    """
    end_s = mount.stamp_s(index) + mount.spec.sweep_s / 2
    before_s = end_s - mount.spec.period_s
    if index > 0:
        before_s = mount.stamp_s(index - 1) + mount.spec.sweep_s / 2
    first = _number(before_s, rate_hz) + (1 if index > 0 else 0)
    return max(first, 0), _number(end_s, rate_hz)


def _number(stamp_s: float, rate_hz: float) -> int:
    """Return the number of the last sample up to a stamp, with a tolerance for rounding."""
    return int(np.floor(stamp_s * rate_hz + 1e-6))
