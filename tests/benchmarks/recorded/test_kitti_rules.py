"""What counts under KITTI's rules; the same sequences and scores as TrackEval's pipeline."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_kitti import write_kitti

from roadscope.benchmarks.recorded import BOX_SIMILARITIES, apply_kitti_rules
from roadscope.core import Category, TrackState
from roadscope.formats import (
    KittiFolder,
    KittiObjects,
    KittiType,
    kitti_objects,
    read_kitti_labels,
    read_kitti_sequence,
    write_kitti_results,
)
from roadscope.metrics import clear, hota, identity
from roadscope.trackers import TRACKERS

CLASSES = {"car": Category.CAR, "pedestrian": Category.PEDESTRIAN}
KINDS = {Category.CAR: KittiType.CAR, Category.PEDESTRIAN: KittiType.PEDESTRIAN}


def rows(*boxes, types=KittiType.CAR, ids=None, truncated=0, occluded=0):
    """Objects of frame 0 with these image boxes; 3-D boxes in a row 20 m apart."""
    n = len(boxes)
    return KittiObjects(
        np.zeros(n, np.int64),
        np.arange(n) if ids is None else np.array(ids),
        np.broadcast_to(types, n),
        np.broadcast_to(truncated, n),
        np.broadcast_to(occluded, n),
        np.zeros(n),
        np.array(boxes, float).reshape(n, 4),
        np.tile([4.0, 2.0, 1.5], (n, 1)),
        np.column_stack([np.zeros(n), np.zeros(n), 20.0 * (1 + np.arange(n))]),
        np.zeros(n),
        np.ones(n),
    )


A, B, C = (0, 0, 100, 100), (200, 0, 300, 100), (400, 0, 500, 100)
SMALL = (600, 0, 640, 25)


def count(labels, tracks, kind=KittiType.CAR, similarity="iou_2d"):
    """Objects and tracks that are left of one frame."""
    sequence = apply_kitti_rules([labels], [tracks], kind, similarity)
    return sequence.truth_ids.tolist(), sequence.track_ids.tolist()


def test_vans_are_distractors_of_cars_and_sitting_people_of_pedestrians():
    labels = rows(A, B, types=[KittiType.CAR, KittiType.VAN])
    assert count(labels, rows(A, B, C)) == ([0], [0, 2])
    people = rows(A, B, types=[KittiType.PEDESTRIAN, KittiType.PERSON])
    tracks = rows(A, B, C, types=KittiType.PEDESTRIAN)
    assert count(people, tracks, KittiType.PEDESTRIAN) == ([0], [0, 2])
    trucks = rows(A, B, types=[KittiType.CAR, KittiType.TRUCK])
    assert count(trucks, rows(A, B)) == ([0], [0, 1])


@pytest.mark.parametrize(
    ("change", "counts"),
    [
        ({"occluded": 2}, True),
        ({"occluded": 3}, False),
        ({"truncated": 0}, True),
        ({"truncated": 1}, False),
    ],
)
def test_what_is_hidden_or_cut_off_is_a_distractor(change, counts):
    assert count(rows(A, **change), rows(A)) == (([0], [0]) if counts else ([], []))


def test_small_tracks_count_only_where_they_match():
    assert count(rows(A), rows(SMALL)) == ([0], [])
    assert count(rows(SMALL), rows(SMALL)) == ([0], [0])
    taller = (*SMALL[:3], 25.5)
    assert count(rows(A), rows(taller)) == ([0], [0])


def test_tracks_mostly_in_an_unlabelled_region_do_not_count():
    region = KittiType.DONT_CARE
    labels = rows(A, (180, 0, 260, 100), types=[KittiType.CAR, region], ids=[0, -1])
    assert count(labels, rows(B, C)) == ([0], [1])
    less = rows(A, (180, 0, 245, 100), types=[KittiType.CAR, region], ids=[0, -1])
    assert count(less, rows(B, C)) == ([0], [0, 1])


@pytest.mark.parametrize("similarity", BOX_SIMILARITIES)
def test_matching_rules_hold_for_every_similarity(similarity):
    labels = rows(A, B, types=[KittiType.CAR, KittiType.VAN])
    assert count(labels, rows(A, B, C), similarity=similarity) == ([0], [0, 2])


@pytest.mark.parametrize("similarity", BOX_SIMILARITIES)
def test_the_image_decides_what_counts_for_every_similarity(similarity):
    """A track on a van in the image does not count, however far behind it in space."""
    labels = rows(A, B, types=[KittiType.CAR, KittiType.VAN])
    tracks = rows(A, B, C)
    behind = replace(tracks, bottoms=tracks.bottoms + np.array([0.0, 0.0, 6.0]))
    assert count(labels, behind, similarity=similarity) == ([0], [0, 2])
    aside = rows(A, (260, 0, 360, 100), C)  # the van's place in space, another one in the image
    assert count(labels, aside, similarity=similarity) == ([0], [0, 1, 2])


def test_centres_at_the_gate_are_half_alike():
    labels, tracks = rows(A), rows(A)
    aside = replace(tracks, bottoms=tracks.bottoms + np.array([2.0, 5.0, 0.0]))
    assert apply_kitti_rules([labels], [aside], KittiType.CAR, "centre").similarities[
        0
    ] == pytest.approx(0.5)
    assert apply_kitti_rules([labels], [aside], KittiType.CAR, "centre").distances_m[
        0
    ] == pytest.approx(2)
    assert apply_kitti_rules([labels], [aside], KittiType.CAR, "iou_3d").similarities[0] == 0


def write_tracks(folder: Path, name: str, category: Category, out: Path) -> None:
    """Track one class of a sequence and write the results."""
    sequence = read_kitti_sequence(folder, name, category)
    tracker = TRACKERS.make("nearest-q-confirmed")
    tracker.reset()
    frames = []
    for t, (detections, pose) in enumerate(
        zip(sequence.detections, sequence.world_from_ego, strict=True)
    ):
        tracks = tracker.update(detections, pose)
        objects = kitti_objects(
            tracks, t, pose, sequence.calibration.projection, sequence.image_size
        )
        sure = tracks.ids[tracks.states != TrackState.TENTATIVE]
        frames.append(objects.select(np.isin(objects.ids, sure)))
    out.mkdir(parents=True, exist_ok=True)
    write_kitti_results(out / f"{name}.txt", frames)


def assert_as_trackeval(folder: Path, names: list[str], lengths: list[int], work: Path) -> None:
    """The whole way through TrackEval's files, dataset and metrics, and through ours."""
    trackeval = pytest.importorskip("trackeval")
    gt = work / "gt"
    gt.mkdir()
    (gt / "label_02").symlink_to(folder / "label_02")
    lines = [f"{n} empty 000000 {k:06d}\n" for n, k in zip(names, lengths, strict=True)]
    (gt / "evaluate_tracking.seqmap.training").write_text("".join(lines))
    quiet = {"PRINT_CONFIG": False}
    for word, category in CLASSES.items():
        for name in names:
            write_tracks(folder, name, category, work / word / "mine" / "data")
        config = {**quiet, "GT_FOLDER": str(gt), "TRACKERS_FOLDER": str(work / word)}
        dataset = trackeval.datasets.Kitti2DBox({**config, "CLASSES_TO_EVAL": [word]})
        for name, length in zip(names, lengths, strict=True):
            raw = dataset.get_raw_seq_data("mine", name)
            data = dataset.get_preprocessed_seq_data(raw, word)
            labels = read_kitti_labels(folder / "label_02" / f"{name}.txt").by_frame(length)
            result = read_kitti_labels(work / word / "mine" / "data" / f"{name}.txt", results=True)
            ours = apply_kitti_rules(labels, result.by_frame(length), KINDS[category])
            assert_same_scores(trackeval.metrics, data, ours, quiet)


