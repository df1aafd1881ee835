"""The ego's poses that trackers get, and what becomes of their tracks."""

from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope import TRACKERS, Episode, Pose, Spec, Tracks
from roadscope.benchmarks import (
    CallTimes,
    Eligibility,
    EpisodeDetections,
    EpisodePoses,
    Job,
    RunOptions,
    SuiteError,
    detection_source,
    load_suite,
    parse_suite,
    pose_source,
    run_jobs,
    sensed,
)
from roadscope.benchmarks.boards import BOARDS, JobOptions, track_node, with_each_ego
from roadscope.benchmarks.isolation import PluginError
from roadscope.benchmarks.nodes import PoseNode, start_from_ego, track
from roadscope.core import SpecError

NAMES = ("gnn", "ab3dmot", "existence", "imm")
EPISODE = Episode("roundabout", 10_000, "vlp16", 2.0)
SPEED_M_S = 9.0


def drive(ticks=25) -> EpisodeDetections:
    """A car ahead at 12 m/s and one that stands; the ego at 9 m/s turns slowly."""
    stamps = 0.1 * np.arange(ticks)
    places = [[[15 + 12 * t, 3.0], [40.0, -4.0]] for t in stamps]
    egos = [Pose.planar(SPEED_M_S * t, 0.2 * t, 0.02 * t) for t in stamps]
    frames = list(zip(places, stamps, egos, strict=True))
    return EpisodeDetections.recorded(
        [detections(p, stamp_s=t) for p, t, _ in frames],
        [truth(p, stamp_s=t, world_from_ego=ego) for p, t, ego in frames],
    )


def true_poses(inputs: EpisodeDetections) -> list[Pose]:
    return [t.world_from_ego for t in inputs.truths]


def tracks_of(
    tracker: str, inputs: EpisodeDetections, poses: Sequence[Pose | None] | None = None
) -> tuple[Tracks, ...]:
    return track(TRACKERS.resolve(tracker), inputs, poses=poses).tracks


def same(first, second):
    """Numbers of tracks may differ: they depend on where its world begins."""
    names: set[tuple[int, int]] = set()
    for a, b in zip(first, second, strict=True):
        assert a.frame == b.frame == "world"
        assert len(a) == len(b)
        one, other = np.argsort(a.centres[:, 1]), np.argsort(b.centres[:, 1])
        names |= set(zip(a.ids[one].tolist(), b.ids[other].tolist(), strict=True))
        for name in ("centres", "yaws", "velocities", "covariances"):
            of_one, of_other = getattr(a, name)[one], getattr(b, name)[other]
            np.testing.assert_allclose(of_one, of_other, atol=1e-5)
    assert len(names) == len({i for i, _ in names}) == len({i for _, i in names}) == 2


def test_an_entry_that_names_a_pose_source_gets_that_one() -> None:
    entries = ["gnn", "nearest?ego=none", "imm?ego=truth", "gnn"]
    specs = with_each_ego(map(Spec.parse, entries), ["truth", "still"])
    assert list(map(str, specs)) == ["gnn", "gnn?ego=still", "nearest?ego=none", "imm"]


@pytest.mark.parametrize("tracker", NAMES)
def test_with_the_true_poses_nothing_changes(tracker) -> None:
    recorded_drive = drive()
    same(
        tracks_of(tracker, recorded_drive),
        tracks_of(tracker, recorded_drive, true_poses(recorded_drive)),
    )


@pytest.mark.parametrize("tracker", NAMES)
def test_where_the_world_of_the_poses_begins_does_not_matter(tracker) -> None:
    """An odometry's world starts in the first ego frame, and truth elsewhere."""
    recorded_drive = drive()
    elsewhere = Pose.planar(-300.0, 120.0, 2.2, z_m=4.0)
    moved = [elsewhere @ pose for pose in true_poses(recorded_drive)]
    same(tracks_of(tracker, recorded_drive), tracks_of(tracker, recorded_drive, moved))


@pytest.mark.parametrize("tracker", NAMES)
def test_slow_drift_moves_the_world_of_the_poses_and_not_the_tracks(tracker) -> None:
    """2 % of the distance, and a degree in two seconds: metres there, centimetres from here."""
    recorded_drive = drive()
    drifting = [
        Pose.planar(1.02 * p.translation[0], p.translation[1], p.yaw + 0.0005 * i)
        for i, p in enumerate(true_poses(recorded_drive))
    ]
    every = tracks_of(tracker, recorded_drive, drifting)
    for tracks, line in zip(every[5:], recorded_drive.truths[5:], strict=True):
        away = np.linalg.norm(line.centres[:, None, :2] - tracks.centres[None, :, :2], axis=-1)
        assert len(tracks) == 2
        assert away.min(axis=1).max() < 0.3
    assert len({i for tracks in every for i in tracks.ids.tolist()}) == 2


