"""The camera in whose frame KITTI's label files are: calibrated once, or for each scan."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadscope.benchmarks.formats.kitti_calibration import (
    nearest_rigid,
    read_camera_from_lidar,
    read_kitti_calibration,
    read_kitti_transform,
)
from roadscope.benchmarks.formats.table import FormatError, read_lines
from roadscope.core import Pose
from roadscope.core.projection import Projection

CALIBRATION_FILE, CALIBRATION_FOLDER = "calib.txt", "calib"
"""Beside the scans: KITTI's calibration of a sequence, and the folder with one for each scan."""
RAW_CAMERAS, RAW_LIDAR = "calib_cam_to_cam.txt", "calib_velo_to_cam.txt"
"""The calibration of KITTI's raw drives of a day, in the folder of the day."""


@dataclass(frozen=True, slots=True)
class KittiCamera:
    """The left colour camera.

    projection: (3, 4) pixels from metres in the rectified camera frame.
    camera_from_lidar: pose of the LiDAR in that frame.
    """

    projection: np.ndarray
    camera_from_lidar: Pose

    @staticmethod
    def read(path: Path) -> KittiCamera:
        """Read a calibration of a sequence or of a scan, or that of a day with raw drives."""
        if path.name == RAW_CAMERAS:
            return _read_raw(path)
        return KittiCamera(read_kitti_calibration(path).projection, read_camera_from_lidar(path))

    def projection_of(self, ego_from_lidar: Pose, width: int, height: int) -> Projection:
        """Return the projection from the ego frame into images of a size in pixels."""
        camera_from_ego = self.camera_from_lidar @ ego_from_lidar.inverse()
        return Projection(self.projection @ camera_from_ego.matrix, width, height)


@dataclass(frozen=True, slots=True)
class KittiCameras:
    """The calibration of each scan.

    path: a file for all scans, or a folder with one for each, `NAME.txt`.
    """

    path: Path
    read: dict[Path, KittiCamera] = field(default_factory=dict, compare=False)

    @staticmethod
    def find(folder: Path) -> KittiCameras | None:
        """Return the calibration in or beside a folder of scans, or of KITTI; None without any."""
        whole = folder.absolute()
        sequence = f"{CALIBRATION_FOLDER}/{whole.name}.txt"
        places = (
            *(each / CALIBRATION_FILE for each in (whole, whole.parent)),
            *(each / CALIBRATION_FOLDER for each in (whole, whole.parent)),
            whole.parent.parent / sequence,
            *(each / RAW_CAMERAS for each in (whole.parent, whole.parent.parent.parent)),
        )
        calibration_path = next((path for path in places if path.exists()), None)
        return None if calibration_path is None else KittiCameras(calibration_path)

    def of(self, name: str) -> KittiCamera:
        """Return the camera of a scan by its name, without ending."""
        path = self.path / f"{name}.txt" if self.path.is_dir() else self.path
        if path not in self.read:
            self.read[path] = KittiCamera.read(path)
        return self.read[path]


def _read_raw(path: Path) -> KittiCamera:
    """Read the left colour camera of raw drives, and the LiDAR from the file beside it."""
    words = {line.partition(":")[0]: line.partition(":")[2].split() for line in read_lines(path)}
    try:
        projection = np.array(words["P_rect_02"], np.float64).reshape(3, 4)
        turn = nearest_rigid(np.array(words["R_rect_00"], np.float64).reshape(3, 3))
    except (KeyError, ValueError) as error:
        raise FormatError(f"{path}: expected P_rect_02 and R_rect_00 with their numbers") from error
    if turn is None or not np.isfinite(projection).all():
        raise FormatError(f"{path}: expected a rotation in R_rect_00, finite numbers in P_rect_02")
    return KittiCamera(projection, turn @ read_kitti_transform(path.parent / RAW_LIDAR))
