import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from toy_boxes import detections_of
from toy_kitti import write_kitti

from roadscope import compare
from roadscope.benchmarks import (
    Episode,
    ExportError,
    FolderError,
    RunOptions,
    SubmitError,
    detection_source,
    export_suite,
    folder_estimates,
    parked_among,
    parse_suite,
    plan_export,
    read_manifest,
    sensed,
    submit,
    submit_kitti,
    submit_mot,
)
from roadscope.benchmarks.boards import JobOptions, board_named, detection_parts, detection_scores
from roadscope.benchmarks.formats import KittiCameras, read_image, trajectory_text
from roadscope.benchmarks.metrics import Trajectories, score_odometry
from roadscope.benchmarks.metrics.tracking import score_tracks
from roadscope.benchmarks.nodes import DetectionNode
from roadscope.benchmarks.results import JobScores
from roadscope.core import Calibration, CameraImage, Category, Frame, Spec, Tracks, wrap_angle
from roadscope.detectors.camera import CAMERA_DETECTORS
from roadscope.envs import find_rig
from roadscope.formats import (
    FormatError,
    ScanFolder,
    kitti_objects,
    read_imu,
    read_kitti_sequence,
    read_trajectory,
    read_wheels,
    write_kitti_results,
)
from roadscope.trackers import TRACKERS

SUITE = """
name = "tiny"
version = 1
rig = "vlp16-imu"
scenarios = ["lu2018-three-vehicles", "lu2018-occlusion"]
seeds = 1
duration_s = 2.0
[tracking]
entries = ["nearest"]
detectors = ["distance-l-shape", "oracle"]
[odometry]
entries = ["lidar-inertial"]
lengths_m = [2.0]
"""
FAULTY = """seeds = 1
faults = ["dropped-scans:4"]"""
DETECTOR = "distance-l-shape"
SEED = 20_000
PRINTED = 2e-6


def suite_of(text: str = SUITE):
    return parse_suite(text, "tiny")


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("suite") / "exported"
    return export_suite(plan_export(suite_of(), folder, with_truth=True))


@pytest.fixture(scope="module")
def episode() -> Episode:
    return Episode("lu2018-three-vehicles", SEED, "vlp16-imu", 2.0)


def truths_of(episode):
    return [truth for _, truth in sensed(episode)]


def test_scans_come_back_as_they_were(exported, episode) -> None:
    scans = ScanFolder.find(exported / "velodyne" / "0000")
    frames = [frame for frame, _ in sensed(episode)]
    assert len(scans) == len(frames)
    for scan, frame in zip(scans, frames, strict=True):
        np.testing.assert_array_equal(scan.points, frame.lidar.points)
        np.testing.assert_allclose(scan.intensity, frame.lidar.intensity)
        assert scan.stamp_s == pytest.approx(frame.stamp_s, abs=1e-9)
        # About the middle of what was seen, where the record has the middle of the sweep.
        offset_differences = scan.time_offset_s - frame.lidar.time_offset_s
        assert np.ptp(offset_differences) < 1e-6
        assert abs(offset_differences).max() < 5e-3
    times = np.fromfile(exported / "velodyne_times" / "0000" / "000003.bin", "<f4")
    np.testing.assert_array_equal(times, frames[3].lidar.time_offset_s)


def test_inertial_samples_come_back(exported, episode) -> None:
    samples, left_out = read_imu(exported / "imu" / "0000.csv")
    felt = [frame.imu for frame, _ in sensed(episode)]
    np.testing.assert_allclose(
        samples.specific_force, np.concatenate([i.specific_force for i in felt]), atol=1e-8
    )
    assert left_out == 0
    rolled, left_out = read_wheels(exported / "wheels" / "0000.csv")
    speeds = [frame.wheels.speeds for frame, _ in sensed(episode)]
    np.testing.assert_allclose(rolled.speeds, np.concatenate(speeds), atol=1e-8)
    assert left_out == 0


def test_the_truth_of_all_objects_is_written(exported, episode) -> None:
    with (exported / "truth" / "0000.csv").open() as file:
        rows = list(csv.DictReader(file))
    for number, truth in enumerate(truths_of(episode)):
        own = [row for row in rows if row["frame"] == str(number)]
        for column, values in (("id", truth.ids), ("lidar_returns", truth.lidar_returns)):
            assert [int(row[column]) for row in own] == values.tolist()
        assert [Category[row["category"].upper()] for row in own] == truth.categories.tolist()
        places = [[float(row[name]) for name in ("x_m", "y_m", "z_m", "yaw_rad")] for row in own]
        wanted = np.column_stack([truth.centres, truth.yaws])
        np.testing.assert_allclose(places, wanted, atol=PRINTED)


