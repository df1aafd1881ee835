"""The nearest return in every direction, which may hide a part of a body beyond its outline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Bounds, wrap_angle
from roadscope.core.jit import compiled
from roadscope.detectors.cloud import Cloud
from roadscope.detectors.sorting import order_by, order_within, starts_of

NEARER_M = 0.6
"""A return this much nearer than the end of an outline hides what is beyond the end; three standard
deviations of the LUX's range noise to either side."""


class HorizonArrays(NamedTuple):
    """A `Horizon` for kernels.

    ends: right and left end of the field of view, radians, infinite for a full turn.
    """

    azimuths: np.ndarray
    ranges: np.ndarray
    step: float
    ends: tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """The nearest return above the ground in each column of a scan that has one.

    azimuths: (C,) radians; ranges: (C,) metres of the nearest return above the ground.
    step: radians from column to column.
    view: right and left end of the field of view in radians, None for a full turn.
    origin: (2,) metres, the sensor in the ego frame.
    """

    azimuths: np.ndarray
    ranges: np.ndarray
    step: float
    view: Bounds | None
    origin: np.ndarray

    @staticmethod
    def of(cloud: Cloud, standing: np.ndarray, view: Bounds) -> Horizon:
        """Return the horizon of a scan.

        standing: (N,) mask of returns above the ground.
        view: right and left end of the field of view, radians. If returns lie outside, the field of
            view is taken to be a full turn.
        """
        rows = np.flatnonzero(standing)
        rows = rows[order_by(cloud.column[rows])]
        offsets = cloud.points[rows, :2] - cloud.origin
        ranges = np.hypot(*offsets.T)
        columns = starts_of(cloud.column[rows])
        nearest = order_within(ranges, columns)[columns[:-1]]
        azimuths = np.arctan2(offsets[nearest, 1], offsets[nearest, 0])
        step, limited = _sweep(cloud, view)
        return Horizon(azimuths, ranges[nearest], step, view if limited else None, cloud.origin)

    def hides_beyond(self, point: np.ndarray, side: int) -> bool:
        """Return whether a surface may continue, hidden, beyond a (2,) point.

        It may at an end of the field of view, and next to a nearer return. side: 1 for the left
        of the point, -1 for the right.
        """
        return bool(_hides(point, side, self.origin, self.arrays))

    def hides(self, outline: np.ndarray) -> tuple[bool, bool]:
        """Return `hides_beyond` to the right of the first and to the left of the last point.

        outline: (M, 2) metres, M at least 1.
        """
        right, left = _hides_ends(outline, self.origin, self.arrays)
        return bool(right), bool(left)

    @property
    def arrays(self) -> HorizonArrays:
        """The horizon as a record of arrays for kernels."""
        right, left = self.view or (-np.inf, np.inf)
        return HorizonArrays(self.azimuths, self.ranges, self.step, (right, left))


def _sweep(cloud: Cloud, view: Bounds) -> tuple[float, bool]:
    """Return the radians from column to column, and whether all returns lie inside the view."""
    order = order_by(cloud.column)
    first = cloud.select(order[starts_of(cloud.column[order])[:-1]])
    step = _step(first.azimuths, first.column)
    limit = view.high - (view.low + view.high) / 2 + step
    # One return of each column is usually enough to show a full turn; all are checked otherwise.
    limited = all(_farthest(part, view) <= limit for part in (first, cloud))
    return step, limited


def _farthest(cloud: Cloud, view: Bounds) -> float:
    """Return the greatest angle in radians between a return and the middle of the view."""
    off = np.abs(wrap_angle(cloud.azimuths - (view.low + view.high) / 2))
    return float(off.max(initial=0.0))


def _step(azimuths: np.ndarray, columns: np.ndarray) -> float:
    """Return the radians from column to column, given one return of each column in order."""
    turns = np.abs(wrap_angle(np.diff(azimuths)))
    return float(np.median(turns / np.diff(columns))) if len(turns) else 0.0


@compiled()
def _hides_ends(
    outline: np.ndarray, origin: np.ndarray, horizon: HorizonArrays
) -> tuple[bool, bool]:
    return _hides(outline[0], -1, origin, horizon), _hides(outline[-1], 1, origin, horizon)


@compiled()
def _hides(point: np.ndarray, side: int, origin: np.ndarray, horizon: HorizonArrays) -> bool:
    """Return `Horizon.hides_beyond`: at an end of the view, or next to a nearer return.

    Next to it are returns one or two columns beside the point.
    """
    step, azimuths = horizon.step, horizon.azimuths
    x, y = point[0] - origin[0], point[1] - origin[1]
    azimuth, reach = np.arctan2(y, x), np.hypot(x, y)
    end = horizon.ends[(side + 1) // 2]
    if np.isfinite(end):
        to_end = (end - azimuth + np.pi) % (2 * np.pi) - np.pi
        if abs(to_end) < 1.5 * step:
            return True
    for row in range(len(azimuths)):
        off = abs(azimuths[row] - azimuth)
        # This test has no division, which is slow, and rules out most columns.
        if min(off, 2 * np.pi - off) > 3 * step or horizon.ranges[row] >= reach - NEARER_M:
            continue
        turn = ((azimuths[row] - azimuth + np.pi) % (2 * np.pi) - np.pi) * side
        if 0.5 * step < turn < 2.5 * step:
            return True
    return False
