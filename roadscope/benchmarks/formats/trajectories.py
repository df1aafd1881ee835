"""Trajectories in text files: the poses of KITTI odometry and of the TUM benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import POSE_COLUMNS, poses_of_rows
from roadscope.benchmarks.formats.table import FormatError, read_lines, read_table
from roadscope.core import Pose
from roadscope.core.names import unknown

TrajectoryFormat = Literal["kitti", "tum"]
FORMATS = ("kitti", "tum")
TUM_COLUMNS = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
MAX_LENGTH_ERROR = 1e-2
"""The length of a quaternion may differ from 1 by less, because files print few digits. Chosen by
hand."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses in the order of their file.

    poses: of the sensor in the file's own frame, with the file's own axes.
    stamps_s: seconds, one per pose; None if the format has no stamps.
    """

    poses: tuple[Pose, ...]
    stamps_s: tuple[float, ...] | None = None


def read_trajectory(path: Path | str, form: TrajectoryFormat) -> Trajectory:
    """Read a file of poses.

    form: `tum`: stamp, position and quaternion per line. `kitti`: a 3 x 4 matrix per line.
    """
    _check_format(form)
    return _read_kitti(Path(path)) if form == "kitti" else _read_tum(Path(path))


def read_any_trajectory(path: Path) -> Trajectory:
    """Read poses in either format; the number of columns of the first line decides which."""
    lines = (line.split() for line in read_lines(path))
    first = next((words for words in lines if words and not words[0].startswith("#")), [])
    if len(first) not in (len(POSE_COLUMNS), len(TUM_COLUMNS)):
        actual = f"{len(first)} numbers" if first else "an empty file"
        raise FormatError(
            f"{path}: expected 12 numbers a line (KITTI) or 8 (TUM: stamp tx ty tz qx qy qz qw), "
            f"got {actual}"
        )
    return read_trajectory(path, "tum" if len(first) == len(TUM_COLUMNS) else "kitti")


def write_trajectory(
    path: Path | str, poses: Sequence[Pose], *, stamps_s: Sequence[float] = (), form: str = "tum"
) -> None:
    """Write poses as text, one line each, with all digits.

    form: `tum`: seconds, position, quaternion (x y z w). `kitti`: the upper three rows of the
        matrix, without stamps.
    stamps_s: one per pose, for `tum`.
    """
    Path(path).write_text(trajectory_text(form, poses, stamps_s), encoding="utf-8")


def trajectory_text(form: str, poses: Sequence[Pose], stamps_s: Sequence[float]) -> str:
    """Return poses as text, see `write_trajectory`."""
    _check_format(form)
    if form == "kitti":
        return "".join(f"{_number_text(pose.matrix[:3].ravel())}\n" for pose in poses)
    return "".join(
        f"{stamp_s:.9f} {_number_text(_tum_numbers(pose))}\n"
        for pose, stamp_s in zip(poses, stamps_s, strict=True)
    )


def _check_format(form: str) -> None:
    if form not in FORMATS:
        raise FormatError(unknown("format of trajectories", form, FORMATS))


def _read_kitti(path: Path) -> Trajectory:
    table = read_table(path, POSE_COLUMNS)
    return Trajectory(tuple(poses_of_rows(table, table.numbers(0, 12))))


def _read_tum(path: Path) -> Trajectory:
    from scipy.spatial.transform import Rotation

    table = read_table(path, TUM_COLUMNS, comment="#")
    values = table.numbers(0, 8)
    if not len(values):
        return Trajectory((), ())
    lengths = np.linalg.norm(values[:, 4:], axis=1)
    is_unit = np.abs(lengths - 1) < MAX_LENGTH_ERROR
    table.require(is_unit, "a quaternion qx qy qz qw of length 1", 4, 8)
    rises = np.diff(values[:, 0], prepend=-np.inf) > 0
    table.require(rises, "a timestamp later than the one before", 0)
    rotations = Rotation.from_quat(values[:, 4:]).as_matrix()
    poses = (Pose.from_parts(r, t) for r, t in zip(rotations, values[:, 1:4], strict=True))
    return Trajectory(tuple(poses), tuple(values[:, 0].tolist()))


def _tum_numbers(pose: Pose) -> np.ndarray:
    """Return (7,) position and quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    quaternion = Rotation.from_matrix(pose.rotation).as_quat(canonical=True)
    return np.concatenate([pose.translation, quaternion])


def _number_text(numbers: np.ndarray) -> str:
    return " ".join(f"{number:.17g}" for number in numbers.tolist())
