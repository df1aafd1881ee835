"""Whether an inertial unit stands: nothing changes in what it feels."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.imu_buffer import ImuBuffer
from roadscope.odometry.inertial.filter import InertialNoise

WINDOW_S, BLOCK_S = 1.0, 0.1
UNLIKELY = 3.8
"""Means over blocks may stray so many deviations of the noise from that of the window. Vehicles
that drive are felt more, unless they drive straight at one speed for a second."""
TURNING_RAD_S = 0.05
"""A steadier turn than any gyro's bias is a turn."""


def felt_still(
    samples: ImuBuffer, now_s: float, noise: InertialNoise, window_s: float = WINDOW_S
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return means over the last seconds if nothing changed in them, or None.

    Rate, (3,) rad/s, and force, (3,) m/s^2.
    """
    if not samples.covers(now_s - window_s, now_s):
        return None
    _, rates, forces = samples.within(now_s - window_s, now_s)
    blocks = max(round(window_s / BLOCK_S), 1)
    usable = len(rates) // blocks * blocks
    if not usable:
        return None
    felt = np.hstack([rates, forces])[:usable].reshape(blocks, -1, 6).mean(axis=1)
    mean = felt.mean(axis=0)
    stray = np.abs(felt - mean).max(axis=0)
    most = UNLIKELY / np.sqrt(BLOCK_S)
    quiet = stray[:3].max() < most * noise.rate and stray[3:].max() < most * noise.force
    still = quiet and np.abs(mean[:3]).max() < TURNING_RAD_S
    return (mean[:3], mean[3:]) if still else None
