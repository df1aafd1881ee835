"""Where things lie in the bird's-eye picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose

EGO_FROM_BOTTOM = 0.4


@dataclass(frozen=True)
class View:
    """Maps world coordinates to pixels of a square picture."""

    world_from_ego: Pose
    size_px: int
    metres_per_px: float

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) pixels, x right and y down, of (..., 2) points in metres, world frame."""
        (cos, sin), centre = self.world_from_ego.rotation[:2, 0], self.world_from_ego.translation
        x, y = points[..., 0] - centre[0], points[..., 1] - centre[1]
        ahead, left = x * cos + y * sin, y * cos - x * sin
        placed: np.ndarray = self.home + np.stack([-left, -ahead], axis=-1) / self.metres_per_px
        return placed

    @property
    def home(self) -> np.ndarray:
        """(2,) pixel of the ego's rear axle."""
        return home_px(self.size_px)

    @property
    def radius_m(self) -> float:
        """How far from the ego the picture reaches at most."""
        return self.size_px * self.metres_per_px * 0.8


def home_px(size_px: int) -> np.ndarray:
    """(2,) pixel of the ego's rear axle."""
    return np.array([0.5, 1 - EGO_FROM_BOTTOM]) * size_px


def box_corners(centre: np.ndarray, size: np.ndarray, yaw: float) -> np.ndarray:
    """(4, 2) corners from above: rear right, front right, front left, rear left."""
    ahead = np.array([np.cos(yaw), np.sin(yaw)]) * size[0] / 2
    left = np.array([-np.sin(yaw), np.cos(yaw)]) * size[1] / 2
    offsets = np.stack([-ahead - left, ahead - left, ahead + left, left - ahead])
    corners: np.ndarray = offsets + centre[:2]
    return corners
