"""A map of points, from which lines and planes are fitted to the nearest of them."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.cubes import EMPTY
from roadscope.odometry.lego.point_map_kernels import (
    PointGrid,
    grid_insert,
    lines_among,
    planes_among,
)
from roadscope.odometry.loam.pair_kernels import Pairs

SLOTS, POINTS = 1 << 13, 1 << 13


class PointMap:
    """Points in cubes, no two of one cube nearer than a distance.

    thin_m: that distance, metres.
    """

    def __init__(self, *, thin_m: float) -> None:
        if not thin_m > 0:
            raise ValueError(f"thin_m must be above 0, got {thin_m!r}")
        self.thin_m = thin_m
        self.clear()

    def clear(self) -> None:
        """Forget all points."""
        self.grid = _empty(SLOTS, POINTS)

    def __len__(self) -> int:
        return int(self.grid.used[1])

    @property
    def points(self) -> np.ndarray:
        """(M, 3) metres, in the order in which they were added."""
        return self.grid.points[: len(self)]

    def add(self, points: np.ndarray) -> None:
        """Add (N, 3) points, metres, except those that are near others."""
        slots, room = len(self.grid.keys), len(self.grid.points)
        cells, held = self.grid.used
        # A table of which half is taken finds things fast; each point may need a cube of its own.
        if 2 * (cells + len(points)) > slots or held + len(points) > room:
            old = self.points
            while slots < 4 * (cells + len(points)):
                slots *= 2
            while room < 2 * (held + len(points)):
                room *= 2
            self.grid = _empty(slots, room)
            grid_insert(self.grid, old, 0.0)
        grid_insert(self.grid, np.ascontiguousarray(points, float), self.thin_m)

    def lines(self, points: np.ndarray, pose: np.ndarray) -> Pairs:
        """Pair (N, 3) points, sensor frame, with lines of the map; pose: `map_from_sensor`."""
        return lines_among(self.grid, points, pose)

    def planes(self, points: np.ndarray, pose: np.ndarray) -> Pairs:
        """Pair points with planes of the map, likewise."""
        return planes_among(self.grid, points, pose)


def _empty(slots: int, room: int) -> PointGrid:
    return PointGrid(
        np.full(slots, EMPTY, np.int64), np.full(slots, EMPTY, np.int64), np.empty((room, 3)),
        np.empty(room, np.int64), np.zeros(2, np.int64),
    )  # fmt: skip
