"""KITTI files: what they say in our records, and how malformed ones are refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from toy_kitti import EGO_SPEED_M_S, FRAMES, IMAGE_SIZE, P2, write_kitti

from roadscope.benchmarks import kitti_suite
from roadscope.benchmarks.formats import NOT_COUNTED, logistic
from roadscope.benchmarks.report import explanation
from roadscope.core import Category
from roadscope.formats import (
    FormatError,
    KittiFolder,
    KittiType,
    read_kitti_calibration,
    read_kitti_detections,
    read_kitti_labels,
    read_kitti_poses,
    read_kitti_sequence,
)

LABEL = "0 0 Car 0 0 -1.5 100.0 150.0 200.0 220.0 1.5 1.7 4.2 2.0 1.7 12.0 -1.57"
FOUND = "0,2,100,150,200,220,3.5,1.5,1.7,4.2,2.0,1.7,12.0,-1.57,-1.5"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_kitti(tmp_path / "kitti")


def test_a_sequence_in_our_records(folder):
    car = read_kitti_sequence(folder, "0001")
    assert len(car) == FRAMES == len(car.truths) == len(car.world_from_ego)
    assert (car.name, car.detector, car.category) == ("0001", "toy", Category.CAR)
    assert car.image_size[0] <= IMAGE_SIZE[0]
    np.testing.assert_allclose(car.calibration.projection, P2, atol=1e-4)
    frame = 5
    truth, detections = car.truths[frame], car.detections[frame]
    assert detections.frame == "ego"
    assert detections.stamp_s == pytest.approx(0.1 * frame) == truth.stamp_s
    assert truth.ids.tolist() == [0, 1]
    np.testing.assert_allclose(truth.centres[0], [12 + 5, -2, -1.7 + 0.75], atol=1e-6)
    np.testing.assert_allclose(truth.velocities, [[10, 0], [-8, 0]], atol=1e-4)
    np.testing.assert_allclose(truth.sizes[0], [4.2, 1.7, 1.5])
    np.testing.assert_allclose(truth.yaws, 0, atol=1e-6)
    assert (truth.lidar_returns == NOT_COUNTED).all()
    np.testing.assert_allclose(truth.world_from_ego.translation, [EGO_SPEED_M_S * 0.5, 0, 0])
    assert (detections.scores > 0).all()
    assert (detections.scores < 1).all()
    assert len(car.detection_rows[frame]) == len(detections)
    kinds = set(car.label_rows[frame].types.tolist())
    assert {KittiType.CAR, KittiType.VAN, KittiType.DONT_CARE} <= kinds


def test_detections_lie_on_the_truth_of_their_frame(folder):
    car = read_kitti_sequence(folder, "0000")
    near = []
    for detections, truth in zip(car.detections, car.truths, strict=True):
        world = detections.moved(truth.world_from_ego, "world")
        distances_m = np.linalg.norm(world.centres[None] - truth.centres[:, None], axis=-1)
        near += distances_m.min(axis=1).tolist() if len(world) and len(truth) else []
    assert np.median(near) < 0.3


def test_pedestrians_are_another_class(folder):
    walkers = read_kitti_sequence(folder, "0000", Category.PEDESTRIAN)
    assert {i for truth in walkers.truths for i in truth.ids.tolist()} == {3}
    assert (walkers.detections[0].categories == Category.PEDESTRIAN).all()
    assert all(not len(d) for d in read_kitti_sequence(folder, "0000", Category.CYCLIST).detections)
    with pytest.raises(FormatError, match="category truck; known: car, pedestrian, cyclist"):
        read_kitti_sequence(folder, "0000", Category.TRUCK)


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
    message = (
        rf"det_toy/Car: expected rows of class 2 in the second column \(1 pedestrian, 2 car, "
        rf"3 cyclist\), got {total} rows, all of class 1"
    )
    with pytest.raises(FormatError, match=message):
        read_kitti_sequence(folder, "0000")
    with pytest.raises(FormatError, match=message):
        kitti_suite(folder)


def test_rows_of_other_classes_are_counted_and_reported(folder):
    whole = read_kitti_sequence(folder, "0000")
    assert whole.other_class_rows == 0
    assert "left out" not in explanation(kitti_suite(folder), ["kitti car"])
    few = renumbered(folder, 3, "0000", every=4)
    mixed = read_kitti_sequence(folder, "0000")
    assert mixed.other_class_rows == few
    assert sum(map(len, mixed.detection_rows)) == sum(map(len, whole.detection_rows)) - few
    rows = sum(map(len, whole.detection_rows)) + sum(
        map(len, read_kitti_sequence(folder, "0001").detection_rows)
    )
    note = f"{few} of {rows} rows in det_toy/Car are left out: their class is not car (1 ped"
    assert note in explanation(kitti_suite(folder), ["kitti car"])


def test_a_file_without_the_class_is_fine_where_another_has_it(folder):
    every = renumbered(folder, 1, "0000")
    alone = read_kitti_sequence(folder, "0000")
    assert alone.other_class_rows == every
    assert all(not len(d) for d in alone.detections)


def test_the_standard_folder_with_training_works_too(folder, tmp_path):
    (tmp_path / "standard").mkdir()
    folder.rename(tmp_path / "standard" / "training")
    assert len(read_kitti_sequence(tmp_path / "standard", "0000")) == FRAMES


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
    assert set(read_kitti_sequence(folder, "0000").detections[0].scores.tolist()) == {0.25}
    # One score beyond in another file, and none is taken for a share.
    other = folder / "det_toy" / "Pedestrian" / "0001.txt"
    other.write_text(other.read_text().replace("0.25", "1.25", 1))
    mapped = read_kitti_sequence(folder, "0000").detections[0].scores
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
        read_kitti_sequence(folder, "0009")
    with pytest.raises(FormatError, match="no detector 'other'; known: toy"):
        read_kitti_sequence(folder, "0000", detector="other")


@pytest.mark.parametrize("name", ["label_02", "calib", "det_toy/Car"])
def test_a_missing_file_of_a_sequence_is_named(folder, name):
    (folder / name / "0000.txt").unlink()
    with pytest.raises(FormatError, match=f"{name}/0000.txt: missing; sequence 0000 needs it"):
        read_kitti_sequence(folder, "0000")


def test_missing_poses_and_too_few_are_refused(folder):
    path = folder / "ego_pose" / "0000.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]) + "\n")
    with pytest.raises(FormatError, match=r"each of the frames 0 to 29 of .*, got 29 poses"):
        read_kitti_sequence(folder, "0000")
    path.write_text("")
    with pytest.raises(FormatError, match="got an empty file"):
        read_kitti_sequence(folder, "0000")
    path.unlink()
    with pytest.raises(FormatError, match="no poses of sequence 0000; expected one of ego_pose"):
        read_kitti_sequence(folder, "0000")


def test_two_detectors_must_be_distinguished(folder):
    (folder / "det_toy").rename(folder / "det_a")
    (folder / "det_b").mkdir()
    with pytest.raises(FormatError, match="several detectors, name one: a, b"):
        read_kitti_sequence(folder, "0000")
    assert read_kitti_sequence(folder, "0000", detector="a").detector == "a"


WRONG_IN_LABELS = {
    ("frame", 0): ("-1", "0.5", "1000000000000"),
    ("id", 1): ("1e300", "99999999999999999999", str(2**53)),
    ("type", 2): ("Lorry",),
    ("truncated", 3): ("7", "0.5"),
    ("occluded", 4): ("9",),
    ("alpha", 5): ("100",),
    ("right", 8): ("50.0", "1e200"),
    ("width", 11): ("-1.7",),
    ("length", 12): ("1e200",),
    ("z", 15): ("abc", "nan", "1e200"),
    ("rotation_y", 16): ("100",),
}
"""By name and number of the column."""
WRONG_IN_DETECTIONS = {
    ("frame", 0): ("1e12",),
    ("class", 1): ("7", "-1e300"),
    ("right", 4): ("1e200",),
    ("score", 6): ("high",),
    ("height", 7): ("0",),
    ("z", 12): ("inf", "1e200"),
    ("rotation_y", 13): ("100",),
}
FILES = (
    (read_kitti_labels, LABEL, " ", WRONG_IN_LABELS),
    (read_kitti_detections, FOUND, ",", WRONG_IN_DETECTIONS),
)


@pytest.mark.parametrize(
    ("read", "row", "between", "column", "value"),
    [
        (read, row, between, column, value)
        for read, row, between, wrong in FILES
        for column, values in wrong.items()
        for value in values
    ],
)
def test_a_wrong_value_is_refused_by_line_column_and_value(
    tmp_path, read, row, between, column, value
):
    words = row.split(between)
    words[column[1]] = value
    path = tmp_path / "0000.txt"
    path.write_text(f"\n\n{between.join(words)}\n")
    with pytest.raises(FormatError) as caught:
        read(path)
    message = str(caught.value)
    assert not [word for word in (f"{path}, line 3: ", column[0], value) if word not in message]


def test_an_id_twice_in_a_frame_is_refused(tmp_path):
    (tmp_path / "0000.txt").write_text(f"{LABEL}\n\n{LABEL}\n")
    with pytest.raises(FormatError, match=r"line 3: .* once in frame 0"):
        read_kitti_labels(tmp_path / "0000.txt")


@pytest.mark.parametrize(
    ("read", "line", "message"),
    [
        (read_kitti_labels, LABEL + " 0.5 7", r"expected 17 .*'19 columns"),
        (read_kitti_labels, LABEL.rsplit(" ", 1)[0], r"expected 17 .*'16 columns"),
        (read_kitti_detections, FOUND.replace(",", " "), r"expected 15 columns"),
    ],
)
def test_too_many_and_too_few_columns_are_refused(tmp_path, read, line, message):
    (tmp_path / "0000.txt").write_text(f"{line}\n")
    with pytest.raises(FormatError, match=rf"line 1: .*{message}"):
        read(tmp_path / "0000.txt")


def test_rows_of_different_length_are_refused(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text(f"{LABEL} 0.5\n{LABEL.replace('0 0', '0 1', 1)}\n")
    with pytest.raises(FormatError, match="line 2: expected 18 columns as in the first line"):
        read_kitti_labels(path, results=True)


def test_frames_that_go_back_are_refused_in_labels_but_not_in_results(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text("3" + LABEL[1:] + "\n" + LABEL + "\n")
    with pytest.raises(FormatError, match="line 2: expected a frame not below the"):
        read_kitti_labels(path)
    assert read_kitti_labels(path, results=True).frames.tolist() == [3, 0]


@pytest.mark.parametrize(
    ("flat", "truncated"),
    [
        ("Car -1 -1 -10 100 150 200 220 -1 -1 -1 -1000 -1000 -1000 -10", -1),
        ("Car -1 -1 -10 100 150 200 220 -1000 -1000 -1000 -10 -1 -1 -1", -1),
        ("Car 0.34 0 -1 -8e4 150 200 220 -1 -1 -1 -1000 -1000 -1000 -1", 0.34),
        ("Car 2 3 3.9 100 150 200 220 1.5 1.7 4.2 2.0 1.7 12.0 -4.7", 2),
    ],
)
def test_what_trackers_leave_unknown_in_results_is_read(tmp_path, flat, truncated):
    path = tmp_path / "0000.txt"
    path.write_text(f"0 7 {flat} 0.9\n")
    assert read_kitti_labels(path, results=True).truncated.tolist() == [truncated]


def test_a_share_beyond_one_is_no_truncation(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text(LABEL.replace("Car 0 0", "Car 1.5 0"))
    with pytest.raises(FormatError, match=r"truncated as a level .* or as a share from 0 to 1"):
        read_kitti_labels(path, results=True)


def test_empty_and_windows_files_are_allowed(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_bytes(b"")
    assert len(read_kitti_detections(path)) == 0
    path.write_bytes((FOUND + "\r\n" + FOUND.replace("0,2", "4,2", 1) + "\r\n").encode())
    assert read_kitti_detections(path).frames.tolist() == [0, 4]
    path.write_bytes(("\ufeff" + LABEL + "\r\n").encode())
    assert read_kitti_labels(path).types.tolist() == [KittiType.CAR]


@pytest.mark.parametrize("junk", [b"\x89PNG\r\n\x1a\n\x00", b"0 0 Car\n\x00\x01\x02", b"\xff\xfe"])
def test_binary_files_are_refused(tmp_path, junk):
    path = tmp_path / "0000.txt"
    path.write_bytes(junk)
    for read in (
        read_kitti_labels,
        read_kitti_detections,
        read_kitti_calibration,
        read_kitti_poses,
    ):
        with pytest.raises(FormatError, match="expected text, got binary data"):
            read(path)


def test_real_sequences_can_be_read():
    folder = os.environ.get("ROADSCOPE_KITTI")
    if not folder:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    sequence = read_kitti_sequence(folder, KittiFolder.find(folder).sequences()[0])
    near, turned = [], []
    for detections, truth in zip(sequence.detections, sequence.truths, strict=True):
        if len(detections) and len(truth):
            world = detections.moved(truth.world_from_ego, "world")
            distances_m = np.linalg.norm(world.centres[None] - truth.centres[:, None], axis=-1)
            near += distances_m.min(axis=1).tolist()
            turn = world.yaws[distances_m.argmin(axis=1)] - truth.yaws
            turned += np.abs(np.sin(turn)).tolist()
    assert np.median(near) < 0.5
    assert np.median(turned) < 0.1


def test_hidden_files_are_not_read(tmp_path):
    """macOS leaves `._NAME` beside every file on disks of other systems."""
    root = write_kitti(tmp_path)
    before = KittiFolder.find(root)
    contents_before = before.sequences(), before.detectors(), before.scores_are_normalized("toy")
    for path in [path for path in root.rglob("*") if path.is_file()]:
        path.with_name(f"._{path.name}").write_bytes(bytes([0, 5, 22, 7]) * 64)
    (root / "._det_toy").write_bytes(b"")
    after = KittiFolder.find(root)
    assert (
        after.sequences(),
        after.detectors(),
        after.scores_are_normalized("toy"),
    ) == contents_before
