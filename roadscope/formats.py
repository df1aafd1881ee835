"""Files that others write and read: KITTI, MOTChallenge, TUM, PCD, scans and their samples.

Every reader takes a path and refuses what is malformed with a `FormatError` that names file, line,
what was expected and what stands there.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from roadscope.benchmarks.formats.imu_file import read_imu
from roadscope.benchmarks.formats.kitti import KittiSequence
from roadscope.benchmarks.formats.kitti import read_sequence as read_kitti_sequence
from roadscope.benchmarks.formats.kitti_calibration import KittiCalibration
from roadscope.benchmarks.formats.kitti_calibration import (
    read_calibration as read_kitti_calibration,
)
from roadscope.benchmarks.formats.kitti_export import kitti_objects
from roadscope.benchmarks.formats.kitti_export import save_results as write_kitti_results
from roadscope.benchmarks.formats.kitti_folder import KittiFolder
from roadscope.benchmarks.formats.kitti_objects import KittiObjects
from roadscope.benchmarks.formats.kitti_objects import read_detections as read_kitti_detections
from roadscope.benchmarks.formats.kitti_objects import read_labels as read_kitti_labels
from roadscope.benchmarks.formats.kitti_poses import read_oxts as read_kitti_oxts
from roadscope.benchmarks.formats.kitti_poses import read_poses as read_kitti_poses
from roadscope.benchmarks.formats.motchallenge import (
    MotRows,
    MotSequence,
    mot_rows,
    read_mot,
    read_mot_sequence,
)
from roadscope.benchmarks.formats.motchallenge import save_mot as write_mot
from roadscope.benchmarks.formats.pcd import read_pcd
from roadscope.benchmarks.formats.scan_folder import ScanFolder, read_scan
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.formats.trajectories import (
    Trajectory,
    read_trajectory,
    trajectory_text,
)
from roadscope.benchmarks.formats.wheel_file import read_wheels
from roadscope.core import Pose
from roadscope.fusion.calibration import read_calibration, write_calibration

__all__ = [
    "FormatError",
    "KittiCalibration",
    "KittiFolder",
    "KittiObjects",
    "KittiSequence",
    "MotRows",
    "MotSequence",
    "ScanFolder",
    "Trajectory",
    "kitti_objects",
    "mot_rows",
    "read_calibration",
    "read_imu",
    "read_kitti_calibration",
    "read_kitti_detections",
    "read_kitti_labels",
    "read_kitti_oxts",
    "read_kitti_poses",
    "read_kitti_sequence",
    "read_mot",
    "read_mot_sequence",
    "read_pcd",
    "read_scan",
    "read_trajectory",
    "read_wheels",
    "write_calibration",
    "write_kitti_results",
    "write_mot",
    "write_trajectory",
]


def write_trajectory(
    path: Path | str, poses: Sequence[Pose], *, stamps_s: Sequence[float] = (), form: str = "tum"
) -> None:
    """Write poses as text, a line each, with all digits.

    form: `tum`: seconds, place, quaternion (x y z w). `kitti`: the upper three rows of the matrix;
        it has no stamps.
    stamps_s: as many as poses, for `tum`.
    """
    Path(path).write_text(trajectory_text(form, poses, stamps_s), encoding="utf-8")
