"""The geometry of a camera without distortion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core import Pose
from roadscope.core.checks import require
from roadscope.core.record import Record

OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Rotates x ahead, y left, z up into z ahead, x right, y down."""


@dataclass(frozen=True, slots=True, eq=False)
class Pinhole(Record):
    """A pinhole camera of width x height pixels.

    focal_px: (2,) focal lengths along columns and rows. centre_px: (2,) principal point. The
        pixel in column c and row r covers c to c + 1 and r to r + 1; its ray goes through the
        middle.
    """

    width: int
    height: int
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]

    def __post_init__(self) -> None:
        require(
            self.width > 0 and self.height > 0,
            self,
            "width",
            "at least one pixel",
            (self.width, self.height),
        )
        require(min(self.focal_px) > 0, self, "focal_px", "positive lengths", self.focal_px)

    @staticmethod
    def centred(width: int, height: int, focal_px: float) -> Pinhole:
        """Return a camera with square pixels and its principal point in the middle of the image."""
        return Pinhole(width, height, (focal_px, focal_px), (width / 2, height / 2))

    @property
    def intrinsics(self) -> np.ndarray:
        """The (3, 3) matrix from camera coordinates to homogeneous pixels."""
        (fx, fy), (cx, cy) = self.focal_px, self.centre_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, points: np.ndarray) -> np.ndarray:
        """Map (N, 3) points of the optical frame, z ahead, to (N, 2) pixels; z must be positive."""
        scaled = points[:, :2] / points[:, 2:]
        pixels: np.ndarray = scaled * self.focal_px + self.centre_px
        return pixels

    def rays(self) -> np.ndarray:
        """Return (H, W, 3) directions of all pixels in the optical frame, z = 1."""
        u = (np.arange(self.width) + 0.5 - self.centre_px[0]) / self.focal_px[0]
        v = (np.arange(self.height) + 0.5 - self.centre_px[1]) / self.focal_px[1]
        return np.stack(np.broadcast_arrays(u[None, :], v[:, None], 1.0), axis=-1)


def mounted(
    x_m: float, y_m: float, z_m: float, *, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0
) -> Pose:
    """Return `ego_from_camera` of a camera that points ahead, turned by ISO 8855 angles."""
    body = Pose.from_euler(x_m, y_m, z_m, yaw=yaw, pitch=pitch, roll=roll)
    return Pose.from_parts(body.rotation @ OPTICAL_FROM_BODY.T, body.translation)
