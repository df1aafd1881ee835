"""What inertial unit and wheels bring with each sweep, every sample exactly once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core import Frame
from roadscope.envs.sensors.ego_motion import EgoMotion
from roadscope.envs.sensors.imu import measure
from roadscope.envs.sensors.imu_noise import ImuNoise
from roadscope.envs.sensors.rig import LidarMount, Rig


class Inertial:
    """Adds to the frame of a sweep the samples since the end of the sweep before."""

    def __init__(self, rig: Rig, seed: int) -> None:
        """Draw biases; what the LiDAR draws stays as it is without an inertial unit."""
        *_, imu, wheels = np.random.SeedSequence(seed).generate_state(8)
        self._wheel_seed = int(wheels)
        self._noise = None if rig.imu is None else ImuNoise(rig.imu.spec, int(imu))

    def beside(self, frame: Frame, rig: Rig, motion: EgoMotion, index: int) -> Frame:
        """Return the frame of the index-th sweep with what a rig has of its samples."""
        if rig.imu is not None and self._noise is not None:
            span = samples_of(rig.lidar, index, rig.imu.spec.rate_hz)
            frame = replace(frame, imu=measure(motion, rig.imu, self._noise, *span))
        if rig.wheels is not None:
            span = samples_of(rig.lidar, index, rig.wheels.rate_hz)
            frame = replace(frame, wheels=rig.wheels.measure(motion, self._wheel_seed, *span))
        return frame


def samples_of(mount: LidarMount, index: int, rate_hz: float) -> tuple[int, int]:
    """Return numbers of the first and the last sample that come with a sweep.

    Those after the end of the sweep before, up to the end of this one; with the first sweep also
    one at its very beginning. None is taken before 0.
    """
    end_s = mount.stamp_s(index) + mount.spec.sweep_s / 2
    before_s = end_s - mount.spec.period_s
    if index > 0:
        before_s = mount.stamp_s(index - 1) + mount.spec.sweep_s / 2
    first = _number(before_s, rate_hz) + (1 if index > 0 else 0)
    return max(first, 0), _number(end_s, rate_hz)


def _number(stamp_s: float, rate_hz: float) -> int:
    """Return the last sample up to a stamp; rounding of stamps is forgiven."""
    return int(np.floor(stamp_s * rate_hz + 1e-6))
