"""LiDAR scans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record
from roadscope.core.tables import rows_of

FARTHEST_M = 5000.0
"""Farther than any LiDAR on the road measures: refuses numbers that stand for `no return`."""
MOST_RINGS, MOST_COLUMNS = 1024, 1 << 16
RETURN_ARRAYS = ("points", "intensity", "ring", "column", "time_offset_s")
"""Fields with one row for each return."""


@dataclass(frozen=True, slots=True, eq=False)
class LidarScan(Record):
    """The returns of one sweep, in firing order, as measured: not corrected for the ego's motion.

    points: (N, 3) float32, metres, lidar frame at each point's own time; no coordinate beyond
        `FARTHEST_M`.
    intensity: (N,) float32 in 0 to 1.
    ring: (N,) int16, beam number, 0 the lowest, below `MOST_RINGS`.
    column: (N,) int32, azimuth step of the sweep, in firing order, below `MOST_COLUMNS`.
    time_offset_s: (N,) float32, seconds after the stamp, negative before it.
    stamp_s: time since reset at which the truth of the scan is taken, the middle of the sweep.
    sensor: name of the sensor in its rig.
    """

    points: np.ndarray
    intensity: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    time_offset_s: np.ndarray
    stamp_s: float
    sensor: str

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            points=(np.float32, ("N", 3)),
            intensity=(np.float32, ("N",)),
            ring=(np.int16, ("N",)),
            column=(np.int32, ("N",)),
            time_offset_s=(np.float32, ("N",)),
        )
        self._check("points", -FARTHEST_M, FARTHEST_M)
        self._check("ring", 0, MOST_RINGS - 1)
        self._check("column", 0, MOST_COLUMNS - 1)

    def _check(self, name: str, low: float, high: float) -> None:
        values = getattr(self, name)
        least, most = values.min(initial=0).item(), values.max(initial=0).item()
        fits, worst = low <= least and most <= high, least if least < low else most
        require(fits, self, name, f"values from {low:g} to {high:g}", worst)

    def __len__(self) -> int:
        return len(self.points)

    def select(self, index: np.ndarray) -> LidarScan:
        """Return the scan with the returns that a mask or an index array selects."""
        rows = rows_of(index, len(self))
        return self._trusted(**{name: getattr(self, name).take(rows, 0) for name in RETURN_ARRAYS})
