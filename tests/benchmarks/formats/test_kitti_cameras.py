"""The calibration of the camera in KITTI's layouts: sequences, object data, tracking data, raw."""

import numpy as np
import pytest

from roadscope.benchmarks.formats import KittiCameras
from roadscope.core import Pose
from roadscope.formats import FormatError

P2 = np.array([[720.0, 0, 610, 45], [0, 720, 173, 0.2], [0, 0, 1, 0.003]])
RECTIFIED = Pose.from_euler(0, 0, 0, yaw=0.01, pitch=-0.02).rotation
MOUNT = Pose.from_parts(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), [0.0, -0.08, -0.27])
NAME = "000007"


def text_of(**rows):
    return "".join(f"{k}: {' '.join(map(repr, np.ravel(v).tolist()))}\n" for k, v in rows.items())


OBJECT = text_of(P2=P2, R0_rect=RECTIFIED, Tr_velo_to_cam=MOUNT.matrix[:3])
RAW = {
    "calib_cam_to_cam.txt": "calib_time: 09-Jan-2012 13:57:47\n"
    + text_of(R_rect_00=RECTIFIED, P_rect_02=P2),
    "calib_velo_to_cam.txt": text_of(R=MOUNT.rotation, T=MOUNT.translation),
}
PLACES = {
    "sequence": (".", {"calib.txt": OBJECT}),
    "scans of a sequence": ("velodyne", {"calib.txt": OBJECT}),
    "object data": (".", {f"calib/{NAME}.txt": OBJECT}),
    "scans of object data": ("velodyne", {f"calib/{NAME}.txt": OBJECT}),
    "tracking data": ("velodyne/0003", {"calib/0003.txt": OBJECT}),
    "raw drive": ("drive", RAW),
    "scans of a raw drive": ("drive/velodyne_points/data", RAW),
}


@pytest.mark.parametrize("layout", PLACES)
def test_calibrations_are_found_and_say_the_same(tmp_path, layout):
    folder, files = PLACES[layout]
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(content)
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    camera = KittiCameras.find(tmp_path / folder).of(NAME)
    point = np.array([20.0, 3.0, -1.0, 1.0])
    rectified = np.eye(4)
    rectified[:3, :3] = RECTIFIED
    in_camera = rectified @ MOUNT.matrix @ point
    assert camera.camera_from_lidar.matrix @ point == pytest.approx(in_camera)
    pixel = P2 @ in_camera
    # The ego is 1.7 m below the LiDAR here.
    projection = camera.projection_of(Pose.planar(0, 0, 0, 1.7), 1242, 375)
    pixels, depth = projection.project(np.add(point[:3], [0, 0, 1.7]))
    assert pixels == pytest.approx(pixel[:2] / pixel[2])
    assert depth == pytest.approx(pixel[2])


def test_there_may_be_none(tmp_path):
    assert KittiCameras.find(tmp_path) is None


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("calib.txt", text_of(P2=P2), "expected the key Tr"),
        ("calib.txt", text_of(Tr=MOUNT.matrix[:3]), "expected the key P2"),
        ("calib_cam_to_cam.txt", text_of(P_rect_02=P2), "expected P_rect_02 and R_rect_00"),
        ("calib_cam_to_cam.txt", RAW["calib_cam_to_cam.txt"], "calib_velo_to_cam.txt: cannot be"),
    ],
)
def test_wrong_files_are_refused(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(FormatError, match=message):
        KittiCameras(tmp_path / name).of(NAME)


def test_a_scan_without_a_calibration_is_named(tmp_path):
    (tmp_path / "calib").mkdir()
    with pytest.raises(FormatError, match=f"{NAME}.txt: cannot be read"):
        KittiCameras.find(tmp_path).of(NAME)
