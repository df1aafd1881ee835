"""The worst moments of entries, read from kept files of made-up episodes."""

from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import pytest
import toy_boxes
from PIL import Image

from roadscope.benchmarks import (
    CallTimes,
    Eligibility,
    Episode,
    EpisodeDetections,
    EpisodeFusions,
    EpisodeImageDetections,
    EpisodePoses,
    EpisodeTracks,
    Job,
    RunOptions,
    detection_source,
    image_source,
    timeline_of,
    write_kept,
)
from roadscope.benchmarks.boards import BOARDS, track_node
from roadscope.benchmarks.metrics import FusionTargets, ParkedBoxes
from roadscope.benchmarks.nodes import (
    DetectionNode,
    DriveNode,
    EpisodeDrive,
    FusionNode,
    ImageNode,
    PoseNode,
    Stack,
)
from roadscope.benchmarks.report import ReplayMoment, worst_moments
from roadscope.benchmarks.results import JobScores, Results, results_of
from roadscope.core import Category, Detections, FusedDetections, Pose, Spec, Tracks, Truth

FRAMES = 60
PERIOD_S = 0.1
SWITCH, MISSED, ALARM = 20, range(30, 40), range(45, 48)
RULE = Eligibility((0.0, 60.0), 1)
EPISODE = Episode("lu2018-three-vehicles", 7, "lux", 0.9)
CAR = (4.6, 1.8, 1.5)
NUMBERS = {"track": 3, "later track": 9}


def places_m(frame: int) -> np.ndarray:
    """Return where two cars are: one passes, one stands."""
    return np.array([[10.0 + 0.8 * frame, 3.5, 0.8], [30.0, -3.5, 0.8]])


def ego(frame: int) -> Pose:
    return Pose.planar(5.0 + 0.5 * frame, 1.0, 0.2)


def truth(frame: int) -> Truth:
    return toy_boxes.truth(
        places_m(frame),
        ids=[4, 8],
        sizes=np.tile(CAR, (2, 1)),
        yaws=np.array([0.1, 3.1]),
        returns=50,
        world_from_ego=ego(frame),
        stamp_s=PERIOD_S * frame,
    )


def answer(frame: int) -> tuple[Detections, list[int]]:
    """Return boxes and their numbers: a switch, a car that is missed, and a false alarm."""
    centres = list(places_m(frame))
    numbers = [NUMBERS["track"] if frame < SWITCH else NUMBERS["later track"], 5]
    if frame in MISSED:
        centres.pop()
        numbers.pop()
    if frame in ALARM:
        centres.append(np.array([20.0, 12.0, 0.8]))
        numbers.append(77)
    boxes = toy_boxes.detections(centres, sizes=CAR, yaws=0.1, stamp_s=PERIOD_S * frame)
    return boxes, numbers


@pytest.fixture(autouse=True)
def store_in_a_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path))


@pytest.fixture
def tracked() -> tuple[Job, Results]:
    board = BOARDS["tracking"]
    node = track_node(
        board.check_entry(Spec.parse("nearest")), detection_source("pag"), EPISODE, RULE
    )
    job = Job(board, "nearest", EPISODE, node, inputs="pag", settings=RULE)
    boxes = [answer(frame) for frame in range(FRAMES)]
    tracks = tuple(Tracks.of(each, np.array(numbers)) for each, numbers in boxes)
    answers = EpisodeTracks(tracks, CallTimes.zero(FRAMES))
    inputs = detections()
    write_kept(node.path, answers)
    write_kept(node.detections.path, inputs)
    timeline_of(EPISODE)
    return job, scored([job], [board.score(job, answers, RunOptions())])


def detections() -> EpisodeDetections:
    frames = range(FRAMES)
    return EpisodeDetections(
        tuple(answer(frame)[0] for frame in frames),
        tuple(map(truth, frames)),
        CallTimes.zero(FRAMES),
        np.empty((0, 2)),
        np.zeros(FRAMES),
    )


def scored(jobs: Sequence[Job], scores: Sequence[object]) -> Results:
    named = [
        JobScores(job.board.name, job.entry, "lu2018-three-vehicles", 7, "clear", job.inputs, each)
        for job, each in zip(jobs, scores, strict=True)
    ]
    return results_of(named, {"suite": "tiny"})


def positions(motion: Sequence[int]) -> np.ndarray:
    """Return (N, 3) x and y, metres, and yaw, radians."""
    return np.cumsum(np.reshape(motion, (-1, 3)), axis=0) / (10.0, 10.0, 100.0)


