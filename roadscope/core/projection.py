"""Projection of points around the ego into the image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.pose import Pose
from roadscope.core.record import Record

NEAR_M = 0.1
"""Points of less depth, and those behind the camera, have no pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class Projection(Record):
    """The matrix A of Li 2021 (eq. 4), from the ego frame.

    matrix: (3, 4) float64, maps homogeneous points of the ego frame, metres, to homogeneous
        pixels; scaled so that the third row gives the depth in metres.
    width, height: of the image in pixels.
    """

    matrix: np.ndarray
    width: int
    height: int

    def __post_init__(self) -> None:
        settle_arrays(self, matrix=(np.float64, (3, 4)))
        block = self.matrix[:, :3]
        singular = np.linalg.svd(block, compute_uv=False)
        require(
            bool(singular[-1] > 1e-9 * singular[0]),
            self,
            "matrix",
            "a left 3 x 3 block that can be inverted",
            self.matrix.tolist(),
        )
        require(
            bool(np.linalg.det(block) > 0),
            self,
            "matrix",
            "a left 3 x 3 block of positive determinant; a negative one mirrors the image",
            self.matrix.tolist(),
        )
        length = np.linalg.norm(self.matrix[2, :3])
        require(bool(abs(length - 1) < 1e-6), self, "matrix", "a third row of unit length", length)
        require(self.width > 0 and self.height > 0, self, "width", "an image", self.width)

    @staticmethod
    def of(intrinsics: np.ndarray, ego_from_camera: Pose, width: int, height: int) -> Projection:
        """Return the projection of a camera with (3, 3) intrinsics and this mounting pose."""
        camera_from_ego = ego_from_camera.inverse().matrix[:3]
        return Projection(np.asarray(intrinsics) @ camera_from_ego, width, height)

    @property
    def height_m(self) -> float:
        """Height of the camera's optical centre above the ground, metres."""
        return float(np.linalg.solve(self.matrix[:, :3], -self.matrix[:, 3])[2])

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (..., 2) pixels and (...) depths in metres of (..., 3) points of the ego frame.

        Where the depth is less than `NEAR_M` or negative, the pixel is meaningless.
        """
        homogeneous = points @ self.matrix[:, :3].T + self.matrix[:, 3]
        depths = homogeneous[..., 2]
        pixels = homogeneous[..., :2] / np.maximum(depths, NEAR_M)[..., None]
        return pixels, depths