def test_labels_and_poses_come_back_by_the_reader_of_kitti(exported, episode) -> None:
    sequence = read_kitti_sequence(exported, "0000", Category.CAR, detector=DETECTOR)
    truths = truths_of(episode)
    assert len(sequence) == len(truths)
    lidar = find_rig("vlp16-imu").lidar.ego_from_lidar
    labelled = 0
    for read, pose, truth in zip(sequence.truths, sequence.world_from_ego, truths, strict=True):
        # Without a camera the reader's ego is the LiDAR.
        wanted = truth.world_from_ego @ lidar
        np.testing.assert_allclose(pose.matrix, wanted.matrix, atol=1e-9)
        rows = [truth.ids.tolist().index(i) for i in read.ids.tolist()]
        assert (truth.lidar_returns[rows] > 0).all()
        np.testing.assert_allclose(read.centres, truth.centres[rows], atol=PRINTED)
        np.testing.assert_allclose(read.sizes, truth.sizes[rows], atol=PRINTED)
        np.testing.assert_allclose(wrap_angle(read.yaws - truth.yaws[rows]), 0, atol=PRINTED)
        labelled += len(rows)
    assert labelled > 0


def test_our_tracker_runs_on_the_exported_detections(exported) -> None:
    sequence = read_kitti_sequence(exported, "0000", Category.CAR, detector=DETECTOR)
    tracker = TRACKERS.make("nearest")
    tracker.reset()
    for frame_detections, pose in zip(sequence.detections, sequence.world_from_ego, strict=True):
        tracks = tracker.update(frame_detections, pose)
    assert len(tracks) > 0


def test_an_odometry_runs_on_the_exported_scans(exported) -> None:
    scans = ScanFolder.find(exported / "velodyne" / "0000")
    estimates = list(folder_estimates(scans, "lidar-inertial"))
    assert len(estimates) == len(scans)


def test_truth_of_test_seeds_is_written_only_if_asked(tmp_path) -> None:
    text = SUITE.replace("2.0\n[tracking]", "0.5\n[tracking]")
    plan = plan_export(suite_of(text), tmp_path / "test", scenarios=["lu2018-occlusion"])
    assert plan.manifest.detections == (DETECTOR,)
    folder = export_suite(plan)
    hidden = ("label_02", "truth", "lidar_pose")
    assert not any((folder / name).exists() for name in hidden)
    assert (folder / "velodyne" / "0000" / "000000.bin").is_file()
    with pytest.raises(ExportError, match="truth"):
        plan_export(suite_of(), tmp_path / "other", detections=["oracle"])
    validation = text.replace("seeds = 1", 'seeds = 1\nsplit = "validation"')
    plan = plan_export(
        suite_of(validation), tmp_path / "more", scenarios=["lu2018-occlusion"], detections=()
    )
    folder = export_suite(plan)
    assert all((folder / name / "0000.txt").is_file() for name in ("label_02", "lidar_pose"))
    assert not list(folder.glob("det_*"))


def test_images_are_taken_with_the_scans(tmp_path) -> None:
    from PIL import Image

    text = SUITE.replace("vlp16-imu", "wide").replace("2.0\n[tracking]", "0.3\n[tracking]")
    plan = plan_export(
        suite_of(text),
        tmp_path / "wide",
        scenarios=["lu2018-three-vehicles"],
        with_truth=True,
        detections=(),
    )
    folder = export_suite(plan)
    scans = sorted((folder / "velodyne" / "0000").glob("*.bin"))
    images = sorted((folder / "image_02" / "0000").glob("*.png"))
    assert [p.stem for p in images] == [p.stem for p in scans]
    with Image.open(images[0]) as image:
        assert image.size == (640, 480)
    assert (folder / "label_02" / "0000.txt").read_text()
    read, wide = KittiCameras.find(folder / "calib").of("0000"), find_rig("wide")
    mounted = wide.camera.ego_from_camera.inverse() @ wide.lidar.ego_from_lidar
    np.testing.assert_allclose(read.camera_from_lidar.matrix, mounted.matrix, atol=PRINTED)
    intrinsics = wide.camera.spec.pinhole.intrinsics
    np.testing.assert_allclose(read.projection[:, :3], intrinsics, atol=PRINTED)


