"""The nearest return in every direction: what can hide the end of an outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import wrap_angle
from roadscope.detectors.cloud import Cloud

NEARER_M = 0.6
"""What lies this much nearer than an end hides what is beyond it; three standard deviations of
the LUX's range noise to either side."""


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """What stands around the sensor, one entry a column.

    azimuths: (C,) radians; ranges: (C,) metres of the nearest return above the ground.
    step: radians from column to column.
    view: right and left end of the field of view in radians, None for a full turn.
    origin: (2,) metres, the sensor in the ego frame.
    """

    azimuths: np.ndarray
    ranges: np.ndarray
    step: float
    view: tuple[float, float] | None
    origin: np.ndarray

    @staticmethod
    def of(cloud: Cloud, standing: np.ndarray, view: tuple[float, float]) -> Horizon:
        """Look around in a scan.

        standing: (N,) mask of returns above the ground.
        view: right and left end of the field of view; taken for a full turn when returns lie
            outside.
        """
        above = cloud.select(standing)
        order = np.lexsort((above.ranges, above.column))
        first = np.diff(above.column[order], prepend=-1) != 0
        nearest = order[first]
        step = _step(cloud.azimuths, cloud.column)
        middle = (view[0] + view[1]) / 2
        off = np.abs(wrap_angle(cloud.azimuths - middle)).max(initial=0.0)
        limited = off <= view[1] - middle + step
        azimuths, ranges = above.azimuths[nearest], above.ranges[nearest]
        return Horizon(azimuths, ranges, step, view if limited else None, cloud.origin)

    def hides_beyond(self, point: np.ndarray, side: int) -> bool:
        """Whether a surface could go on unseen beyond a (2,) point, to the left (1) or right (-1).

        It could where the field of view ends and where something nearer stands.
        """
        x, y = point - self.origin
        azimuth, reach = np.arctan2(y, x), np.hypot(x, y)
        if self.view is not None:
            left = wrap_angle(self.view[(side + 1) // 2] - azimuth) * side
            if abs(left) < 1.5 * self.step:
                return True
        offsets = wrap_angle(self.azimuths - azimuth) * side
        beside = (offsets > 0.5 * self.step) & (offsets < 2.5 * self.step)
        return bool((self.ranges[beside] < reach - NEARER_M).any())


def _step(azimuths: np.ndarray, columns: np.ndarray) -> float:
    """Radians from column to column, from neighbouring ones."""
    found, first = np.unique(columns, return_index=True)
    apart = np.diff(found)
    turns = np.abs(wrap_angle(np.diff(azimuths[first])))
    return float(np.median(turns / apart)) if len(apart) else 0.0
