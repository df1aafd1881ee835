"""KITTI's calibration files, and the poses of the vehicle: camera poses or OXTS records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_frames import CAMERA_FROM_EGO, EGO_FROM_CAMERA
from roadscope.benchmarks.formats.kitti_labels import MAX_ANGLE_RAD
from roadscope.benchmarks.formats.table import FormatError, Table, read_lines, read_table, refuse
from roadscope.core import Pose
from roadscope.core.checks import settle_arrays
from roadscope.core.record import Record

ALIASES = {"R_rect": "R0_rect", "Tr_velo_cam": "Tr_velo_to_cam", "Tr_imu_velo": "Tr_imu_to_velo"}
"""The tracking benchmark's spelling of a key -> the object benchmark's."""
CHAIN = ("R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo")
"""Keys whose product maps points of the inertial unit into the rectified camera."""
COUNTS = {
    "P0": 12,
    "P1": 12,
    "P2": 12,
    "P3": 12,
    "Tr": 12,
    "R0_rect": 9,
    "Tr_velo_to_cam": 12,
    "Tr_imu_to_velo": 12,
}
"""How many numbers follow a key."""
TOLERANCE = 1e-3
"""Singular values of a rotation differ from 1 by less: files print seven digits. Chosen by hand."""
MAX_NUMBER = 1e9
"""No number of a calibration (pixels, metres) is larger. Chosen by hand."""
POSE_COLUMNS = tuple(f"r{i}{j}" if j < 3 else f"t{i}" for i in range(3) for j in range(4))
ROTATION_COLUMNS = "a rotation in columns 1-3, 5-7, 9-11"
OXTS_COLUMNS = (
    *("lat", "lon", "alt", "roll", "pitch", "yaw", "vn", "ve", "vf", "vl", "vu", "ax", "ay", "az"),
    *("af", "al", "au", "wx", "wy", "wz", "wf", "wl", "wu", "pos_accuracy", "vel_accuracy"),
    *("navstat", "numsats", "posmode", "velmode", "orimode"),
)
EARTH_RADIUS_M = 6378137.0
"""The equatorial radius of WGS 84, as in KITTI's development kit."""
MAX_LATITUDE_DEG = 89
"""The Mercator projection ends before the poles."""
MAX_POSITION_M = 1e8
"""No place is further from the world's origin: twice around the Earth."""


@dataclass(frozen=True, slots=True, eq=False)
class KittiCalibration(Record):
    """Calibration of one sequence.

    projection: (3, 4) float64, P2, pixels of the left colour camera from metres in the rectified
        camera frame.
    camera_from_imu: pose of the inertial unit in the rectified camera frame; None if the file
        does not give it.
    """

    projection: np.ndarray
    camera_from_imu: Pose | None

    def __post_init__(self) -> None:
        settle_arrays(self, projection=(np.float64, (3, 4)))


def read_kitti_calibration(path: Path | str) -> KittiCalibration:
    """Read `P2`, and `R0_rect`, `Tr_velo_to_cam`, `Tr_imu_to_velo` if all three are there."""
    path = Path(path)
    matrices = _read_matrices(path)
    if "P2" not in matrices:
        raise FormatError(
            f"{path}: expected the key P2, got {', '.join(matrices) or 'no known key'}"
        )
    if not all(key in matrices for key in CHAIN):
        return KittiCalibration(matrices["P2"], None)
    camera, velo, imu = (nearest_rigid(matrices[key]) for key in CHAIN)
    if camera is None or velo is None or imu is None:
        parts = zip(CHAIN, (camera, velo, imu), strict=True)
        wrong = ", ".join(key for key, part in parts if part is None)
        raise FormatError(f"{path}: expected rotations in {', '.join(CHAIN)}; {wrong} has none")
    return KittiCalibration(matrices["P2"], camera @ velo @ imu)


def read_camera_from_lidar(path: Path) -> Pose:
    """Read where the LiDAR is in the frame of camera 0: `Tr`, or `Tr_velo_to_cam` and `R0_rect`."""
    matrices = _read_matrices(path)
    chain = (("Tr",), ("R0_rect", "Tr_velo_to_cam"), ("Tr_velo_to_cam",))
    keys = next((each for each in chain if all(key in matrices for key in each)), ())
    pose = Pose.identity()
    for key in keys:
        part = nearest_rigid(matrices[key])
        if part is None:
            raise FormatError(f"{path}: expected a rotation in {key}")
        pose = pose @ part
    if not keys:
        raise FormatError(f"{path}: expected the key Tr, or R0_rect and Tr_velo_to_cam")
    return pose


def read_kitti_transform(path: Path) -> Pose:
    """Read `R` and `T` of a calibration file of a raw drive, such as `calib_imu_to_velo.txt`."""
    lines = (line.split() for line in read_lines(path))
    texts = {words[0].rstrip(":"): words[1:] for words in lines if words}
    try:
        rotation = np.array(texts["R"], np.float64).reshape(3, 3)
        offset = np.array(texts["T"], np.float64).reshape(3, 1)
    except (KeyError, ValueError) as error:
        raise FormatError(f"{path}: expected R: and nine numbers, T: and three") from error
    pose = nearest_rigid(np.hstack([rotation, offset]))
    if pose is None:
        raise FormatError(f"{path}: expected a rotation in R")
    return pose