def test_lost_scans_of_a_rig_in_a_file(tmp_path) -> None:
    rig_file = tmp_path / "mine.toml"
    rig_file.write_text('lidar = "vlp16"\n')
    text = SUITE.replace("vlp16-imu", str(rig_file)).replace("seeds = 1", FAULTY)
    some = {"scenarios": ["lu2018-three-vehicles"], "with_truth": True, "detections": ()}
    folder = export_suite(plan_export(suite_of(text), tmp_path / "exported", **some))
    # The folder has all that scoring needs.
    rig_file.unlink()
    (sequence,) = read_manifest(folder).sequences
    sizes = [path.stat().st_size for path in sorted((folder / "velodyne" / "0000").glob("*.bin"))]
    assert sequence.lost == tuple(np.flatnonzero(np.array(sizes) == 0).tolist())
    assert 0 < len(sequence.lost) < sequence.frames == len(sizes)
    true = read_trajectory(folder / "lidar_pose" / "0000.txt", "tum").poses
    arrived = [pose for k, pose in enumerate(true) if k not in sequence.lost]
    results = tmp_path / "mine" / "odometry" / "0000.txt"
    results.parent.mkdir(parents=True)
    for poses in (true, arrived):
        results.write_text(trajectory_text("kitti", poses, [0.0] * len(poses)))
        (own,) = submit(tmp_path / "mine", suite=folder).episodes
        assert own.condition == "dropped-scans:4"
        assert own.scores["end"].value == pytest.approx(0, abs=1e-6)


def test_a_stopped_export_goes_on(tmp_path, exported) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(exported, folder)
    path = folder / "manifest.json"
    content = json.loads(path.read_text())
    content["sequences"][1] |= {"digest": "", "frames": 0}
    path.write_text(json.dumps(content))
    unchanged_file, lost = folder / "calib" / "0000.txt", folder / "calib" / "0001.txt"
    unchanged_file.write_text("mine")
    lost.unlink()
    plan = plan_export(suite_of(), folder, with_truth=True)
    assert plan.done == 1
    export_suite(plan)
    assert unchanged_file.read_text() == "mine"
    assert lost.is_file()
    assert read_manifest(folder) == read_manifest(exported)


def test_folders_of_something_else_are_left_alone(tmp_path, exported) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    for folder in (tmp_path, mine):
        with pytest.raises(FolderError):
            plan_export(suite_of(), folder)
    with pytest.raises(FolderError, match="another export"):
        plan_export(suite_of(), exported, with_truth=False)
    assert mine.read_text() == "mine"


def test_what_cannot_be_exported_is_refused(tmp_path) -> None:
    with pytest.raises(ExportError, match="1 seeds"):
        plan_export(suite_of(), tmp_path, seeds=4)
    with pytest.raises(ExportError, match="lu2018-occlusion"):
        plan_export(suite_of(), tmp_path, scenarios=["lu2018-oclusion"])


def test_a_plan_says_how_much(tmp_path, exported) -> None:
    plan = plan_export(suite_of(), tmp_path / "new")
    written = list((exported / "velodyne").glob("*/*.bin"))
    assert plan.scans == pytest.approx(len(written), abs=4)
    assert sum(p.stat().st_size for p in written) <= plan.bytes_at_most
    assert not (tmp_path / "new").exists()


def perfect(exported: Path, out: Path, sequences=("0000", "0001"), off_m: float = 0.0) -> Path:
    """Write results that are the labelled truth, all of it moved by some metres."""
    content = {s.name: s for s in read_manifest(exported).sequences}
    lidar = find_rig("vlp16-imu").lidar.ego_from_lidar
    for name in sequences:
        episode = Episode(content[name].scenario, SEED, "vlp16-imu", 2.0)
        rows, poses, stamps = [], [], []
        for number, truth in enumerate(truths_of(episode)):
            pose = truth.world_from_ego @ lidar
            tracks = Tracks.of(detections_of(truth, off_m=off_m, scores=0.9), truth.ids)
            rows.append(kitti_objects(tracks, number, pose, P2, (1242, 375), all_around=True))
            poses.append(pose)
            stamps.append(truth.stamp_s)
        for board in ("tracking", "odometry"):
            (out / board).mkdir(parents=True, exist_ok=True)
        write_kitti_results(out / "tracking" / f"{name}.txt", rows)
        form = "tum" if name == "0000" else "kitti"
        (out / "odometry" / f"{name}.txt").write_text(trajectory_text(form, poses, stamps))
    return out


