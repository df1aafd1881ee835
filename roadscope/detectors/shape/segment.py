"""Straight pieces of an outline."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Segment:
    """Consecutive outline points that one line represents.

    points: (M, 2) float64, metres, in order along the outline.
    """

    points: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def _centred(self) -> np.ndarray:
        return np.asarray(self.points - self.points.sum(axis=0) / len(self.points))

    @cached_property
    def direction(self) -> np.ndarray:
        """(2,) unit vector of the total least squares line, from first to last point."""
        (xx, xy), (_, yy) = self._centred.T @ self._centred
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        axis = np.array([np.cos(angle), np.sin(angle)])
        return -axis if axis @ (self.points[-1] - self.points[0]) < 0 else axis

    @cached_property
    def length(self) -> float:
        """Extent of the points along the line in metres."""
        along = self._centred @ self.direction
        return float(along.max() - along.min())

    @cached_property
    def residuals(self) -> np.ndarray:
        """(M,) signed distances of the points from the line in metres."""
        x, y = self.direction
        return np.asarray(self._centred @ np.array([-y, x]))

    @property
    def residual_m(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))
