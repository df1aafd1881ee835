"""How far each beam of a scan went, beside which others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.odometry.inertial.edge_kernels import ends, nearest, slim, spacing

WHOLE = 0.97
"""Share of a turn from which on the first column is beside the last."""


@dataclass(frozen=True, slots=True)
class BeamTable:
    """Returns by ring and column: of two in one cell the nearer counts.

    reach: (rings, columns) metres, 0 where nothing came. ring, column: (N,) of each return. first:
    (N,) bool, whether it is the one that counts. step_rad: from column to column, 0 if unknown.
    """

    reach: np.ndarray
    ring: np.ndarray
    column: np.ndarray
    first: np.ndarray
    step_rad: float

    @staticmethod
    def of(points: np.ndarray, ring: np.ndarray, column: np.ndarray) -> BeamTable:
        """Make it of N points; columns that are finer than the sensor's steps are joined."""
        rings, columns = int(ring.max()) + 1, int(column.max()) + 1
        reach, number = nearest(points, ring, column, rings, columns)
        gap, step_rad = spacing(points, number)
        if gap > 1:
            column, step_rad = column // gap, step_rad * gap
            reach, number = nearest(points, ring, column, rings, (columns - 1) // gap + 1)
        first = number[ring, column] == np.arange(len(ring))
        return BeamTable(reach, ring, column, first, step_rad)

    @property
    def closed(self) -> bool:
        """Whether the field goes all around."""
        return bool(self.reach.shape[1] * self.step_rad >= WHOLE * 2 * np.pi)

    def ends(self) -> np.ndarray:
        """Return (N,) bool, which returns are upright ends of things."""
        marks: np.ndarray = ends(self.reach, self.ring, self.column, self.closed) & self.first
        return marks

    def slim(self, asked: np.ndarray, widest_m: float) -> np.ndarray:
        """Return (N,) bool, which of the returns asked for are middles of things no wider."""
        if not self.step_rad:
            return np.zeros(len(asked), bool)
        marks: np.ndarray = slim(self.reach, self.ring, self.column, asked & self.first,
                                 self.closed, widest_m / self.step_rad)  # fmt: skip
        return marks
