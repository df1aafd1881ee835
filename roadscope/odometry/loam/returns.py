"""Returns of a scan that may give features."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.odometry.loam.features import Features
from roadscope.odometry.loam.interpolation import deskewed_between
from roadscope.odometry.loam.progress import LEAST_PAIRS


@dataclass(frozen=True, slots=True, eq=False)
class Returns:
    """What is kept of a scan.

    points: (N, 3) float64, metres, lidar frame at each point's own time. ring, column: (N,) int64.
    times_s: (N,) float64, seconds after the stamp. rows: (N,) int64, in the scan.
    labels: (N,) int64, of clusters or kinds; -1 for outliers.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    times_s: np.ndarray
    rows: np.ndarray
    labels: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def at_stamp(self, motion: np.ndarray, since_s: float) -> np.ndarray:
        """Return the (N, 3) points as seen at the stamp, the sweep's own motion taken out.

        motion: (4, 4) `before_from_now` over the time since_s.
        """
        return deskewed_between(self.points, self.times_s, motion, since_s)


def poverty(returns: Returns, features: Features) -> str:
    """Say why a scan cannot tell where it was taken; empty if it may."""
    if features.sharp + features.flat < LEAST_PAIRS:
        return f"{features.sharp + features.flat} features"
    if returns.ring.min() == returns.ring.max():
        return "returns of one ring alone"
    return ""
