"""Camera detectors and fusions on KITTI's images, from the files to the board."""

from pathlib import Path

import numpy as np
import pytest
from toy_kitti_scans import P2, Painted, image_of, write_images, write_objects, write_tracking

from roadscope import leaderboard
from roadscope.benchmarks import kitti_suite
from roadscope.formats import FormatError

TOY = Path(__file__).parents[2] / "toy_kitti_scans.py"
SCANS, IMAGES = f"{TOY}:Corners", f"{TOY}:Painted"
CAMERA, FUSION = "kitti camera car", "kitti fusion car"


def test_a_camera_detector_from_files_to_the_board(tmp_path):
    folder = write_images(write_objects(tmp_path / "kitti"))
    (folder / "training" / "velodyne").rename(folder / "training" / "none")
    suite = kitti_suite(folder)
    assert list(suite.boards) == [CAMERA]
    results = leaderboard(suite.with_settings(CAMERA, entries=()), [IMAGES], boards=["camera"])
    for entry in (IMAGES, "oracle"):
        for level in ("easy", "moderate", "hard"):
            assert results.row(CAMERA, entry, f"ap_2d_{level}").value == pytest.approx(5 / 40)
    assert results.standing(CAMERA, "oracle").mark
    assert results.row(CAMERA, IMAGES, "boxes_per_frame").value == 2


@pytest.fixture(scope="module")
def fused(tmp_path_factory):
    folder = write_images(write_tracking(tmp_path_factory.mktemp("kitti"), ("0000",)))
    suite = kitti_suite(folder, ["fusion"])
    suite = suite.with_settings(FUSION, entries=("union",), lidar=(SCANS,), camera=(IMAGES,))
    return leaderboard(suite, boards=["fusion"])


def test_a_fusion_has_the_boxes_of_both_sensors(fused):
    assert not fused.failures
    for overlap in ("2d", "3d", "bev"):
        assert fused.row(FUSION, "union", f"ap_{overlap}_easy").value == pytest.approx(5 / 40)
    assert fused.row(FUSION, "union", "boxes_per_frame").value == 2


def test_each_sensor_alone_is_a_mark(fused):
    lidar, camera = "LiDAR alone", "camera alone"
    assert fused.standing(FUSION, lidar).mark
    assert fused.row(FUSION, lidar, "ap_3d_easy").value == pytest.approx(5 / 40)
    # Boxes in space have image boxes around them, those of the camera have no box in space.
    assert fused.row(FUSION, lidar, "ap_2d_easy").value == pytest.approx(5 / 40)
    assert fused.row(FUSION, camera, "ap_2d_easy").value == pytest.approx(5 / 40)
    assert fused.row(FUSION, camera, "ap_3d_easy").value == 0


def test_images_and_projection_are_those_of_the_files(tmp_path):
    folder = write_images(write_tracking(tmp_path / "kitti", ("0000",)))
    (drive,) = kitti_suite(folder, ["fusion"]).boards[FUSION].drives
    for frame, (image_frame, truth) in enumerate(drive.images()):
        np.testing.assert_array_equal(image_frame.camera.pixels, image_of(frame))
        np.testing.assert_allclose(image_frame.camera.intrinsics, P2[:, :3])
        boxes = Painted().detect(image_frame).boxes
        np.testing.assert_allclose(truth.image_boxes, boxes[np.argsort(boxes[:, 0])], atol=0.6)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda root: (root / "image_2/000001.png").write_bytes(b"no image"), ["000001.png"]),
        (lambda root: (root / "calib/000001.txt").unlink(), ["calib/000001.txt", "000001.png"]),
        (lambda root: (root / "image_2").rename(root / "images"), ["image_2"]),
    ],
)
def test_damage_is_one_clear_error(tmp_path, damage, words):
    folder = write_images(write_objects(tmp_path / "kitti"))
    damage(folder / "training")
    with pytest.raises(FormatError) as error:
        read_all(folder)
    for word in words:
        assert word in str(error.value)


def read_all(folder):
    for drive in kitti_suite(folder, ["camera"]).boards[CAMERA].drives:
        drive.check()