P2 = np.array([[358.5, 0, 621, 0], [0, 358.5, 187.5, 0], [0, 0, 1, 0]])


def test_perfect_results_are_perfect(exported, tmp_path) -> None:
    results = submit(perfect(exported, tmp_path / "mine"), suite=exported)
    assert results.name == "mine"
    assert results.boards() == ["tracking", "odometry"]
    for e in results.episodes:
        assert e.reason is None
        if e.board == "tracking":
            assert e.scores["hota"].value == pytest.approx(1, abs=1e-4)
            assert e.scores["position_rmse_m"].value < 1e-5
            assert "nees_state" not in e.scores
        else:
            assert e.scores["end"].value == pytest.approx(0, abs=1e-6)


def test_the_oracle_gets_its_own_scores_back(exported, tmp_path, episode) -> None:
    rule = read_manifest(exported).eligibility
    node = DetectionNode(detection_source("oracle"), episode, rule)
    oracle = node.compute(RunOptions())
    lidar = find_rig("vlp16-imu").lidar.ego_from_lidar
    folder = tmp_path / "mine" / "detection" / "0000"
    for number, (boxes, truth) in enumerate(zip(oracle.detections, oracle.truths, strict=True)):
        tracks, pose = Tracks.of(boxes, np.arange(len(boxes))), truth.world_from_ego @ lidar
        rows = kitti_objects(tracks, number, pose, P2, (1242, 375), all_around=True)
        path = folder / f"{number:06d}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_kitti_results(path, [rows])
        lines = [line.split(" ", 2)[2] for line in path.read_text().splitlines()]
        path.write_text("".join(f"{line}\n" for line in lines))
    results = submit(tmp_path / "mine", suite=exported)
    assert results.boards() == ["detection"]
    (own, missing) = results.episodes
    assert missing.reason == "no result file detection/0001"
    wanted = {**detection_scores(oracle, rule, timed=False), **detection_parts(oracle, rule)}
    assert set(own.scores) == set(wanted)
    for metric, score in wanted.items():
        close = pytest.approx(score.value, abs=1e-4, nan_ok=True)
        assert (own.scores[metric].value, own.scores[metric].n) == (close, score.n), metric
    assert own.scores["f1"].value == 1
    (folder / "000003.txt").unlink()
    with pytest.raises(FormatError, match=r"000003\.txt"):
        submit(tmp_path / "mine", suite=exported)
    (folder / "000003.txt").write_text("Car 0 0 0 0 0 9 9 -1 -1 -1 1 2 3 0 0.5\n")
    with pytest.raises(FormatError, match=r"000003\.txt.*3-D"):
        submit(tmp_path / "mine", suite=exported)


IMAGES = """
name = "images"
version = 1
rig = "wide"
scenarios = ["street"]
faults = ["clear", "blackout:4"]
seeds = 1
duration_s = 0.8
[camera]
every_s = 0.2
"""
TYPES = {
    Category.CAR: "Car",
    Category.VAN: "Van",
    Category.TRUCK: "Truck",
    Category.BUS: "Tram",
    Category.MOTORCYCLE: "Misc",
    Category.CYCLIST: "Cyclist",
    Category.PEDESTRIAN: "Pedestrian",
}


