"""The returns of a scan in the ego frame: the input of ground removal and clustering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.core.checks import settle_arrays
from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.detectors.sorting import order_by


@dataclass(frozen=True, slots=True, eq=False)
class Cloud(Record):
    """Returns of one scan in the ego frame.

    points: (N, 3) float64, metres, ego frame.
    ring: (N,) int64, beam number, 0 the lowest.
    column: (N,) int64, azimuth step of the sweep.
    rows: (N,) int64, the returns' rows in the scan.
    origin: (2,) float64, metres, position of the sensor in the ego frame.
    """

    points: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    rows: np.ndarray
    origin: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(
            self,
            points=(np.float64, ("N", 3)),
            ring=(np.int64, ("N",)),
            column=(np.int64, ("N",)),
            rows=(np.int64, ("N",)),
            origin=(np.float64, (2,)),
        )

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def of(scan: LidarScan, ego_from_lidar: Pose) -> Cloud:
        """Map a scan into the ego frame.

        Returns are sorted by column, ring and position, so that nothing depends on their order in
        the scan.
        """
        order = _sweep_order(scan)
        points = _in_ego_frame(scan.points, order, ego_from_lidar.matrix)
        origin = ego_from_lidar.translation[:2]
        return Cloud(points, scan.ring[order], scan.column[order], order, origin)

    def select(self, index: np.ndarray) -> Cloud:
        """Return the rows that a mask or an index array selects."""
        rows = np.flatnonzero(index) if index.dtype == np.bool_ else index
        return self._trusted(
            points=self.points[rows],
            ring=self.ring[rows],
            column=self.column[rows],
            rows=self.rows[rows],
        )

    @property
    def ranges(self) -> np.ndarray:
        """(N,) horizontal distance from the sensor in metres."""
        return np.asarray(np.hypot(*(self.points[:, :2] - self.origin).T))

    @property
    def azimuths(self) -> np.ndarray:
        """(N,) direction from the sensor in radians, counter-clockwise from x ahead."""
        x, y = (self.points[:, :2] - self.origin).T
        return np.asarray(np.arctan2(y, x))


def _sweep_order(scan: LidarScan) -> np.ndarray:
    """Return the order by column, ring and position, (N,)."""
    order = order_by(scan.column * (int(scan.ring.max(initial=0)) + 1) + scan.ring)
    ring, column = scan.ring[order], scan.column[order]
    # A beam has one return in a column, unless returns are copies or the sensor reports several.
    if ((ring[1:] == ring[:-1]) & (column[1:] == column[:-1])).any():
        x, y, z = scan.points.T
        order = np.lexsort((z, y, x, scan.ring, scan.column))
    return np.asarray(order)


@compiled()
def _in_ego_frame(points: np.ndarray, order: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return rows of (N, 3) points mapped by a (4, 4) pose, the same bits as `Pose.apply`."""
    mapped = np.empty((len(order), 3))
    for row in range(len(order)):
        point = points[order[row]]
        x, y, z = np.float64(point[0]), np.float64(point[1]), np.float64(point[2])
        for axis in range(3):
            a, b, c = matrix[axis, 0], matrix[axis, 1], matrix[axis, 2]
            mapped[row, axis] = x * a + y * b + z * c + matrix[axis, 3]
    return mapped