def assert_same_scores(metrics, data, ours, quiet) -> None:
    assert (len(ours.truth_ids), len(ours.track_ids)) == (
        data["num_gt_dets"],
        data["num_tracker_dets"],
    )
    theirs, mine = metrics.HOTA().eval_sequence(data), hota(ours)
    for key, value in (
        ("HOTA", mine.hota),
        ("DetA", mine.det_a),
        ("AssA", mine.ass_a),
        ("LocA", mine.loc_a),
    ):
        np.testing.assert_allclose(value, theirs[key], atol=1e-9)
    theirs, mine = metrics.CLEAR(quiet).eval_sequence(data), clear(ours)
    assert mine.id_switches == theirs["IDSW"]
    assert mine.fragmentations == theirs["Frag"]
    assert (mine.matches, mine.misses) == (theirs["CLR_TP"], theirs["CLR_FN"])
    assert mine.false_alarms == theirs["CLR_FP"]
    if data["num_gt_dets"]:
        assert mine.mota == pytest.approx(theirs["MOTA"], abs=1e-9)
    assert mine.motp == pytest.approx(theirs["MOTP"], abs=1e-9)
    theirs, mine = metrics.Identity(quiet).eval_sequence(data), identity(ours)
    assert mine.idf1 == pytest.approx(theirs["IDF1"], abs=1e-9)


def test_toy_sequences_score_as_with_trackeval(tmp_path):
    folder = write_kitti(tmp_path / "kitti")
    assert_as_trackeval(folder, ["0000", "0001"], [30, 30], tmp_path)


def test_real_sequences_score_as_with_trackeval(tmp_path):
    where = os.environ.get("ROADSCOPE_KITTI")
    if not where:
        pytest.skip("ROADSCOPE_KITTI names no folder of KITTI tracking data")
    folder = KittiFolder.find(where)
    names = folder.sequences()[:3]
    lengths = [len(folder.poses(n).read_text().splitlines()) for n in names]
    assert_as_trackeval(folder.root, names, lengths, tmp_path)