@pytest.fixture(scope="module")
def exported_images(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("images") / "exported"
    return export_suite(plan_export(suite_of(IMAGES), folder, detections=()))


def write_image_results(folder: Path, boxes_by_row, gain: float = 1.0) -> None:
    """Write boxes in images, by the number of the image, as KITTI object results.

    gain: factor of the scores. Numbers have all digits; nothing is known in space.
    """
    folder.mkdir(parents=True)
    for number, boxes in boxes_by_row.items():
        lines = [
            f"{TYPES[Category(category)]} -1 -1 -10 {' '.join(map(repr, box))} "
            f"-1 -1 -1 -1000 -1000 -1000 -10 {gain * score!r}\n"
            for category, box, score in zip(
                boxes.categories.tolist(), boxes.boxes.tolist(), boxes.scores.tolist(), strict=True
            )
        ]
        (folder / f"{number:06d}.txt").write_text("".join(lines))


def camera_answers(entry: str):
    """Return the answers of an entry of the camera board, and its scores without times of calls."""
    board, options = board_named("camera"), RunOptions()
    spec = board.check_entry(Spec.parse(entry))
    for job in board.jobs(suite_of(IMAGES), [spec], JobOptions(marks=False)):
        answers = job.answers.read(options)
        scores = board.score(job, answers, options)
        yield answers, {name: score for name, score in scores.items() if "_ms" not in name}


def test_results_on_exported_images_have_the_scores_of_an_entry(exported_images, tmp_path) -> None:
    detector, numbers = CAMERA_DETECTORS.make("colour-blobs"), []
    for sequence in ("0000", "0001"):
        detector.reset()
        detections_by_frame = {}
        for path in sorted((exported_images / "camera_images" / sequence).glob("*.png")):
            image = CameraImage(read_image(path), np.eye(3), 0.0, "camera")
            detections_by_frame[int(path.stem)] = detector.detect(
                Frame(0.0, Calibration(), camera=image)
            )
        write_image_results(tmp_path / "camera" / sequence, detections_by_frame)
        numbers.append(list(detections_by_frame))
    # Of 20 images a second, every fourth is used. The second sequence lost some.
    assert numbers[0] == [0, 4, 8, 12]
    assert 0 < len(numbers[1]) < 4
    own = submit(tmp_path, suite=exported_images).episodes
    assert [(e.board, e.condition, e.reason) for e in own] == [
        ("camera", "clear", None),
        ("camera", "blackout:4", None),
    ]
    for episode, (_, wanted) in zip(own, camera_answers("colour-blobs"), strict=True):
        assert_same_scores(episode.scores, wanted)
    assert own[0].scores["false_alarms"].value > 0


def assert_same_scores(scores, wanted) -> None:
    assert scores.keys() == wanted.keys()
    for metric, score in wanted.items():
        assert repr(scores[metric]) == repr(score), metric


def test_scores_of_results_in_images_are_mapped_to_0_to_1(exported_images, tmp_path) -> None:
    expected = []
    for sequence, (answers, wanted) in enumerate(camera_answers("noisy-camera")):
        rows = zip(answers.rows.tolist(), answers.detections, strict=True)
        boxes_by_row = {row: boxes for row, boxes in rows if boxes is not None}
        for name, gain in (("mine", 1.0), ("unscaled", 9.0)):
            write_image_results(tmp_path / name / "camera" / f"{sequence:04d}", boxes_by_row, gain)
        expected.append(wanted)
    mine, unscaled = (
        submit(tmp_path / name, suite=exported_images).episodes for name in ("mine", "unscaled")
    )
    for own, other, wanted in zip(mine, unscaled, expected, strict=True):
        assert_same_scores(own.scores, wanted)
        assert 0 < own.scores["ap50"].value < 1
        # The logistic function keeps their order.
        assert other.scores["ap50"] == own.scores["ap50"]


def test_bad_results_in_images_are_refused(exported, exported_images, tmp_path) -> None:
    folder = tmp_path / "camera" / "0000"
    (answers, _), *_ = camera_answers("noisy-camera")
    write_image_results(folder, dict(zip(answers.rows.tolist(), answers.detections, strict=True)))
    missing = submit(tmp_path, suite=exported_images).episodes[1]
    assert missing.reason == "no result file camera/0001"
    (folder / "000004.txt").write_text("Car -1 -1 -10 -1 -1 -1 -1 1.5 1.8 4 1 2 9 0 0.5\n")
    with pytest.raises(FormatError, match=r"000004\.txt.*boxes in the image"):
        submit(tmp_path, suite=exported_images)
    (folder / "000004.txt").unlink()
    with pytest.raises(FormatError, match=r"000004\.txt"):
        submit(tmp_path, suite=exported_images)
    (folder / "000004.txt").write_text("")
    (folder / "000007.txt").write_text("")
    with pytest.raises(SubmitError, match=r"000007\.txt"):
        submit(tmp_path, suite=exported_images)
    with pytest.raises(SubmitError, match=r"vlp16-imu, has no camera"):
        submit(tmp_path, suite=exported)


def test_exports_without_images_of_the_camera_board_are_refused(exported_images, tmp_path) -> None:
    content = json.loads((exported_images / "manifest.json").read_text())
    del content["camera_every_s"]
    (tmp_path / "manifest.json").write_text(json.dumps(content))
    (tmp_path / "camera").mkdir()
    with pytest.raises(SubmitError, match="export the suite again"):
        submit(tmp_path)


def test_results_of_fusions_are_refused(exported_images, tmp_path) -> None:
    (tmp_path / "fusion" / "0000").mkdir(parents=True)
    with pytest.raises(SubmitError, match="which sensor"):
        submit(tmp_path, suite=exported_images)


def test_scores_are_those_of_the_metrics(exported, tmp_path, episode) -> None:
    out = perfect(exported, tmp_path / "mine", off_m=0.5)
    results = submit(out, suite=exported, name="off", inputs=DETECTOR)
    (own,) = [
        e for e in results.episodes if (e.board, e.scenario) == ("tracking", episode.scenario)
    ]
    truths = truths_of(episode)
    boxes = [detections_of(t, off_m=0.5, scores=0.9) for t in truths]
    tracks = [Tracks.of(b, t.ids) for b, t in zip(boxes, truths, strict=True)]
    rule = read_manifest(exported).eligibility
    pairings = rule.pairings(tracks, truths, parked_among(episode, truths))
    wanted = score_tracks(tracks, truths, pairings).named()
    for metric in ("hota", "mota", "idf1", "position_rmse_m", "gospa_m", "amota"):
        assert own.scores[metric].value == pytest.approx(wanted[metric].value, abs=1e-4)
    assert own.scores["position_rmse_m"].value == pytest.approx(0.5, abs=1e-4)
    assert own.inputs == DETECTOR
    for job in results.episodes:
        assert (job.entry, job.seed) == ("off", SEED)
        assert JobScores.from_json(json.loads(json.dumps(job.to_json()))).name == job.name


def test_scores_of_poses_are_those_of_the_metrics(exported, tmp_path) -> None:
    out = perfect(exported, tmp_path / "mine")
    true = read_trajectory(out / "odometry" / "0000.txt", "tum")
    poses = [replace(p, matrix=p.matrix.copy()) for p in true.poses]
    for k, pose in enumerate(poses):
        pose.matrix[0, 3] += 0.01 * k
    (out / "odometry" / "0000.txt").write_text(trajectory_text("tum", poses, true.stamps_s))
    (own,) = [
        e
        for e in submit(out, suite=exported).episodes
        if e.board == "odometry" and e.scenario == "lu2018-three-vehicles"
    ]
    both = Trajectories(*(np.array([p.matrix for p in each]) for each in (poses, true.poses)))
    wanted = score_odometry(both, lengths_m=(2.0,)).named()
    for metric in ("t_rel", "end"):
        assert own.scores[metric].value == pytest.approx(wanted[metric].value, rel=1e-6)
        assert own.scores[metric].value > 0


@pytest.mark.slow
def test_submissions_are_compared_with_one_another(exported, tmp_path) -> None:
    good = submit(perfect(exported, tmp_path / "good"), suite=exported, name="mine")
    bad = submit(perfect(exported, tmp_path / "bad", off_m=0.7), suite=exported, name="mine")
    differences = {d.metric: d for d in compare(good, bad).differences if d.board == "tracking"}
    assert differences["position_rmse_m"].difference == pytest.approx(0.7, abs=1e-3)


def test_a_sequence_without_results_has_failed(exported, tmp_path) -> None:
    out = perfect(exported, tmp_path / "mine", sequences=("0000",))
    results = submit(out, suite=exported)
    assert [e.reason is None for e in results.episodes] == [True, True, False, False]
    assert compare(results, results).failures


def test_a_submission_is_one_more_row_of_a_board(exported, tmp_path) -> None:
    out = perfect(exported, tmp_path / "mine", sequences=("0000",))
    theirs = submit(out, suite=exported, name="theirs")
    (tmp_path / "leaderboard.json").write_text(theirs.to_json())
    results = submit(out, suite=exported).beside(tmp_path)
    assert set(results.entries("tracking")) == {"theirs", "mine"}
    with pytest.raises(SubmitError, match="theirs already"):
        theirs.beside(tmp_path)


def test_a_part_is_compared_on_its_own_episodes(exported, tmp_path) -> None:
    whole = submit(perfect(exported, tmp_path / "mine"), suite=exported)
    path = tmp_path / "leaderboard.json"
    more = tuple(replace(e, entry="theirs", seed=s) for e in whole.episodes for s in (e.seed, 0))
    path.write_text(replace(whole, name="theirs", episodes=more).to_json())
    with pytest.warns(UserWarning, match="no results of 4 episodes"):
        results = whole.beside(path)
    assert {job.seed for job in results.jobs} == {e.seed for e in whole.episodes}


def test_bad_results_are_refused(exported, tmp_path) -> None:
    out = perfect(exported, tmp_path / "mine", sequences=("0000",))
    path = out / "tracking" / "0000.txt"
    good = path.read_text()
    line = good.splitlines()[0].split()
    for bad in (
        "999 " + " ".join(line[1:]),
        " ".join([line[0], "-1", *line[2:]]),
        " ".join([*line[:10], "-1", "-1", "-1", *line[13:]]),
        "1 2 Car",
    ):
        path.write_text(bad + "\n")
        with pytest.raises(FormatError, match="0000"):
            submit(out, suite=exported)
    path.write_text(good)
    poses = out / "odometry" / "0000.txt"
    lines = poses.read_text().splitlines()
    for bad in (lines[:-2], ["1 2 3"], []):
        poses.write_text("\n".join(bad) + "\n")
        with pytest.raises(FormatError, match="0000"):
            submit(out, suite=exported)


def test_folders_that_hold_no_results_are_refused(exported, tmp_path) -> None:
    with pytest.raises(SubmitError):
        submit(tmp_path / "none", suite=exported)
    with pytest.raises(ExportError):
        submit(tmp_path)
    with pytest.raises(SubmitError, match="tracking"):
        submit(tmp_path, suite=exported)
    (tmp_path / "tracking").mkdir()
    (tmp_path / "tracking" / "0007.txt").write_text("")
    with pytest.raises(SubmitError, match="0007"):
        submit(tmp_path, suite=exported)


def test_changed_traffic_is_noticed(exported, tmp_path) -> None:
    folder = tmp_path / "changed"
    folder.mkdir()
    content = json.loads((exported / "manifest.json").read_text())
    content["sequences"][0]["digest"] = "0" * 16
    (folder / "manifest.json").write_text(json.dumps(content))
    out = perfect(exported, tmp_path / "mine", sequences=("0000",))
    with pytest.raises(SubmitError, match="traffic"):
        submit(out, suite=folder)


def test_results_on_kitti(tmp_path) -> None:
    kitti = write_kitti(tmp_path / "kitti")
    out = tmp_path / "mine"
    out.mkdir()
    labels = (kitti / "label_02" / "0000.txt").read_text().splitlines()
    (out / "0000.txt").write_text(
        "\n".join(f"{line} 0.9" for line in labels if "DontCare" not in line) + "\n"
    )
    results = submit_kitti(out, kitti)
    assert results.boards() == ["kitti car", "kitti pedestrian"]
    first, second = [e for e in results.episodes if e.board == "kitti car"]
    for metric in ("hota", "hota_3d", "hota_centre", "mota"):
        assert first.scores[metric].value == pytest.approx(1)
    assert second.reason is not None
    assert not compare(results, results).regressed


def test_results_on_motchallenge(tmp_path) -> None:
    sequence = tmp_path / "mot" / "MOT17-02"
    box = "10,20,30,60"
    for place, tail in (("gt/gt.txt", "1,1,1"), ("det/det.txt", "0.9,-1,-1,-1")):
        path = sequence / place
        path.parent.mkdir(parents=True)
        number = "1" if place.startswith("gt") else "-1"
        path.write_text("".join(f"{t},{number},{box},{tail}\n" for t in (1, 2, 3)))
    (sequence / "seqinfo.ini").write_text(
        "[Sequence]\nname=MOT17-02\nframeRate=10\nseqLength=3\nimWidth=640\nimHeight=480\n"
    )
    out = tmp_path / "mine"
    out.mkdir()
    (out / "MOT17-02.txt").write_text("".join(f"{t},5,{box},0.9,-1,-1,-1\n" for t in (1, 2, 3)))
    (own,) = submit_mot(out, tmp_path / "mot").episodes
    assert (own.board, own.reason) == ("mot pedestrian", None)
    assert own.scores["hota"].value == pytest.approx(1)
