"""KITTI files: what they say in our records, and how malformed ones are refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from toy_kitti import EGO_SPEED_M_S, FRAMES, IMAGE_SIZE, P2, write_kitti

from roadscope.benchmarks.boards.tables import conditions
from roadscope.benchmarks.formats import FormatError, KittiFolder, read_sequence
from roadscope.benchmarks.formats.kitti import UNKNOWN, logistic
from roadscope.benchmarks.formats.kitti_calibration import read_calibration
from roadscope.benchmarks.formats.kitti_frames import CAMERA_FROM_EGO, EGO_FROM_CAMERA
from roadscope.benchmarks.formats.kitti_objects import KittiType, read_detections, read_labels
from roadscope.benchmarks.formats.kitti_poses import read_oxts, read_poses
from roadscope.benchmarks.recorded.suite import kitti_suite
from roadscope.core import Category, Pose

LABEL = "0 0 Car 0 0 -1.5 100.0 150.0 200.0 220.0 1.5 1.7 4.2 2.0 1.7 12.0 -1.57"
FOUND = "0,2,100,150,200,220,3.5,1.5,1.7,4.2,2.0,1.7,12.0,-1.57,-1.5"
POSE = "1 0 0 0 0 1 0 0 0 0 1 0"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_kitti(tmp_path / "kitti")


def test_a_sequence_in_our_records(folder):
    car = read_sequence(folder, "0001")
    assert len(car) == FRAMES == len(car.truths) == len(car.world_from_ego)
    assert (car.name, car.detector, car.category) == ("0001", "toy", Category.CAR)
    assert car.image_size[0] <= IMAGE_SIZE[0]
    np.testing.assert_allclose(car.calibration.projection, P2, atol=1e-4)
    frame = 5
    truth, seen = car.truths[frame], car.detections[frame]
    assert seen.frame == "ego"
    assert seen.stamp_s == pytest.approx(0.1 * frame) == truth.stamp_s
    assert truth.ids.tolist() == [0, 1]
    np.testing.assert_allclose(truth.centres[0], [12 + 5, -2, -1.7 + 0.75], atol=1e-6)
    np.testing.assert_allclose(truth.velocities, [[10, 0], [-8, 0]], atol=1e-4)
    np.testing.assert_allclose(truth.sizes[0], [4.2, 1.7, 1.5])
    np.testing.assert_allclose(truth.yaws, 0, atol=1e-6)
    assert (truth.lidar_returns == UNKNOWN).all()
    np.testing.assert_allclose(truth.world_from_ego.translation, [EGO_SPEED_M_S * 0.5, 0, 0])
    assert (seen.scores > 0).all()
    assert (seen.scores < 1).all()
    assert len(car.detected[frame]) == len(seen)
    kinds = set(car.labelled[frame].types.tolist())
    assert {KittiType.CAR, KittiType.VAN, KittiType.DONT_CARE} <= kinds


def test_detections_lie_on_the_truth_of_their_frame(folder):
    car = read_sequence(folder, "0000")
    near = []
    for seen, truth in zip(car.detections, car.truths, strict=True):
        world = seen.moved(truth.world_from_ego, "world")
        apart = np.linalg.norm(world.centres[None] - truth.centres[:, None], axis=-1)
        near += apart.min(axis=1).tolist() if len(world) and len(truth) else []
    assert np.median(near) < 0.3


def test_pedestrians_are_another_class(folder):
    walkers = read_sequence(folder, "0000", Category.PEDESTRIAN)
    assert {i for truth in walkers.truths for i in truth.ids.tolist()} == {3}
    assert (walkers.detections[0].categories == Category.PEDESTRIAN).all()
    assert all(not len(d) for d in read_sequence(folder, "0000", Category.CYCLIST).detections)
    with pytest.raises(FormatError, match="truck; of: car, pedestrian, cyclist"):
        read_sequence(folder, "0000", Category.TRUCK)


def renumbered(folder, number: int, sequence: str, every: int = 1) -> int:
    """Give every so many car rows of a sequence another class; return how many."""
    path = folder / "det_toy" / "Car" / f"{sequence}.txt"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    for row in rows[::every]:
        row[1] = str(number)
    path.write_text("".join(",".join(row) + "\n" for row in rows))
    return len(rows[::every])


def test_cars_that_are_numbered_otherwise_are_refused(folder):
    total = renumbered(folder, 1, "0000") + renumbered(folder, 1, "0001")
    said = (
        rf"det_toy/Car: expected rows of class 2 in the second column \(1 pedestrian, 2 car, "
        rf"3 cyclist\), got {total} rows, all of class 1"
    )
    with pytest.raises(FormatError, match=said):
        read_sequence(folder, "0000")
    with pytest.raises(FormatError, match=said):
        kitti_suite(folder)


def test_rows_of_other_classes_are_counted_and_told(folder):
    whole = read_sequence(folder, "0000")
    assert whole.left_out == 0
    assert "left out" not in conditions(kitti_suite(folder))
    few = renumbered(folder, 3, "0000", every=4)
    mixed = read_sequence(folder, "0000")
    assert mixed.left_out == few
    assert sum(map(len, mixed.detected)) == sum(map(len, whole.detected)) - few
    rows = sum(map(len, whole.detected)) + sum(map(len, read_sequence(folder, "0001").detected))
    said = f"{few} of {rows} rows in det_toy/Car are left out: their class is not car (1 ped"
    assert said in conditions(kitti_suite(folder))


def test_a_file_without_the_class_is_fine_where_another_has_it(folder):
    every = renumbered(folder, 1, "0000")
    alone = read_sequence(folder, "0000")
    assert alone.left_out == every
    assert all(not len(d) for d in alone.detections)


def test_the_standard_folder_with_training_works_too(folder, tmp_path):
    (tmp_path / "standard").mkdir()
    folder.rename(tmp_path / "standard" / "training")
    assert len(read_sequence(tmp_path / "standard", "0000")) == FRAMES


def test_scores_keep_their_order():
    raw = np.sort(np.random.default_rng(0).uniform(-30, 30, 200))
    mapped = logistic(raw)
    assert (np.diff(mapped) > 0).all()
    assert (mapped > 0).all()
    assert (mapped < 1).all()
    assert logistic(np.zeros(1))[0] == 0.5


def test_scores_that_are_shares_stay_as_they_are(folder):
    for path in folder.glob("det_toy/*/*.txt"):
        rows = [line.split(",") for line in path.read_text().splitlines()]
        lines = [",".join([*row[:6], "0.25", *row[7:]]) for row in rows]
        path.write_text("\n".join(lines))
    assert set(read_sequence(folder, "0000").detections[0].scores.tolist()) == {0.25}
    # One score beyond in another file, and none is taken for a share.
    other = folder / "det_toy" / "Pedestrian" / "0001.txt"
    other.write_text(other.read_text().replace("0.25", "1.25", 1))
    mapped = read_sequence(folder, "0000").detections[0].scores
    np.testing.assert_allclose(mapped, 1 / (1 + np.exp(-0.25)))


def test_folders_are_refused_by_name(folder, tmp_path):
    with pytest.raises(FormatError, match="no such folder"):
        KittiFolder.find(tmp_path / "nowhere")
    (tmp_path / "other" / "images").mkdir(parents=True)
    with pytest.raises(FormatError, match=r"expected label_02/SEQ.txt.*got images"):
        KittiFolder.find(tmp_path / "other")
    (tmp_path / "empty" / "label_02").mkdir(parents=True)
    with pytest.raises(FormatError, match=r"expected SEQ.txt files, got none"):
        KittiFolder.find(tmp_path / "empty")
    with pytest.raises(FormatError, match=r"label_02/0009.txt: missing"):
        read_sequence(folder, "0009")
    with pytest.raises(FormatError, match="no detector 'other'; known: toy"):
        read_sequence(folder, "0000", detector="other")


@pytest.mark.parametrize("name", ["label_02", "calib", "det_toy/Car"])
def test_a_missing_file_of_a_sequence_is_named(folder, name):
    (folder / name / "0000.txt").unlink()
    with pytest.raises(FormatError, match=f"{name}/0000.txt: missing; sequence 0000 needs it"):
        read_sequence(folder, "0000")


def test_missing_poses_and_too_few_are_refused(folder):
    path = folder / "ego_pose" / "0000.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]) + "\n")
    with pytest.raises(FormatError, match=r"each frame up to 29 of .*, got 29 poses"):
        read_sequence(folder, "0000")
    path.write_text("")
    with pytest.raises(FormatError, match="got an empty file"):
        read_sequence(folder, "0000")
    path.unlink()
    with pytest.raises(FormatError, match="no poses of sequence 0000; expected one of ego_pose"):
        read_sequence(folder, "0000")


def test_two_detectors_must_be_told_apart(folder):
    (folder / "det_toy").rename(folder / "det_a")
    (folder / "det_b").mkdir()
    with pytest.raises(FormatError, match="several detectors, name one: a, b"):
        read_sequence(folder, "0000")
    assert read_sequence(folder, "0000", detector="a").detector == "a"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (LABEL + " 0.5 7", r"expected 17 columns \(frame id type .*got '19 columns'"),
        (LABEL.rsplit(" ", 1)[0], "got '16 columns'"),
        (LABEL.replace("12.0", "abc"), "a number as z, got 'abc'"),
        (LABEL.replace("12.0", "nan"), "a finite z, got 'nan'"),
        (LABEL.replace("1.5 1.7 4.2", "1.5 -1.7 4.2"), "above 0, got '1.5 -1.7 4.2'"),
        (LABEL.replace("Car", "Lorry"), r"a type \(Car, Van, .*got 'Lorry'"),
        ("-1" + LABEL[1:], "an integer frame of 0 or more, got '-1'"),
        ("0.5" + LABEL[1:], "an integer frame of 0 or more, got '0.5'"),
        (LABEL, "each id once in frame 0, got 'id 0 again'"),
        (LABEL.replace("200.0", "50.0"), "right >= left"),
    ],
)
def test_malformed_labels_are_refused_with_their_line(tmp_path, line, said):
    path = tmp_path / "0000.txt"
    path.write_text(f"{LABEL}\n\n{line}\n")
    if "again" not in said:
        path.write_text(f"{LABEL.replace('0 0', '0 8', 1)}\n\n{line}\n")
    if "columns" in said:
        path.write_text(f"{line}\n")
    with pytest.raises(FormatError, match=said) as caught:
        read_labels(path)
    assert f"{path}, line {1 if 'columns' in said else 3}: " in str(caught.value)


def test_rows_of_different_length_are_refused(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text(f"{LABEL} 0.5\n{LABEL.replace('0 0', '0 1', 1)}\n")
    with pytest.raises(FormatError, match="line 2: expected 18 columns as in the first line"):
        read_labels(path, results=True)


def test_frames_that_go_back_are_refused_in_labels_but_not_in_results(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text("3" + LABEL[1:] + "\n" + LABEL + "\n")
    with pytest.raises(FormatError, match="line 2: expected frames that do not decrease"):
        read_labels(path)
    assert read_labels(path, results=True).frames.tolist() == [3, 0]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (FOUND.replace(",", " "), "expected 15 columns"),
        (FOUND.replace("0,2,", "0,7,"), r"a class \(1 pedestrian, 2 car, 3 cyclist\), got '7'"),
        (FOUND.replace("1.5,1.7", "0,1.7"), "height, width and length above 0"),
        (FOUND.replace("3.5", "high"), "a number as score, got 'high'"),
        (FOUND.replace("12.0", "inf"), "a finite z"),
    ],
)
def test_malformed_detections_are_refused(tmp_path, line, said):
    path = tmp_path / "0000.txt"
    path.write_text(f"{line}\n")
    with pytest.raises(FormatError, match=said) as caught:
        read_detections(path)
    assert f"{path}, line 1" in str(caught.value)


def test_empty_and_windows_files_are_allowed(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_bytes(b"")
    assert len(read_detections(path)) == 0
    path.write_bytes((FOUND + "\r\n" + FOUND.replace("0,2", "4,2", 1) + "\r\n").encode())
    assert read_detections(path).frames.tolist() == [0, 4]
    path.write_bytes(("\ufeff" + LABEL + "\r\n").encode())
    assert read_labels(path).types.tolist() == [KittiType.CAR]


@pytest.mark.parametrize("junk", [b"\x89PNG\r\n\x1a\n\x00", b"0 0 Car\n\x00\x01\x02", b"\xff\xfe"])
def test_binary_files_are_refused(tmp_path, junk):
    path = tmp_path / "0000.txt"
    path.write_bytes(junk)
    for read in (read_labels, read_detections, read_calibration, read_poses):
        with pytest.raises(FormatError, match="expected text, got binary data"):
            read(path)


def test_calibration_needs_its_keys(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text("P0: " + "1 " * 12)
    with pytest.raises(FormatError, match="expected the key P2, got P0"):
        read_calibration(path)
    path.write_text("P0: 1\nP2: " + "1 " * 11)
    with pytest.raises(FormatError, match="line 1: expected 12 finite numbers after P0"):
        read_calibration(path)
    path.write_text("P2: " + "1 " * 12 + "\nR_rect 9 0 0 0 1 0 0 0 1\nTr_velo_cam "
                    + POSE + "\nTr_imu_velo " + POSE)  # fmt: skip
    with pytest.raises(FormatError, match="expected rotations in R0_rect"):
        read_calibration(path)


def test_poses_come_back(tmp_path):
    rng = np.random.default_rng(3)
    poses = [
        Pose.from_euler(*rng.normal(0, 50, 3), yaw=a, pitch=b, roll=c)
        for a, b, c in rng.normal(0, 1, (20, 3))
    ]
    rows = [(CAMERA_FROM_EGO @ p @ EGO_FROM_CAMERA).matrix[:3].ravel() for p in poses]
    np.savetxt(tmp_path / "poses.txt", rows)
    for one, other in zip(read_poses(tmp_path / "poses.txt"), poses, strict=True):
        np.testing.assert_allclose(one.matrix, other.matrix, atol=1e-9)


def test_a_pose_that_does_not_turn_rigidly_is_refused(tmp_path):
    path = tmp_path / "poses.txt"
    path.write_text(POSE + "\n" + POSE.replace("1", "2") + "\n")
    with pytest.raises(FormatError, match="line 2: expected a rotation"):
        read_poses(path)


def test_the_inertial_unit_gives_poses_too(folder):
    """The same drive north and as camera poses: motion in the ego's own frame is the same."""
    calibration = read_calibration(folder / "calib" / "0000.txt")
    metres = np.arange(FRAMES) * EGO_SPEED_M_S * 0.1
    degrees = 49 + np.rad2deg(metres / 6378137.0)
    rows = [f"{lat:.12f} 8.4 110 0 0 {np.pi / 2}" + " 0" * 24 for lat in degrees]
    (folder / "oxts").mkdir()
    path = folder / "oxts" / "0000.txt"
    path.write_text("\n".join(rows))
    unit = read_oxts(path, calibration)
    camera = read_poses(folder / "ego_pose" / "0000.txt")
    for poses in (unit, camera):
        step = poses[0].inverse() @ poses[-1]
        np.testing.assert_allclose(step.translation, [metres[-1], 0, 0], atol=1e-3)
        np.testing.assert_allclose(step.rotation, np.eye(3), atol=1e-9)
    assert unit[0].yaw == pytest.approx(np.pi / 2)
    (folder / "ego_pose" / "0000.txt").unlink()
    assert read_sequence(folder, "0000").world_from_ego[0] == unit[0]


def test_oxts_without_calibration_of_the_unit_is_refused(tmp_path):
    (tmp_path / "calib.txt").write_text("P2: " + "1 " * 12)
    calibration = read_calibration(tmp_path / "calib.txt")
    with pytest.raises(FormatError, match="needs R0_rect, Tr_velo_to_cam and Tr_imu_to_velo"):
        read_oxts(tmp_path / "oxts.txt", calibration)


def test_real_sequences_can_be_read():
    folder = os.environ.get("ROADSCOPE_KITTI")
    if not folder:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    sequence = read_sequence(folder, KittiFolder.find(folder).sequences()[0])
    near, turned = [], []
    for seen, truth in zip(sequence.detections, sequence.truths, strict=True):
        if len(seen) and len(truth):
            world = seen.moved(truth.world_from_ego, "world")
            apart = np.linalg.norm(world.centres[None] - truth.centres[:, None], axis=-1)
            near += apart.min(axis=1).tolist()
            turn = world.yaws[apart.argmin(axis=1)] - truth.yaws
            turned += np.abs(np.sin(turn)).tolist()
    assert np.median(near) < 0.5
    assert np.median(turned) < 0.1
