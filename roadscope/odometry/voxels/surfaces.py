"""A map of surfaces in voxels."""

from __future__ import annotations

import numpy as np

from roadscope.odometry.voxels.voxel_kernels import copy_near, empty_voxels, insert

SLOTS = 1 << 15
FULL = 0.5
"""Share of slots taken from which the table is cleared of what is far, and grows if need be."""


class VoxelMap:
    """Surfaces in voxels of several sizes, learned from points; what is far is forgotten.

    reach_m: how far from where points were last added, in x and y, the map goes.
    """

    def __init__(self, *, reach_m: float) -> None:
        self.reach_m = reach_m
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.voxels = empty_voxels(SLOTS)

    def __len__(self) -> int:
        return int(self.voxels.used[0])

    def add(self, points: np.ndarray, centre: np.ndarray) -> None:
        """Add (N, 3) points, metres, seen from a place, (3,) metres, of the map's frame."""
        levels = 3
        slots = len(self.voxels.keys)
        if len(self) + levels * len(points) > FULL * slots:
            self._clear_up(centre, levels * len(points))
        insert(self.voxels, points)

    def _clear_up(self, centre: np.ndarray, coming: int) -> None:
        """Drop what is far; the table then has room for as much again."""
        slots = len(self.voxels.keys)
        while True:
            kept = empty_voxels(slots)
            if len(self) <= FULL * slots or slots > len(self.voxels.keys):
                copy_near(self.voxels, kept, centre, self.reach_m)
                if kept.used[0] + coming <= 0.7 * FULL * slots:
                    self.voxels = kept
                    return
            slots *= 2