def of_kind(moments: Sequence[ReplayMoment], kind: str) -> ReplayMoment:
    return next(moment for moment in moments if moment.kind == kind)


def test_each_kind_of_error_has_its_moment(tracked) -> None:
    moments = worst_moments([tracked[0]], tracked[1])
    assert {moment.kind for moment in moments} == {"identity switches", "misses", "false alarms"}
    times_s = {moment.kind: moment.times_s[moment.event] for moment in moments}
    assert times_s["identity switches"] == pytest.approx(PERIOD_S * SWITCH)
    assert PERIOD_S * MISSED[0] <= times_s["misses"] <= PERIOD_S * MISSED[-1]
    assert PERIOD_S * ALARM[0] <= times_s["false alarms"] <= PERIOD_S * ALARM[-1]


def test_a_switch_names_object_and_tracks(tracked) -> None:
    switch = of_kind(worst_moments([tracked[0]], tracked[1]), "identity switches")
    for number in (4, *NUMBERS.values()):
        assert str(number) in switch.text.replace(";", "").split()
    boxes = {box.number: box for box in switch.answers}
    assert set(NUMBERS.values()) <= set(boxes)
    later = boxes[NUMBERS["later track"]]
    assert later.first == switch.event
    assert later.states[0] == "s"
    assert set(later.states[1:]) == {"m"}


def test_positions_are_those_of_the_truth(tracked) -> None:
    moment = of_kind(worst_moments([tracked[0]], tracked[1]), "misses")
    first = round(moment.times_s[0] / PERIOD_S)
    event = first + moment.event
    frames = range(first, first + len(moment.times_s))
    ego_from_world = ego(event).inverse()
    expected = {4: 0, 8: 1}
    for box in moment.objects:
        expected_xyz = np.array(
            [ego_from_world.apply(places_m(f))[expected[box.number]] for f in frames]
        )
        np.testing.assert_allclose(positions(box.motion)[:, :2], expected_xyz[:, :2], atol=0.051)
        assert (box.length, box.width) == (46, 18)
    own = [ego_from_world.apply(ego(frame).translation[None])[0] for frame in frames]
    np.testing.assert_allclose(positions(moment.ego)[:, :2], np.array(own)[:, :2], atol=0.051)
    missed = next(box for box in moment.objects if box.number == 8)
    states = {frame: missed.states[k] for k, frame in enumerate(frames)}
    assert all((state == "x") == (frame in MISSED) for frame, state in states.items())


def test_detections_have_no_identity() -> None:
    board = BOARDS["detection"]
    node = DetectionNode(board.check_entry(Spec.parse("pag")), EPISODE, RULE)
    job = Job(board, "pag", EPISODE, node, settings=RULE)
    write_kept(node.path, detections())
    timeline_of(EPISODE)
    results = scored([job], [board.score(job, detections(), RunOptions())])
    moments = worst_moments([job], results)
    assert {moment.kind for moment in moments} == {"misses", "false alarms"}
    alarm = of_kind(moments, "false alarms")
    assert {box.number for box in alarm.answers} == {-1}
    assert sum(box.states == "f" for box in alarm.answers) == len(ALARM)
    assert alarm.lanes


def test_a_jump_of_an_odometry_is_its_event() -> None:
    frames, jump = 400, 250
    true_path = np.array([Pose.planar(0.8 * k, 0.0, 0.0).matrix for k in range(frames)])
    estimate = true_path.copy()
    estimate[jump:, 1, 3] += 3.0
    answers = EpisodePoses(
        estimate,
        true_path,
        PERIOD_S * np.arange(frames),
        np.zeros(frames, bool),
        (np.zeros(0, bool),) * frames,
        (np.zeros(0, bool),) * frames,
        CallTimes.zero(frames),
    )
    board = BOARDS["odometry"]
    node = PoseNode(board.check_entry(Spec.parse("voxel-map")), EPISODE)
    job = Job(board, "voxel-map", EPISODE, node, settings=(50.0,))
    write_kept(node.path, answers)
    moments = worst_moments([job], scored([job], [board.score(job, answers, RunOptions())]))
    moment = of_kind(moments, "jump")
    assert moment.times_s[moment.event] == pytest.approx(PERIOD_S * jump)
    assert moment.errors[moment.event - 1 : moment.event + 1] == [0, 300]
    assert of_kind(moments, "drift").event == len(of_kind(moments, "drift").times_s) - 1


# --------------------------------------------------------------------------------------------------
# Detections in images, and fused detections.

