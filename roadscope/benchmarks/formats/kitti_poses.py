"""Where the vehicle was: camera poses, or the inertial unit's records (OXTS)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import KittiCalibration, rigid
from roadscope.benchmarks.formats.kitti_frames import CAMERA_FROM_EGO, EGO_FROM_CAMERA
from roadscope.benchmarks.formats.kitti_objects import MAX_ANGLE_RAD
from roadscope.benchmarks.formats.table import FormatError, read_table
from roadscope.core import Pose

POSE_COLUMNS = tuple(f"r{i}{j}" if j < 3 else f"t{i}" for i in range(3) for j in range(4))
OXTS_COLUMNS = (
    "lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu", "ax", "ay", "az",
    "af", "al", "au", "wx", "wy", "wz", "wf", "wl", "wu", "pos_accuracy", "vel_accuracy",
    "navstat", "numsats", "posmode", "velmode", "orimode",
)  # fmt: skip
EARTH_RADIUS_M = 6378137.0
FARTHEST_M = 1e8
"""No place is farther from the world's origin: twice around the Earth."""


def read_poses(path: Path | str) -> list[Pose]:
    """Read one 3 x 4 camera pose a line as `world_from_ego`.

    The world is the frame that the poses are given in, mostly the first camera's, turned to
    ISO 8855 like the ego's.
    """
    path = Path(path)
    table = read_table(path, POSE_COLUMNS)
    poses = []
    for row, matrix in enumerate(table.within(0, 12, FARTHEST_M, "m").reshape(-1, 3, 4)):
        pose = rigid(matrix)
        if pose is None:
            table.refuse(row, "a rotation in columns 1-3, 5-7, 9-11", " ".join(table.rows[row]))
        poses.append(EGO_FROM_CAMERA @ pose @ CAMERA_FROM_EGO)
    return poses


def read_oxts(path: Path | str, calibration: KittiCalibration) -> list[Pose]:
    """Read the inertial unit's records as `world_from_ego`.

    The world is level, x east, y north, z up, its origin at the unit's first place; positions
    by the Mercator projection with the first latitude's scale, as KITTI's own tools have it.
    """
    path = Path(path)
    if calibration.camera_from_imu is None:
        raise FormatError(
            f"{path}: needs R0_rect, Tr_velo_to_cam and Tr_imu_to_velo in the calibration, "
            "got a calibration without"
        )
    table = read_table(path, OXTS_COLUMNS, least=25)
    lat, lon, altitude, roll, pitch, yaw = table.numbers(0, 6).T
    table.require(np.abs(lat) < 89, "a latitude between -89 and 89 degrees", 0)
    table.within(1, 2, 360, "degrees")
    table.within(2, 3, FARTHEST_M, "m")
    table.within(3, 6, MAX_ANGLE_RAD, "rad")
    if not len(table):
        return []
    scale = np.cos(np.deg2rad(lat[0])) * EARTH_RADIUS_M
    east = scale * np.deg2rad(lon)
    north = scale * np.log(np.tan(np.pi / 4 + np.deg2rad(lat) / 2))
    imu_from_ego = calibration.camera_from_imu.inverse() @ CAMERA_FROM_EGO
    return [
        Pose.from_euler(e - east[0], n - north[0], a - altitude[0], yaw=y, pitch=p, roll=r)
        @ imu_from_ego
        for e, n, a, y, p, r in zip(east, north, altitude, yaw, pitch, roll, strict=True)
    ]
