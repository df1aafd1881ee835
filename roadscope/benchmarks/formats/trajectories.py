"""Trajectories in files: KITTI odometry's poses and TUM's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import rigid
from roadscope.benchmarks.formats.kitti_poses import POSE_COLUMNS
from roadscope.benchmarks.formats.table import FormatError, read_lines, read_table
from roadscope.core import Pose
from roadscope.core.names import unknown

TrajectoryFormat = Literal["kitti", "tum"]
FORMATS = ("kitti", "tum")
TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
UNIT = 1e-2
"""A quaternion's length may differ by this much from 1: files print few digits."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in the order of their file.

    poses: of a sensor in a frame of the file's choice, axes as the file has them.
    stamps_s: as many, seconds; None where the format has none.
    """

    poses: tuple[Pose, ...]
    stamps_s: tuple[float, ...] | None = None


def read_trajectory(path: Path | str, form: TrajectoryFormat) -> Trajectory:
    """Read a file of poses; what is malformed is refused with its line and what was expected."""
    path = Path(path)
    if form not in FORMATS:
        raise FormatError(unknown("format of trajectories", form, FORMATS))
    return _read_kitti(path) if form == "kitti" else _read_tum(path)


def read_any_trajectory(path: Path) -> Trajectory:
    """Read poses in either format, told apart by how many numbers a line has."""
    lines = (line.split() for line in read_lines(path))
    first = next((words for words in lines if words and not words[0].startswith("#")), [])
    if len(first) not in (len(POSE_COLUMNS), len(TUM_COLUMNS)):
        raise FormatError(
            f"{path}: expected 12 numbers a line (KITTI) or 8 (TUM: stamp tx ty tz qx qy qz qw), "
            f"got {len(first) or 'an empty file'}"
        )
    return read_trajectory(path, "tum" if len(first) == len(TUM_COLUMNS) else "kitti")


def trajectory_text(form: str, poses: Sequence[Pose], stamps_s: Sequence[float]) -> str:
    """Return poses as text: one line each, with all digits.

    kitti: twelve numbers, the upper three rows of the matrix. tum: seconds, place, quaternion.
    """
    if form not in FORMATS:
        raise FormatError(unknown("format of trajectories", form, FORMATS))
    if form == "kitti":
        return "".join(f"{_numbers(pose.matrix[:3].ravel())}\n" for pose in poses)
    return "".join(
        f"{stamp_s:.9f} {_numbers(_tum_row(pose))}\n"
        for pose, stamp_s in zip(poses, stamps_s, strict=True)
    )


def _read_kitti(path: Path) -> Trajectory:
    table = read_table(path, POSE_COLUMNS)
    poses = []
    for row, matrix in enumerate(table.numbers(0, 12).reshape(-1, 3, 4)):
        pose = rigid(matrix)
        if pose is None:
            table.refuse(row, "a rotation in columns 1-3, 5-7, 9-11", " ".join(table.rows[row]))
        poses.append(pose)
    return Trajectory(tuple(poses))


def _read_tum(path: Path) -> Trajectory:
    from scipy.spatial.transform import Rotation

    table = read_table(path, TUM_COLUMNS, comment="#")
    values = table.numbers(0, 8)
    if not len(values):
        return Trajectory((), ())
    lengths = np.linalg.norm(values[:, 4:], axis=1)
    table.require(np.abs(lengths - 1) < UNIT, "a unit quaternion qx qy qz qw", 4, 8)
    later = np.diff(values[:, 0], prepend=-np.inf) > 0
    table.require(later, "a timestamp later than the one before", 0)
    rotations = Rotation.from_quat(values[:, 4:]).as_matrix()
    poses = (Pose.from_parts(r, t) for r, t in zip(rotations, values[:, 1:4], strict=True))
    return Trajectory(tuple(poses), tuple(values[:, 0].tolist()))


def _tum_row(pose: Pose) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)
    return np.concatenate([pose.translation, turn])


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.17g}" for value in values.tolist())