CAMERA_EPISODE = Episode("street", 7, "wide", 1.0)
IMAGES = (0, 3, 6)
CAR_BOX, PERSON_BOX = (100.0, 200.0, 180.0, 260.0), (400.0, 210.0, 420.0, 260.0)
WRONG_BOX = (500.0, 100.0, 540.0, 140.0)


def image_truth(
    image: int, centres: Sequence[Sequence[float]] = ((12, 2, 1), (15, -4, 1))
) -> Truth:
    """Return the truth of an image: a car, a pedestrian in the second half, and one far away."""
    return toy_boxes.truth(
        [*centres, (90, 0, 1)],
        ids=[4, 8, 9],
        categories=np.array([Category.CAR, Category.PEDESTRIAN, Category.CAR]),
        image_boxes=np.array([CAR_BOX, PERSON_BOX, (320.0, 238.0, 323.0, 240.0)]),
        visible_pixels=np.array([4000, 900, 4]),
        stamp_s=0.1 * image,
    )


def image_answers() -> EpisodeImageDetections:
    """Return answers: the car always, a false alarm and no pedestrian in the last image."""
    first = toy_boxes.image_detections([CAR_BOX], scores=0.93)
    whole = toy_boxes.image_detections(
        [CAR_BOX, PERSON_BOX], categories=[Category.CAR, Category.PEDESTRIAN]
    )
    unlikely = 0.2
    last = toy_boxes.image_detections(
        [CAR_BOX, WRONG_BOX, PERSON_BOX],
        categories=[Category.CAR, Category.VAN, Category.PEDESTRIAN],
        scores=[0.9, 0.71, unlikely],
    )
    parked = ParkedBoxes(np.empty((0, 4)), np.empty(0))
    return EpisodeImageDetections(
        (first, whole, last),
        tuple(map(image_truth, IMAGES)),
        (parked,) * len(IMAGES),
        CallTimes.zero(len(IMAGES)),
        np.array(IMAGES),
    )


def states_at(boxes: Sequence[Any], frame: int) -> list[tuple[str, str]]:
    """Return the labels and states of the boxes that are of this frame alone."""
    return sorted((box.label, box.states) for box in boxes if box.first == frame)


def test_moments_of_a_camera_detector_are_in_its_images() -> None:
    board = BOARDS["camera"]
    node = ImageNode(board.check_entry(Spec.parse("colour-blobs")), CAMERA_EPISODE, 0.3)
    job = Job(board, "colour-blobs", CAMERA_EPISODE, node)
    write_kept(node.path, image_answers())
    moments = worst_moments([job], scored([job], [board.score(job, image_answers(), RunOptions())]))
    assert {moment.kind for moment in moments} == {"misses", "false alarms"}
    alarm = of_kind(moments, "false alarms")
    assert alarm.times_s == pytest.approx([0.0, 0.3, 0.6])
    assert alarm.event == 2
    assert alarm.size_px == (640, 480)
    assert states_at(alarm.objects, 1) == [("car", "i"), ("car", "m"), ("pedestrian", "m")]
    assert states_at(alarm.objects, 2) == [("car", "i"), ("car", "m"), ("pedestrian", "x")]
    assert states_at(alarm.answers, 2) == [("car 0.90", "m"), ("van 0.71", "f")]
    assert "van 0.71" in alarm.text
    wrong = next(box for box in alarm.answers if box.states == "f")
    # Tenths of a pixel, y upwards.
    assert wrong.motion == [5200, -1200, 0]
    assert (wrong.length, wrong.width) == (400, 400)
    x, y, half_width, half_height = alarm.focus
    assert abs(x - 5200) + 200 <= half_width
    assert abs(y + 1200) + 200 <= half_height
    assert x + half_width <= 6400
    miss = of_kind(moments, "misses")
    assert "pedestrian at 16 m with 900 pixels" in miss.text
    for file in alarm.images:
        image = Image.open(BytesIO(file))
        assert image.format == "JPEG"
        assert image.width / image.height == pytest.approx(640 / 480, rel=0.01)


FUSION_EPISODE = Episode("street", 7, "li2021", 1.0)


def fused_at(centres: Sequence[Sequence[float]], *extra: Sequence[float]) -> FusedDetections:
    """Return the car by the LiDAR, the pedestrian by the camera, and false ones by the LiDAR."""
    lidar = toy_boxes.detections([centres[0], *extra], sizes=CAR, frame="ego", scores=0.8)
    camera = toy_boxes.image_detections([PERSON_BOX], categories=Category.PEDESTRIAN)
    fused = FusedDetections.of(lidar, camera)
    inside = np.tile((600.0, 200.0, 640.0, 220.0), (len(fused), 1))
    boxes = np.where(fused.has_image_box[:, None], fused.image_boxes, inside)
    return replace(fused, has_image_box=np.ones(len(fused), bool), image_boxes=boxes)