@pytest.mark.parametrize("tracker", ["gnn", "nearest"])
def test_without_poses_what_stands_comes_nearer(tracker) -> None:
    recorded_drive = drive()
    every = tracks_of(tracker, recorded_drive, [None] * len(recorded_drive.truths))
    last, line = every[-1], recorded_drive.truths[-1]
    standing = int(np.argmin(np.linalg.norm(last.centres[:, :2] - line.centres[1, :2], axis=1)))
    assert np.linalg.norm(last.centres[standing, :2] - line.centres[1, :2]) < 1.0
    ahead = last.velocities[standing] @ line.world_from_ego.rotation[:2, 0]
    assert ahead == pytest.approx(-SPEED_M_S, abs=1.5)


def test_poses_that_jump_cost_tracks() -> None:
    recorded_drive = drive()
    jumps = [
        Pose.planar(0.0, 25.0 * (i % 2), 0.0) @ p for i, p in enumerate(true_poses(recorded_drive))
    ]
    calm, wild = tracks_of("gnn", recorded_drive), tracks_of("gnn", recorded_drive, jumps)
    ids = [len({i for tracks in every for i in tracks.ids.tolist()}) for every in (calm, wild)]
    assert ids[0] == 2
    assert sum(map(len, wild)) < sum(map(len, calm)) or ids[1] > ids[0]


def test_there_are_as_many_poses_as_frames() -> None:
    recorded_drive = drive()
    with pytest.raises(ValueError, match="length"):
        tracks_of("gnn", recorded_drive, true_poses(recorded_drive)[:-1])


def poses_of(xs: Sequence[float], stamps_s: Sequence[float]) -> EpisodePoses:
    """Return estimates of the LiDAR that move along x; truth is the same."""
    matrices = np.stack([Pose.planar(x, 0, 0).matrix for x in xs])
    none = tuple(np.zeros(0, bool) for _ in xs)
    return EpisodePoses(
        matrices,
        matrices,
        np.array(stamps_s),
        np.zeros(len(xs), bool),
        none,
        none,
        CallTimes.zero(len(xs)),
    )


def test_poses_are_stored_unchanged() -> None:
    poses = poses_of([0.0, 1.0, 3.0], [0.1, 0.2, 0.4])
    file = BytesIO()
    poses.save(file)
    file.seek(0)
    assert EpisodePoses.load(file) == poses


def test_between_scans_the_last_pose_holds() -> None:
    poses = poses_of([0.0, 1.0, 3.0], [0.1, 0.2, 0.4])
    stamps_s = [0.0, 0.1, 0.2 + 1e-9, 0.2 - 1e-9, 0.3, 0.5]
    egos = start_from_ego(poses, EPISODE, stamps_s)
    assert [p.translation[0] for p in egos] == pytest.approx([0.0, 0.0, 1.0, 1.0, 1.0, 3.0])


def odometry(text: str, episode: Episode = EPISODE) -> PoseNode:
    return PoseNode(pose_source(text), episode)


