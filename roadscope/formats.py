"""Files of others: KITTI, MOTChallenge, TUM, PCD, scans, and samples of IMU and wheels.

Every reader takes a path. A malformed file raises `FormatError`, which names the file, the line,
what was expected and what was found.
"""

from __future__ import annotations

from roadscope.benchmarks.formats.kitti_calibration import (
    KittiCalibration,
    read_kitti_calibration,
    read_kitti_oxts,
    read_kitti_poses,
)
from roadscope.benchmarks.formats.kitti_frames import kitti_objects
from roadscope.benchmarks.formats.kitti_labels import (
    KittiObjects,
    KittiType,
    read_kitti_detections,
    read_kitti_labels,
    write_kitti_results,
)
from roadscope.benchmarks.formats.kitti_sequence import (
    KittiFolder,
    KittiSequence,
    read_kitti_sequence,
)
from roadscope.benchmarks.formats.motchallenge import (
    MotRows,
    MotSequence,
    mot_rows,
    read_mot,
    read_mot_sequence,
    write_mot,
)
from roadscope.benchmarks.formats.pcd import read_pcd
from roadscope.benchmarks.formats.point_layout import scan_of_points
from roadscope.benchmarks.formats.samples import read_imu, read_wheels
from roadscope.benchmarks.formats.scan_folder import ScanFolder, read_scan
from roadscope.benchmarks.formats.table import FormatError
from roadscope.benchmarks.formats.tracking_rows import FrameLimit, ImageSize
from roadscope.benchmarks.formats.trajectories import Trajectory, read_trajectory, write_trajectory
from roadscope.fusion.calibration import read_calibration, write_calibration

__all__ = [
    "FormatError",
    "FrameLimit",
    "ImageSize",
    "KittiCalibration",
    "KittiFolder",
    "KittiObjects",
    "KittiSequence",
    "KittiType",
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
    "scan_of_points",
    "write_calibration",
    "write_kitti_results",
    "write_mot",
    "write_trajectory",
]