def test_moments_of_a_fusion_are_seen_from_above() -> None:
    board, centres = BOARDS["fusion"], [[12.0, 2.0, 1.0], [15.0, -4.0, 1.0]]
    lidar = DetectionNode(detection_source("cluster-boxes"), FUSION_EPISODE, RULE)
    camera = ImageNode(image_source("network"), FUSION_EPISODE, 0.3, of_scans=True)
    node = FusionNode(lidar, camera, board.check_entry(Spec.parse("union")))
    targets = FusionTargets(
        np.array([0, 2, 0]),
        np.array([*centres, [90.0, 0.0, 1.0]]),
        image_truth(0).image_boxes,
        np.array([True, True, False]),
        np.zeros(3),
    )
    answers = EpisodeFusions(
        np.array([0, 3]),
        (fused_at(centres), fused_at([[30.0, 8.0, 1.0]], [20.0, 0.0, 1.0])),
        (targets, targets),
        CallTimes.zero(2),
    )
    truths = tuple(image_truth(scan) for scan in range(4))
    given = toy_boxes.detections([centres[0]], sizes=CAR)
    write_kept(node.path, answers)
    write_kept(lidar.path, EpisodeDetections.recorded((given,) * 4, truths))
    write_kept(camera.path, image_answers())
    job = Job(board, "union", FUSION_EPISODE, node, inputs=node.inputs)
    moments = worst_moments([job], scored([job], [board.score(job, answers, RunOptions())]))
    miss = of_kind(moments, "misses")
    assert miss.times_s == pytest.approx([0.0, 0.3])
    assert miss.event == 1
    assert "car 4 at 12 m" in miss.text
    named = {box.number: (box.label, box.states) for box in miss.objects}
    assert named == {4: ("car", "mx"), 8: ("pedestrian", "mm")}
    alarm = of_kind(moments, "false alarms")
    assert alarm.text.startswith("2 of 3 boxes")
    assert [box.states for box in alarm.answers].count("d") == 2
    beam = next(box for box in alarm.answers if "camera" in box.label)
    assert beam.states == "m"
    assert beam.length > 10 * beam.width
    assert alarm.ego
    assert alarm.size_px == (1280, 960)
    assert [image[:2] for image in alarm.images] == [b"\xff\xd8"] * 2
    assert [box.states for box in miss.image_objects if box.first == 1] == ["x", "m"]
    boxes = [box.states for box in alarm.image_answers if box.first == 1]
    assert sorted(boxes) == sorted("ffm" + "d" * (len(boxes) - 3))


def test_parked_cars_are_shown_and_do_not_count() -> None:
    board, place = BOARDS["detection"], (8.0, -6.0)
    node = DetectionNode(detection_source("distance"), FUSION_EPISODE, RULE)
    truths = tuple(image_truth(scan) for scan in range(3))
    nothing = toy_boxes.detections(np.empty((0, 3)))
    answers = replace(
        EpisodeDetections.recorded((nothing,) * 3, truths), parked=np.array([place, (500.0, 0.0)])
    )
    write_kept(node.path, answers)
    job = Job(board, "distance", FUSION_EPISODE, node, settings=RULE)
    moment = of_kind(
        worst_moments([job], scored([job], [board.score(job, answers, RunOptions())])), "misses"
    )
    (parked,) = (box for box in moment.objects if box.label == "parked car")
    assert (parked.number, parked.states) == (-1, "i" * 3)
    ego = truths[1].world_from_ego.inverse().apply(np.array([[*place, 0.0]]))[0]
    assert np.allclose(np.array(parked.motion[:2]) / 10, ego[:2], atol=0.1)


DRIVING_EPISODE = Episode("two-way", 3, "vlp16", 6.0)
KNOWN_FROM = 45


