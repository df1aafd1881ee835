"""RKO-LIO: points against a map of points, predicted and levelled by the IMU."""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import ClassVar

import numpy as np

from roadscope.core import Pose, Requirement
from roadscope.core.arguments import check_positive
from roadscope.odometry.peers.adapter import OdometryAdapter
from roadscope.odometry.peers.interface import BOUNDS_M, LibraryScan, Placed

EPOCH_S = 1000.0
"""Its clock begins here, because a time of 0 means no time to it."""
NANOSECONDS = 1e9


class RkoLioOdometry(OdometryAdapter):
    """RKO-LIO (Malladi 2025) as its authors ship it, sparse scans thinned once as they advise.

    It deskews to the last point of a scan with the IMU. Its start at rest, which the authors
    advise where a drive begins so, is off unless asked for: most begin at speed.
    """

    requires: ClassVar = Requirement("rko_lio", "pip install roadscope[peers]")
    takes_imu = True

    def __init__(
        self,
        *,
        voxel_m: float = 1.0,
        thin_twice: bool = False,
        starts_at_rest: bool = False,
        deskew: bool = True,
        ground: bool = True,
    ) -> None:
        """Store the settings.

        voxel_m: `voxel_size`. thin_twice: `double_downsample`, better off for 16 rings.
        starts_at_rest: `initialization_phase`: level and biases from the first tenth of a second.
        """
        check_positive(voxel_m=voxel_m)
        settings = {
            "voxel_size": voxel_m,
            "double_downsample": thin_twice,
            "initialization_phase": starts_at_rest,
            "deskew": deskew,
        }
        super().__init__(lambda mounting: _RkoLio(settings, mounting), ground=ground)


class _RkoLio:
    """`rko_lio.lio.LIO` as a library of `OdometryAdapter`; its base is the LiDAR."""

    def __init__(self, settings: dict[str, float], mounting: Pose | None) -> None:
        from rko_lio.config import LIOConfig
        from rko_lio.lio import LIO

        low_m, high_m = BOUNDS_M
        config = LIOConfig(min_range=low_m, max_range=high_m, max_num_threads=1, **settings)
        self._lio = LIO(config)
        self._lidar_from_imu = np.eye(4) if mounting is None else mounting.matrix
        self._deskew, self._scans = config.deskew, 0
        _silence_exit()

    def place(self, scan: LibraryScan) -> Placed:
        times = _nanoseconds(scan.stamp_s + scan.after_s)
        samples = scan.imu
        stamps = _nanoseconds(samples.stamps_s)
        with _silenced():
            for force, rate, stamp in zip(
                samples.specific_force, samples.angular_velocity, stamps, strict=True
            ):
                self._lio.add_imu_measurement(force, rate, stamp, self._lidar_from_imu)
            self._lio.register_scan(scan.points, times)
        # Every scan but the first is brought to its last point.
        self._scans += 1
        late_s = scan.after_s.max() if self._deskew and self._scans > 1 else 0.0
        return Placed(self._lio.pose(), float(scan.stamp_s + late_s))


def _nanoseconds(times_s: np.ndarray) -> np.ndarray:
    whole: np.ndarray = np.rint((times_s + EPOCH_S) * NANOSECONDS).astype(np.int64)
    return whole


@cache
def _silence_exit() -> None:
    """Suppress the timings that the library prints when the process ends."""

    def close() -> None:
        sys.stdout.flush()
        null_device = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null_device, 1)
        os.close(null_device)

    atexit.register(close)


@contextmanager
def _silenced() -> Iterator[None]:
    """Suppress the output of the library's compiled part."""
    saved = os.dup(1), os.dup(2)
    null_device = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(null_device, 1)
        os.dup2(null_device, 2)
        yield
    finally:
        os.dup2(saved[0], 1)
        os.dup2(saved[1], 2)
        for each in (*saved, null_device):
            os.close(each)