def test_an_odometry_says_where_the_rear_axle_is() -> None:
    """The ego frame of the first scan is its start, and the mounting of the LiDAR is undone."""
    truths = [t for _, t in sensed(EPISODE)]
    start = truths[0].world_from_ego.inverse()
    true = np.array([(start @ t.world_from_ego).matrix for t in truths])
    poses = odometry("voxel-map").compute(RunOptions())
    egos = start_from_ego(poses, EPISODE, [t.stamp_s for t in truths])
    assert np.allclose(egos[0].matrix, np.eye(4), atol=1e-9)
    assert np.linalg.norm(true[-1, :2, 3]) > 3.0
    off = np.array([ego.translation for ego in egos]) - true[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.1


def test_an_odometry_that_says_that_it_stands_says_so_of_every_stamp() -> None:
    stamps_s = [t.stamp_s for _, t in sensed(EPISODE)]
    egos = start_from_ego(odometry("still").compute(RunOptions()), EPISODE, stamps_s)
    assert egos == [Pose.identity()] * len(stamps_s)


SUITE = """
name = "poses"
version = 1
rig = "vlp16"
duration_s = 1.0
scenarios = ["roundabout"]
split = "validation"
seeds = 1
[tracking]
entries = ["gnn", "nearest?ego=none"]
detectors = ["noisy"]
"""
ODOMETRY = """
class Mine:
    def reset(self, lidar_from_imu=None):
        open({log!r}, "a").write("begun\\n")
        self.first = None

    def update(self, scan, imu):
        {fault}
        import numpy as np
        from roadscope import OdometryEstimate, Pose
        still = np.zeros(len(scan), bool)
        return OdometryEstimate(Pose.identity(), np.eye(6), still, scan.stamp_s)
"""


def jobs_of(suite, *trackers: str) -> list[Job]:
    board = BOARDS["tracking"]
    entries = [board.check_entry(Spec.parse(text)) for text in trackers]
    return board.jobs(suite, entries, JobOptions())


@pytest.mark.parametrize("fault", ["", "raise RuntimeError('lost')"])
def test_an_odometry_runs_once_for_all_trackers_whether_it_fails_or_not(
    fault, tmp_path, monkeypatch
) -> None:
    monkeypatch.setenv("ROADSCOPE_CACHE", str(tmp_path / "cache"))
    path, log = tmp_path / "mine.py", tmp_path / "log"
    path.write_text(ODOMETRY.format(log=str(log), fault=fault))
    suite = parse_suite(SUITE, "")
    jobs = jobs_of(suite, *(f"{name}?ego={path}:Mine" for name in ("gnn", "nearest", "imm")))
    outcomes = []
    run_jobs(jobs, lambda job, outcome: outcomes.append(outcome))
    assert len(outcomes) == 3
    assert log.read_text().count("begun") == 1
    assert all((o.reason is None) == (not fault) for o in outcomes)
    if fault:
        assert all("mine.py:Mine: RuntimeError: lost" in o.reason for o in outcomes)


def test_what_an_odometry_does_wrong_is_its_reason(tmp_path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(ODOMETRY.format(log=str(tmp_path / "log"), fault="return 7"))
    with pytest.raises(PluginError, match=r"mine\.py:Mine: update returned int"):
        odometry(f"{path}:Mine", replace(EPISODE, duration_s=0.5)).compute(RunOptions())


def test_the_key_of_tracks_depends_on_the_pose_source() -> None:
    def key(text: str) -> str:
        return track_node(
            TRACKERS.resolve(text), detection_source("noisy"), EPISODE, Eligibility()
        ).key

    specs = ["gnn", "gnn?ego=none", "gnn?ego=voxel-map", "gnn?ego=voxel-map?voxel_m=0.7"]
    assert len(set(map(key, specs))) == len(specs)


def test_a_suite_gives_every_tracker_every_pose() -> None:
    plain, both = parse_suite(SUITE, ""), parse_suite(SUITE + 'ego = ["truth", "voxel-map"]', "")
    assert plain.boards["tracking"].egos == ("truth",)
    assert parse_suite(SUITE + 'ego = "none"', "").boards["tracking"].egos == ("none",)
    entries = [job.entry for job in jobs_of(both, *both.boards["tracking"].entries)]
    assert entries == ["gnn", "gnn?ego=voxel-map", "nearest?ego=none"]
    keys = [[job.key for job in jobs_of(both, text)] for text in ("gnn?ego=truth", "gnn")]
    assert keys[0][0] == keys[1][0]


@pytest.mark.parametrize("value", ["1", "[]", '[""]', "[1]"])
def test_a_suite_names_poses_by_texts(value) -> None:
    with pytest.raises(SuiteError, match="ego"):
        parse_suite(f"{SUITE}ego = {value}", "")


def test_the_pose_source_must_be_an_odometry() -> None:
    def check(text: str) -> None:
        BOARDS["tracking"].check_entry(Spec.parse(text))

    check("gnn?ego=none")
    check("gnn?gate_share=0.9&ego=oracle?odometry=voxel-map")
    with pytest.raises(SpecError, match=r"ego=voxel-mab.*'voxel-map'.*'none'"):
        check("gnn?ego=voxel-mab")
    with pytest.raises(SpecError, match="gate"):
        check("gnn?gates=2&ego=none")
    with pytest.raises(SpecError, match="ego="):
        check("gnn?ego=nearest")


def test_suites_of_the_package_give_the_true_poses() -> None:
    assert load_suite("tracking").boards["tracking"].egos == ("truth",)


@pytest.mark.parametrize("ego", ["noisy-odometry?scale=0.03", "oracle?odometry=voxel-map", "none"])
def test_a_named_pose_source_need_not_be_an_odometry(ego) -> None:
    (job,) = jobs_of(parse_suite(SUITE, ""), f"gnn?ego={ego}")
    assert job.missing == ""