def calibration_text(projection: np.ndarray, camera_from_lidar: Pose, lidar_from_imu: Pose) -> str:
    """Return the text of a calibration file in which all four cameras are the same.

    projection: (3, 4), pixels from metres in the rectified camera frame.
    """
    matrices = {f"P{k}": projection for k in range(4)} | {
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": camera_from_lidar.matrix[:3],
        "Tr_imu_to_velo": lidar_from_imu.matrix[:3],
    }
    return "".join(
        f"{key}: {' '.join(f'{v:.12e}' for v in matrix.ravel())}\n"
        for key, matrix in matrices.items()
    )


def read_kitti_poses(path: Path | str) -> list[Pose]:
    """Read camera poses, one 3 x 4 matrix per line, as `world_from_ego`.

    The world is the frame of the file, mostly the first camera's, with the axes of ISO 8855. So is
    the ego frame, see `kitti_frames.py`.
    """
    table = read_table(Path(path), POSE_COLUMNS)
    numbers = table.within(0, 12, MAX_POSITION_M, "m")
    return [EGO_FROM_CAMERA @ pose @ CAMERA_FROM_EGO for pose in poses_of_rows(table, numbers)]


def read_kitti_oxts(path: Path | str, calibration: KittiCalibration) -> list[Pose]:
    """Read the records of the inertial unit (OXTS) as `world_from_ego`.

    The world is level, x east, y north, z up; its origin is the unit's first position. Positions
    are by the Mercator projection, scaled at the first latitude, as in KITTI's development kit.
    """
    path = Path(path)
    if calibration.camera_from_imu is None:
        raise FormatError(
            f"{path}: expected a calibration with {', '.join(CHAIN)}, which poses from oxts need; "
            "got a calibration without them"
        )
    table = read_table(path, OXTS_COLUMNS, required=25)
    lat, lon, altitude, roll, pitch, yaw = table.numbers(0, 6).T
    limit = MAX_LATITUDE_DEG
    table.require(np.abs(lat) < limit, f"a latitude between -{limit} and {limit} degrees", 0)
    table.within(1, 2, 360, "degrees")
    table.within(2, 3, MAX_POSITION_M, "m")
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


def poses_of_rows(table: Table, numbers: np.ndarray) -> list[Pose]:
    """Return the poses of (N, 12) numbers, 3 x 4 matrices row by row, with the file's axes.

    table: the rows that the numbers come from; one without a rotation is refused.
    """
    poses = []
    for row, matrix in enumerate(numbers.reshape(-1, 3, 4)):
        pose = nearest_rigid(matrix)
        if pose is None:
            table.refuse(row, ROTATION_COLUMNS, " ".join(table.rows[row]))
        poses.append(pose)
    return poses


def nearest_rigid(matrix: np.ndarray) -> Pose | None:
    """Return the rigid transform nearest to a (3, 3) or (3, 4) matrix; None if none is near.

    The rotations in files are not exact, because they are printed with few digits.
    """
    left, stretch, right = np.linalg.svd(matrix[:, :3])
    rotation = left @ right
    if np.abs(stretch - 1).max() > TOLERANCE or np.linalg.det(rotation) < 0:
        return None
    return Pose.from_parts(rotation, matrix[:, 3] if matrix.shape[1] == 4 else np.zeros(3))


def _read_matrices(path: Path) -> Mapping[str, np.ndarray]:
    """Return the matrices of all known keys."""
    matrices = {}
    for number, line in enumerate(read_lines(path), start=1):
        if not line.strip():
            continue
        key, *texts = line.split()
        key = ALIASES.get(key.rstrip(":"), key.rstrip(":"))
        if key not in COUNTS:
            continue
        if key in matrices:
            refuse(path, number, f"the key {key} once", f"{key} a second time")
        matrices[key] = _matrix(path, number, key, texts)
    return matrices


def _matrix(path: Path, line: int, key: str, texts: Sequence[str]) -> np.ndarray:
    """Return a (3, 3) or (3, 4) float64 matrix; a projection that no camera has is refused."""
    actual = " ".join(texts)
    expected = f"{COUNTS[key]} finite numbers after {key}"
    try:
        values = np.array(texts, np.float64)
    except ValueError:
        refuse(path, line, expected, actual)
    if len(values) != COUNTS[key] or not np.isfinite(values).all():
        refuse(path, line, expected, actual)
    if np.abs(values).max() > MAX_NUMBER:
        refuse(path, line, f"numbers from -{MAX_NUMBER:g} to {MAX_NUMBER:g} after {key}", actual)
    matrix = values.reshape(3, -1)
    if key == "P2" and np.linalg.matrix_rank(matrix[:, :3]) < 3:
        refuse(path, line, "after P2 a projection: columns 1-3, 5-7, 9-11 of rank 3", actual)
    return matrix
