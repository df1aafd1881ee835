"""By how much those followed wander between ticks, as smoothing takes it to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.trackers.existence_kernels import moved_on
from roadscope.trackers.motion import ConstantVelocity

MOTION = ConstantVelocity()


@dataclass(frozen=True, slots=True, eq=False)
class MotionNoise:
    """Of N tracks at one tick, (N, 2, 2) covariances each.

    walks: m2/s3, of how far velocities wander in a second.
    drifts: m2/s, of how far places do beyond that.
    offsets: m2, of the part of errors of places that lasts, which no smoothing lessens.
    """

    walks: np.ndarray
    drifts: np.ndarray
    offsets: np.ndarray

    def __len__(self) -> int:
        return len(self.walks)

    @staticmethod
    def alike(count: int, velocity_walk: float) -> MotionNoise:
        """Take all tracks to wander alike, m/s per root second, and no error to last."""
        none = np.zeros((count, 2, 2))
        return MotionNoise(none + velocity_walk**2 * np.eye(2), none, none)


def carried(
    mean: np.ndarray, covariance: np.ndarray, walk: np.ndarray, drift: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Move a (4,) state x, y, vx, vy and its covariance on by dt seconds at constant velocity.

    walk, drift: (2, 2), as in `MotionNoise`.
    """
    means, spreads = moved_on(mean[None], covariance[None], walk[None], drift[None], float(dt))
    return means[0], spreads[0]
