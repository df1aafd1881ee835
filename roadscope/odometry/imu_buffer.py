"""A buffer of the latest inertial samples."""

from __future__ import annotations

import numpy as np

from roadscope.core import ImuSamples, Pose

BUFFER_S = 3.0
"""Samples of at least so many seconds are stored. A stamp that is earlier than the last one by more
means that the clock was reset. Chosen by hand."""
GAP_S = 0.03
"""Samples farther apart than this have a gap between them: 12 periods at 400 Hz, 3 at 100 Hz.
Chosen by hand."""
NO_SAMPLES = "no inertial samples"
BIAS_GAIN = 0.05
"""Share of the difference between gyro and scans by which the gyro's bias is corrected with each
scan. Chosen by hand."""


class ImuBuffer:
    """Stores the finite samples of the last seconds, rotated to the LiDAR's axes.

    stamps_s: (K,) increasing. rates: (K, 3) rad/s. forces: (K, 3) m/s^2, specific force at the
        position of the IMU.
    """

    def __init__(self, lidar_from_imu: Pose | None) -> None:
        self._axes = np.eye(3) if lidar_from_imu is None else lidar_from_imu.rotation
        self.stamps_s = np.empty(0)
        self.rates = np.empty((0, 3))
        self.forces = np.empty((0, 3))
        self._has_samples = False

    def add(self, imu: ImuSamples | None) -> None:
        """Add samples; those that are not later than all earlier ones are left out."""
        if imu is None or not len(imu.stamps_s):
            return
        block = np.column_stack([imu.stamps_s, imu.angular_velocity, imu.specific_force])
        block = block[np.isfinite(block).all(axis=1)]
        last = self.stamps_s[-1] if len(self.stamps_s) else -np.inf
        if len(block) and block[0, 0] < last - BUFFER_S:
            self.clear()
            last = -np.inf
        latest_before = np.maximum.accumulate(np.concatenate([[last], block[:, 0]]))[:-1]
        block = block[block[:, 0] > latest_before]
        self._has_samples |= len(block) > 0
        self.stamps_s = np.concatenate([self.stamps_s, block[:, 0]])
        self.rates = np.concatenate([self.rates, block[:, 1:4] @ self._axes.T])
        self.forces = np.concatenate([self.forces, block[:, 4:] @ self._axes.T])
        self._drop_old()

    def clear(self) -> None:
        """Drop all samples, after a reset of the clock."""
        self.stamps_s, self.rates, self.forces = self.stamps_s[:0], self.rates[:0], self.forces[:0]

    def covers(self, start_s: float, end_s: float) -> bool:
        """Return whether there are samples in the whole interval without a gap."""
        inside = self._between(start_s - GAP_S, end_s + GAP_S)
        stamps = self.stamps_s[inside]
        if not len(stamps):
            return False
        marks = np.concatenate([[start_s], np.clip(stamps, start_s, end_s), [end_s]])
        return bool(np.diff(marks).max() <= GAP_S)

    def missing_samples(self, stamp_s: float, elapsed_s: float) -> str:
        """Return a reason if samples are missing before a stamp, otherwise an empty text.

        If there never were samples, there is no inertial unit, and none are missing.
        """
        covered = not elapsed_s or self.covers(stamp_s - elapsed_s, stamp_s)
        return "" if covered or not self._has_samples else NO_SAMPLES

    def within(self, start_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return time steps, (K,) s, and rates and forces, (K, 3), of an interval.

        Each sample is valid until the next one; the first one from the start. Only for intervals
        that are covered.
        """
        first = max(int(np.searchsorted(self.stamps_s, start_s, side="right")) - 1, 0)
        last = int(np.searchsorted(self.stamps_s, end_s, side="left"))
        rows = slice(first, max(last, first + 1))
        marks = np.concatenate([[start_s], self.stamps_s[rows][1:], [end_s]])
        return np.diff(marks), self.rates[rows], self.forces[rows]

    def mean_rate(self, start_s: float, end_s: float) -> np.ndarray | None:
        """Return the mean turn rate, (3,) rad/s, of an interval; None if it is not covered."""
        if not self.covers(start_s, end_s):
            return None
        lengths, rates, _ = self.within(start_s, end_s)
        mean: np.ndarray = lengths @ rates / lengths.sum()
        return mean

    def _between(self, start_s: float, end_s: float) -> slice:
        low = int(np.searchsorted(self.stamps_s, start_s, side="left"))
        return slice(low, int(np.searchsorted(self.stamps_s, end_s, side="right")))

    def _drop_old(self) -> None:
        if len(self.stamps_s) and self.stamps_s[0] < self.stamps_s[-1] - 2 * BUFFER_S:
            rows = self._between(self.stamps_s[-1] - BUFFER_S, np.inf)
            self.stamps_s, self.rates = self.stamps_s[rows], self.rates[rows]
            self.forces = self.forces[rows]