def made_up_drive() -> EpisodeDrive:
    """Return a drive into car 7, which has a track and a detection from an instant on."""
    count = 50
    stamps_s = PERIOD_S * np.arange(count)
    poses = np.zeros((count, 3, 3))
    poses[:, 0, 0] = 5.0 * stamps_s
    poses[:, 1], poses[:, 2] = (29.0, 0.2, 0.0), (40.0, 4.0, 0.0)
    poses[:10, 2] = np.nan
    velocities = np.zeros((count, 3, 2))
    velocities[:, 0, 0] = 5.0
    tracks = tuple(
        tracks_at(stamp_s, [[29.0, 0.2, 0.8]] if k >= KNOWN_FROM else [[80.0, 0.0, 0.8]])
        for k, stamp_s in enumerate(stamps_s)
    )
    scans = [float(stamp_s) - 0.04 for stamp_s in stamps_s]
    return EpisodeDrive(
        stamps_s=stamps_s,
        speeds=np.full(count, 5.0),
        accelerations=np.zeros(count),
        reference_accelerations=np.zeros(count),
        ids=np.array([0, 7, 9]),
        categories=np.array([0, 0, 0], np.int8),
        sizes=np.tile(CAR, (3, 1)),
        poses=poses,
        velocities=velocities,
        tracks=tracks,
        end_s=float(stamps_s[-1]) + 0.1,
        desired_speed_m_s=5.0,
        collided_with=7,
        sensed=tuple(
            toy_boxes.truth([[29.0, 0.2, 0.8]], ids=[7], returns=12, stamp_s=scan) for scan in scans
        ),
        detected=tuple(
            toy_boxes.detections(
                [[29.1, 0.2, 0.8]] * (k >= KNOWN_FROM) + [[15.0, 5.0, 0.8]],
                sizes=CAR,
                yaws=0.0,
                stamp_s=scan,
            )
            for k, scan in enumerate(scans)
        ),
        believed=tracks,
        parked=np.empty((0, 2)),
        driver_times=CallTimes.zero(count),
        perception_times=CallTimes.zero(count),
    )


def moments_of_drives(
    seeds: Sequence[int], stack: str, mark: str | None = None
) -> list[ReplayMoment]:
    """Return the moments of an entry whose drives all end in the same collision."""
    board, drive = BOARDS["driving"], made_up_drive()
    spec = board.check_entry(Spec.parse("idm"))
    jobs = []
    for seed in seeds:
        episode = replace(DRIVING_EPISODE, seed=seed)
        node = DriveNode(spec, Stack(stack), episode)
        job = Job(board, f"idm on {stack}", episode, node, mark=mark, inputs=stack, settings=RULE)
        write_kept(node.path, drive)
        timeline_of(episode)
        jobs.append(job)
    return worst_moments(jobs, scored(jobs, [board.score(j, drive, RunOptions()) for j in jobs]))


def test_a_collision_shows_what_was_true_sensed_and_believed() -> None:
    moments = moments_of_drives([3], "pag + gnn")
    collision = of_kind(moments, "collision")
    assert collision.times_s[collision.event] == pytest.approx(made_up_drive().stamps_s[-1])
    assert "car 7 at 5.0 m/s" in collision.text
    assert "tracked for the last 0.4 s" in collision.text
    assert "12 returns and 1 detection within 2 m" in collision.text
    hit = next(box for box in collision.objects if box.number == 7)
    first = np.searchsorted(collision.times_s, PERIOD_S * KNOWN_FROM - 1e-6)
    assert hit.states == "x" * first + "m" * (len(hit.states) - first)
    detected = [box for box in collision.answers if box.number == -1]
    assert [(box.first, box.states) for box in detected] == [(collision.event, "d")] * 2
    np.testing.assert_allclose(
        [positions(box.motion)[0, :2] for box in detected],
        [[29.1 - 24.5, 0.2], [15.0 - 24.5, 5.0]],
        atol=0.051,
    )
    assert collision.lanes
    assert {moment.kind for moment in moments} == {"collision"}


@pytest.mark.parametrize("mark", [None, "lower mark"])
def test_every_collision_is_replayed_of_marks_too(mark) -> None:
    moments = moments_of_drives([3, 4, 5], "blind", mark)
    assert [(moment.kind, moment.seed) for moment in moments] == [
        ("collision", seed) for seed in (3, 4, 5)
    ]


def tracks_at(stamp_s: float, centres: Sequence[Sequence[float]]) -> Tracks:
    ids = np.arange(len(centres))
    return toy_boxes.tracks(centres, ids, sizes=CAR, stamp_s=float(stamp_s))


def test_answers_that_are_not_stored_have_no_moments(tracked) -> None:
    job, results = tracked
    job.answers.path.write_bytes(b"no answers")
    assert worst_moments([job], results) == []
    job.answers.path.unlink()
    assert worst_moments([job], results) == []
