"""A small folder of KITTI's odometry data; a few points of each scan say where it was taken."""

from pathlib import Path

import numpy as np
from toy_kitti_scans import VELO, scan_of

from roadscope.benchmarks.formats import trajectory_text
from roadscope.core import Pose
from roadscope.odometry import estimate

CAMERA_FROM_LIDAR = Pose(np.vstack([VELO, [0, 0, 0, 1]]))
STEP_M = 5.1


class Reads:
    """Reads the pose from three points, and falsifies it by a scale and a steady turn."""

    kind = "odometry"

    def __init__(self, *, scale: float = 1.0, turn_deg: float = 0.0):
        self.scale, self.turn_deg = scale, turn_deg

    def reset(self, lidar_from_imu=None):
        assert lidar_from_imu is None
        self.calls = 0

    def update(self, scan, imu=None):
        assert imu is None
        shown = scan.points[np.argsort(-scan.intensity, kind="stable")[:2]].astype(float)
        turn = np.deg2rad(self.turn_deg) * self.calls
        place = 100.0 * (shown[0] - 10.0) * self.scale
        self.calls += 1
        pose = Pose.from_euler(*place, yaw=shown[1, 0] - 5.0 + turn)
        return estimate(pose.matrix, np.zeros((6, 6)), scan.stamp_s, len(scan))


def lidar_pose(k: int, bend_rad: float) -> Pose:
    """The pose at step k of a way that bends by an angle at each step."""
    places = np.cumsum([[np.cos(j * bend_rad), np.sin(j * bend_rad)] for j in range(k)], axis=0)
    x, y = STEP_M * places[-1] if k else (0.0, 0.0)
    return Pose.from_euler(x, y, 0.0, yaw=k * bend_rad)


def write_odometry(
    folder: Path, sequences: dict[str, tuple[int, float]], *, unposed: tuple[str, ...] = ()
) -> Path:
    """Write `sequences` and `poses`; return the folder.

    sequences: the number of scans and the bend of each step. unposed: those without true poses.
    """
    for name, (count, bend_rad) in sequences.items():
        place = folder / "sequences" / name
        (place / "velodyne").mkdir(parents=True)
        poses = [lidar_pose(k, bend_rad) for k in range(count)]
        for k, pose in enumerate(poses):
            fixed_points = np.array(
                [[*(10 + pose.translation / 100), 0.9], [5 + k * bend_rad, 1, 1, 0.8]]
            )
            scan = scan_of(0)[:-16]
            scan = np.concatenate([scan, fixed_points.astype("<f4")])
            scan.tofile(place / "velodyne" / f"{k:06d}.bin")
        (place / "times.txt").write_text("".join(f"{0.1037 * k:.6e}\n" for k in range(count)))
        rows = {f"P{k}": np.eye(3, 4) for k in range(4)} | {"Tr": VELO}
        (place / "calib.txt").write_text(
            "".join(f"{k}: {' '.join(f'{v:.12e}' for v in m.ravel())}\n" for k, m in rows.items())
        )
        mount = CAMERA_FROM_LIDAR
        camera = [mount @ pose @ mount.inverse() for pose in poses]
        (folder / "poses").mkdir(exist_ok=True)
        if name not in unposed:
            text = trajectory_text("kitti", camera, ())
            (folder / "poses" / f"{name}.txt").write_text(text)
    return folder
