"""Rigid transforms in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.checks import require, settle_arrays
from roadscope.core.record import Record


@dataclass(frozen=True, slots=True, eq=False)
class Pose(Record):
    """A rigid transform; `a_from_b` maps points of frame b into frame a.

    matrix: (4, 4) float64, rotation and translation in metres.
    """

    matrix: np.ndarray

    def __post_init__(self) -> None:
        settle_arrays(self, matrix=(np.float64, (4, 4)))
        *upper, last = self.matrix.tolist()
        rotation = [row[:3] for row in upper]
        expected = "a rotation in its upper left 3 x 3 block"
        require(_is_rotation(rotation), self, "matrix", expected, rotation)
        require(last == [0, 0, 0, 1], self, "matrix", "a last row of 0 0 0 1", last)

    @staticmethod
    def identity() -> Pose:
        """Return the transform that changes nothing."""
        return Pose(np.eye(4))

    @staticmethod
    def from_parts(rotation: np.ndarray, translation: np.ndarray) -> Pose:
        """Join a (3, 3) rotation and a (3,) translation in metres."""
        matrix = np.eye(4)
        matrix[:3, :3] = rotation
        matrix[:3, 3] = translation
        return Pose(matrix)

    @staticmethod
    def planar(x_m: float, y_m: float, yaw: float, z_m: float = 0.0) -> Pose:
        """Return a level pose; yaw in radians, counter-clockwise."""
        return Pose.from_euler(x_m, y_m, z_m, yaw=yaw)

    @staticmethod
    def from_euler(
        x_m: float,
        y_m: float,
        z_m: float,
        *,
        yaw: float = 0.0,
        pitch: float = 0.0,
        roll: float = 0.0,
    ) -> Pose:
        """Return a pose from ISO 8855 angles in radians, rotating by yaw, then pitch, then roll."""
        cy, sy = np.cos(yaw), np.sin(yaw)
        cp, sp = np.cos(pitch), np.sin(pitch)
        cr, sr = np.cos(roll), np.sin(roll)
        rotation = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        return Pose.from_parts(rotation, np.array([x_m, y_m, z_m]))

    @property
    def rotation(self) -> np.ndarray:
        """The (3, 3) rotation."""
        return self.matrix[:3, :3]

    @property
    def translation(self) -> np.ndarray:
        """The (3,) translation in metres."""
        return self.matrix[:3, 3]

    @property
    def yaw(self) -> float:
        """Heading of the x axis in radians, counter-clockwise."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: `a_from_b @ b_from_c` is `a_from_c`."""
        return Pose(self.matrix @ other.matrix)

    def inverse(self) -> Pose:
        """Return `b_from_a` of `a_from_b`."""
        rotation = self.rotation.T
        return Pose.from_parts(rotation, -rotation @ self.translation)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Map (..., 3) points of frame b into frame a, in float64."""
        # Sums instead of a matrix product: the same bits on every machine, and no threads of a
        # linear algebra library to wait for.
        array = np.asarray(points)
        x, y, z = array[..., 0], array[..., 1], array[..., 2]
        mapped = np.empty(array.shape)
        for axis, (a, b, c) in enumerate(self.rotation):
            mapped[..., axis] = x * a + y * b + z * c + self.translation[axis]
        return mapped

    def interpolate(self, other: Pose, fraction: float) -> Pose:
        """Return the pose at a fraction, 0 to 1, of the motion from this pose to the other.

        Translation and rotation are at constant rates.
        """
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(self.rotation.T @ other.rotation).as_rotvec()
        rotation = self.rotation @ Rotation.from_rotvec(fraction * turn).as_matrix()
        return Pose.from_parts(
            rotation, (1 - fraction) * self.translation + fraction * other.translation
        )


def _is_rotation(rows: list[list[float]]) -> bool:
    """Return whether three rows are a right-handed orthonormal basis, to 1e-6.

    Sums of Python's floats take a quarter of the time of NumPy's products of small matrices.
    """
    (a, b, c), (d, e, f), (g, h, i) = rows
    lengths = a * a + b * b + c * c, d * d + e * e + f * f, g * g + h * h + i * i
    products = a * d + b * e + c * f, a * g + b * h + c * i, d * g + e * h + f * i
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    errors = *(length - 1 for length in lengths), *products
    return determinant > 0 and all(abs(error) < 1e-6 for error in errors)


def wrap_angle(angle: np.ndarray | float) -> np.ndarray:
    """Return angles, radians, plus the multiples of 2 pi that bring them into [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi
