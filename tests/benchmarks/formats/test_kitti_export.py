import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_boxes import detections_of
from toy_kitti import IMAGE_SIZE, P2, tracks_at, write_kitti

from roadscope.benchmarks.formats import detections_from_rows
from roadscope.core import Category, Pose, Tracks, wrap_angle
from roadscope.formats import (
    KittiType,
    kitti_objects,
    read_kitti_labels,
    read_kitti_sequence,
    write_kitti_results,
)
from roadscope.trackers import TRACKERS

PRINTED = 1e-6


@given(st.integers(0, 1000))
@settings(max_examples=30)
def test_results_come_back_within_printed_digits(tmp_path_factory, seed):
    rng = np.random.default_rng(seed)
    centres = np.column_stack(
        [rng.uniform(5, 60, 6), rng.uniform(-4, 4, 6), rng.normal(-1, 0.3, 6)]
    )
    yaw, pitch, roll = rng.uniform(-3, 3), *rng.uniform(-0.06, 0.06, 2)
    pose = Pose.from_euler(*rng.uniform(-100, 100, 3), yaw=yaw, pitch=pitch, roll=roll)
    world = tracks_at(centres).moved(pose, "world")
    rows = kitti_objects(world, 4, pose, P2, IMAGE_SIZE)
    path = tmp_path_factory.getbasetemp() / "results.txt"
    write_kitti_results(path, [rows])
    back = read_kitti_labels(path, results=True)
    for name in ("frames", "ids", "types", "truncated", "occluded"):
        np.testing.assert_array_equal(getattr(back, name), getattr(rows, name))
    for name in ("boxes", "sizes", "bottoms", "rotations_y", "scores", "alphas"):
        np.testing.assert_allclose(getattr(back, name), getattr(rows, name), atol=PRINTED)
    boxes = detections_from_rows(back, Category.CAR, stamp_s=0.0)
    shown = rows.ids - 7
    np.testing.assert_allclose(boxes.centres, centres[shown], atol=3 * PRINTED)
    turned = wrap_angle(boxes.yaws - np.linspace(-3, 3, 6)[shown])
    np.testing.assert_allclose(turned, 0, atol=3 * PRINTED)


def test_what_the_image_does_not_show_is_left_out():
    tracks = tracks_at(np.array([[20.0, 0, -1], [-20, 0, -1], [20, 60, -1]]))
    rows = kitti_objects(tracks, 0, Pose.identity(), P2, IMAGE_SIZE)
    assert rows.ids.tolist() == [7]


def test_empty_results_are_no_error(tmp_path):
    path = str(tmp_path / "0000.txt")
    write_kitti_results(path, [])
    assert len(read_kitti_labels(path, results=True)) == 0


def test_every_category_has_a_type():
    kinds = np.arange(len(Category), dtype=np.int8)
    centres = np.column_stack([10.0 + 3 * kinds, np.zeros(7), np.full(7, -1)])
    rows = kitti_objects(tracks_at(centres, categories=kinds), 0, Pose.identity(), P2, IMAGE_SIZE)
    assert rows.types[Category.CAR] == KittiType.CAR
    assert rows.types[Category.PEDESTRIAN] == KittiType.PEDESTRIAN
    assert rows.types[Category.BUS] == KittiType.MISC


def test_labels_projected_are_the_image_boxes_that_they_come_with(tmp_path):
    car = read_kitti_sequence(write_kitti(tmp_path), "0000")
    truth, labels = car.truths[3], car.label_rows[3]
    tracks = Tracks.of(detections_of(truth), truth.ids)
    rows = kitti_objects(tracks, 3, truth.world_from_ego, P2, IMAGE_SIZE)
    expected = labels.select(labels.types == KittiType.CAR)
    assert rows.ids.tolist() == expected.ids.tolist()
    np.testing.assert_allclose(rows.boxes, expected.boxes, atol=1e-3)
    np.testing.assert_allclose(rows.alphas, expected.alphas, atol=1e-5)


def test_trackeval_reads_our_results(tmp_path):
    trackeval = pytest.importorskip("trackeval")
    folder = write_kitti(tmp_path / "gt")
    map_of = folder / "evaluate_tracking.seqmap.training"
    map_of.write_text("0000 empty 000000 000030\n0001 empty 000000 000030\n")
    written = {}
    for name in ("0000", "0001"):
        car = read_kitti_sequence(folder, name)
        tracker = TRACKERS.make("nearest-q-confirmed")
        tracker.reset()
        frames = [
            kitti_objects(tracker.update(d, p), t, p, P2, IMAGE_SIZE)
            for t, (d, p) in enumerate(zip(car.detections, car.world_from_ego, strict=True))
        ]
        out = tmp_path / "trackers" / "mine" / "data"
        out.mkdir(parents=True, exist_ok=True)
        write_kitti_results(out / f"{name}.txt", frames)
        written[name] = frames
    config = {
        "GT_FOLDER": str(folder),
        "TRACKERS_FOLDER": str(tmp_path / "trackers"),
        "PRINT_CONFIG": False,
        "CLASSES_TO_EVAL": ["car"],
    }
    dataset = trackeval.datasets.Kitti2DBox(config)
    raw = dataset.get_raw_seq_data("mine", "0001")
    for t, rows in enumerate(written["0001"]):
        assert raw["tracker_ids"][t].tolist() == rows.ids.tolist()
        np.testing.assert_allclose(raw["tracker_dets"][t], rows.boxes, atol=PRINTED)
        np.testing.assert_allclose(raw["tracker_confidences"][t], rows.scores, atol=PRINTED)
