"""KITTI calibration: how the cameras project, and where the sensors stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.table import FormatError, read_lines, refuse
from roadscope.core import Pose
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

ALIASES = {
    "R_rect": "R0_rect", "Tr_velo_cam": "Tr_velo_to_cam", "Tr_imu_velo": "Tr_imu_to_velo",
}  # fmt: skip
"""How the tracking benchmark spells keys, and how the object benchmark does."""
COUNTS = {
    "P0": 12, "P1": 12, "P2": 12, "P3": 12,
    "R0_rect": 9, "Tr_velo_to_cam": 12, "Tr_imu_to_velo": 12,
}  # fmt: skip
TOLERANCE = 1e-3
LARGEST = 1e9
"""No number of a calibration, pixels or metres, is beyond."""


@dataclass(frozen=True, slots=True, eq=False)
class KittiCalibration(Record):
    """Calibration of one sequence.

    projection: (3, 4) float64, P2, pixels of the left colour camera from metres in the rectified
        camera frame.
    camera_from_imu: the rectified camera from the inertial unit; None when the file lacks it.
    """

    projection: np.ndarray
    camera_from_imu: Pose | None

    def __post_init__(self) -> None:
        settle_arrays(self, projection=(np.float64, (3, 4)))


def read_calibration(path: Path | str) -> KittiCalibration:
    """Read `P2`, and `R0_rect`, `Tr_velo_to_cam`, `Tr_imu_to_velo` where all three are given."""
    path = Path(path)
    found = _matrices(path)
    if "P2" not in found:
        known = ", ".join(found) or "nothing"
        raise FormatError(f"{path}: expected the key P2, got {known}")
    chain = [found.get(key) for key in ("R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo")]
    imu = None
    if all(matrix is not None for matrix in chain):
        camera, velo, unit = (rigid(m) for m in chain if m is not None)
        if camera is None or velo is None or unit is None:
            raise FormatError(f"{path}: expected rotations in R0_rect, Tr_velo_to_cam and "
                              "Tr_imu_to_velo, got other matrices")  # fmt: skip
        imu = camera @ velo @ unit
    return KittiCalibration(found["P2"], imu)


def rigid(matrix: np.ndarray) -> Pose | None:
    """Return the nearest rigid transform to a (3, 3) or (3, 4) matrix; None when none is near.

    Files print seven digits, which leaves rotations a little askew.
    """
    left, stretch, right = np.linalg.svd(matrix[:, :3])
    rotation = left @ right
    if np.abs(stretch - 1).max() > TOLERANCE or np.linalg.det(rotation) < 0:
        return None
    return Pose.from_parts(rotation, matrix[:, 3] if matrix.shape[1] == 4 else np.zeros(3))


def _matrices(path: Path) -> Mapping[str, np.ndarray]:
    found = {}
    for number, line in enumerate(read_lines(path), start=1):
        if not line.strip():
            continue
        key, *texts = line.split()
        key = ALIASES.get(key.rstrip(":"), key.rstrip(":"))
        if key not in COUNTS:
            continue
        if key in found:
            refuse(path, number, f"{key} once", "it again")
        found[key] = _matrix(path, number, key, texts)
    return found


def _matrix(path: Path, line: int, key: str, texts: Sequence[str]) -> np.ndarray:
    """Return (3, 3) or (3, 4) float64; a projection that no camera has is refused."""
    given = " ".join(texts)
    try:
        values = np.array(texts, np.float64)
    except ValueError:
        refuse(path, line, f"{COUNTS[key]} numbers after {key}", given)
    if len(values) != COUNTS[key] or not np.isfinite(values).all():
        refuse(path, line, f"{COUNTS[key]} finite numbers after {key}", given)
    if np.abs(values).max() > LARGEST:
        refuse(path, line, f"numbers from -{LARGEST:g} to {LARGEST:g} after {key}", given)
    matrix = values.reshape(3, -1)
    if key == "P2" and np.linalg.matrix_rank(matrix[:, :3]) < 3:
        refuse(path, line, "a projection after P2, columns 1-3, 5-7, 9-11 of rank 3", given)
    return matrix
