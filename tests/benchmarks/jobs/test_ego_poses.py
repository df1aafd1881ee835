"""What trackers are told about the ego, and what becomes of their tracks."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_boxes import detections, truth

from roadscope.benchmarks.ego import odometry_told, split_ego, told_each, tracker_of, with_ego
from roadscope.benchmarks.eligibility import Eligibility
from roadscope.benchmarks.episode import Episode, sensed
from roadscope.benchmarks.jobs.ego_poses import EgoPoses, odometry_poses, ridden, told, track_told
from roadscope.benchmarks.jobs.entries import check_tracker
from roadscope.benchmarks.jobs.job import Job, missing_of
from roadscope.benchmarks.jobs.plan import tracking_jobs
from roadscope.benchmarks.jobs.stack import EntryError, track
from roadscope.benchmarks.perceived import Perceived
from roadscope.benchmarks.suite import SuiteError, load_suite, parse_suite
from roadscope.core import Pose, RecordError, SpecError

TRACKERS = ("gnn", "ab3dmot", "existence", "imm")
EPISODE = Episode("roundabout", 10_000, "vlp16", 2.0)
SPEED_M_S = 9.0


def drive(ticks=25):
    """A car ahead at 12 m/s and one that stands, seen by an ego at 9 m/s that turns slowly."""
    stamps = 0.1 * np.arange(ticks)
    places = [[[15 + 12 * t, 3.0], [40.0, -4.0]] for t in stamps]
    egos = [Pose.planar(SPEED_M_S * t, 0.2 * t, 0.02 * t) for t in stamps]
    frames = list(zip(places, stamps, egos, strict=True))
    return Perceived(
        tuple(detections(p, stamp_s=t) for p, t, _ in frames),
        tuple(truth(p, stamp_s=t, world_from_ego=ego) for p, t, ego in frames),
        np.zeros(ticks), np.empty((0, 2)), np.zeros(ticks),
    )  # fmt: skip


def true_poses(perceived):
    return [t.world_from_ego for t in perceived.truths]


def same(first, second):
    """Numbers of tracks may differ: they come in the order of the told world."""
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


NAMES = st.sampled_from(["gnn", "my/own.py:Mine", "gnn?gate_m=2.5", "a?b=1&c=x"])
EGOS = st.sampled_from(["none", "voxel-map", "voxel-map?voxel_m=1.0&b=2", "oracle?odometry=a?b=1"])


@given(NAMES, EGOS)
def test_a_spec_says_who_tracks_and_who_tells(tracker, ego) -> None:
    spec = with_ego(tracker, ego)
    assert split_ego(spec) == (tracker, ego)
    assert tracker_of(spec) == tracker
    assert odometry_told(spec) == (None if ego == "none" else ego)
    assert split_ego(tracker) == (tracker, "truth")
    assert with_ego(tracker, "truth") == tracker


def test_whoever_names_a_pose_is_told_that_one() -> None:
    specs = told_each(["gnn", "nearest?ego=none", "imm?ego=truth", "gnn"], ["truth", "still"])
    assert specs == ["gnn", "gnn?ego=still", "nearest?ego=none", "imm"]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_told_the_truth_nothing_changes(tracker) -> None:
    perceived = drive()
    plain = track(tracker, perceived)[0]
    same(plain, track(tracker, perceived, told=true_poses(perceived))[0])
    assert plain == track_told(tracker, perceived, EPISODE)[0]
    assert plain == track_told(f"{tracker}?ego=truth", perceived, EPISODE)[0]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_where_the_told_world_begins_does_not_matter(tracker) -> None:
    """An odometry's world starts in the first ego frame, and truth elsewhere."""
    perceived = drive()
    elsewhere = Pose.planar(-300.0, 120.0, 2.2, z_m=4.0)
    moved = [elsewhere @ pose for pose in true_poses(perceived)]
    same(track(tracker, perceived)[0], track(tracker, perceived, told=moved)[0])


@pytest.mark.parametrize("tracker", TRACKERS)
def test_slow_drift_moves_the_told_world_and_not_the_tracks(tracker) -> None:
    """2 % of the way, and a degree in two seconds: metres in that world, centimetres from here."""
    perceived = drive()
    drifting = [
        Pose.planar(1.02 * p.translation[0], p.translation[1], p.yaw + 0.0005 * i)
        for i, p in enumerate(true_poses(perceived))
    ]
    followed = track(tracker, perceived, told=drifting)[0]
    for tracks, line in zip(followed[5:], perceived.truths[5:], strict=True):
        away = np.linalg.norm(line.centres[:, None, :2] - tracks.centres[None, :, :2], axis=-1)
        assert len(tracks) == 2
        assert away.min(axis=1).max() < 0.3
    assert len({i for tracks in followed for i in tracks.ids.tolist()}) == 2


@pytest.mark.parametrize("tracker", ["gnn", "nearest"])
def test_without_poses_what_stands_is_said_to_come_nearer(tracker) -> None:
    perceived = drive()
    followed = track_told(f"{tracker}?ego=none", perceived, EPISODE)[0]
    last, line = followed[-1], perceived.truths[-1]
    standing = int(np.argmin(np.linalg.norm(last.centres[:, :2] - line.centres[1, :2], axis=1)))
    assert np.linalg.norm(last.centres[standing, :2] - line.centres[1, :2]) < 1.0
    ahead = last.velocities[standing] @ line.world_from_ego.rotation[:2, 0]
    assert ahead == pytest.approx(-SPEED_M_S, abs=1.5)


def test_poses_that_jump_cost_tracks() -> None:
    perceived = drive()
    jumps = [Pose.planar(0.0, 25.0 * (i % 2), 0.0) @ p for i, p in enumerate(true_poses(perceived))]
    calm = track("gnn", perceived)[0]
    wild = track("gnn", perceived, told=jumps)[0]
    ids = [len({i for tracks in every for i in tracks.ids.tolist()}) for every in (calm, wild)]
    assert ids[0] == 2
    assert sum(map(len, wild)) < sum(map(len, calm)) or ids[1] > ids[0]


def test_as_many_poses_as_frames_are_told() -> None:
    perceived = drive()
    with pytest.raises(ValueError, match="zip"):
        track("gnn", perceived, told=true_poses(perceived)[:-1])


def test_poses_are_kept_as_they_are(tmp_path) -> None:
    poses = EgoPoses(np.array([0.1, 0.2]), np.stack([np.eye(4), Pose.planar(1, 2, 0.3).matrix]))
    poses.save(tmp_path / "poses.npz")
    assert EgoPoses.load(tmp_path / "poses.npz") == poses
    (tmp_path / "other.npz").write_bytes(b"nothing")
    with pytest.raises(RecordError, match="ego poses"):
        EgoPoses.load(tmp_path / "other.npz")


def test_between_scans_the_last_pose_holds() -> None:
    poses = EgoPoses(
        np.array([0.1, 0.2, 0.4]), np.stack([Pose.planar(i + 1.0, 0, 0).matrix for i in range(3)])
    )
    found = poses.at([0.0, 0.1, 0.2 + 1e-9, 0.2 - 1e-9, 0.3, 0.5])
    assert [p.translation[0] for p in found] == [0.0, 1.0, 2.0, 2.0, 2.0, 3.0]


def test_an_odometry_tells_where_the_rear_axle_is() -> None:
    """The ego frame of the first scan is its start, and the mounting of the LiDAR is undone."""
    truths = [t for _, t in sensed(EPISODE)]
    start = truths[0].world_from_ego.inverse()
    true = np.array([(start @ t.world_from_ego).matrix for t in truths])
    found = ridden("voxel-map", EPISODE)
    assert np.allclose(found.start_from_ego[0], np.eye(4), atol=1e-9)
    assert np.linalg.norm(true[-1, :2, 3]) > 3.0
    off = found.start_from_ego[:, :3, 3] - true[:, :3, 3]
    assert np.linalg.norm(off, axis=1).max() < 0.1


def test_who_says_that_it_stands_tells_nearly_the_same_as_nobody() -> None:
    truths = [t for _, t in sensed(EPISODE)]
    assert told("still", EPISODE, truths) == [Pose.identity()] * len(truths)
    assert told("none", EPISODE, truths) == [None] * len(truths)
    plain, still = (track_told(f"gnn?ego={ego}", drive(), EPISODE)[0] for ego in ("none", "still"))
    assert [len(tracks) for tracks in plain] == [len(tracks) for tracks in still]


def test_an_odometry_runs_once_for_all_trackers(monkeypatch) -> None:
    episode = replace(EPISODE, duration_s=0.4)
    first = odometry_poses("still", episode)

    def again(*_):
        raise AssertionError

    monkeypatch.setattr("roadscope.benchmarks.jobs.ego_poses.ridden", again)
    assert odometry_poses("still", episode) == first


def test_what_an_odometry_does_wrong_is_its_reason(tmp_path) -> None:
    (tmp_path / "mine.py").write_text(
        "class Bad:\n"
        "    def reset(self, lidar_from_imu=None): pass\n"
        "    def update(self, scan, imu): raise RuntimeError('lost')\n"
    )
    with pytest.raises(EntryError, match="lost"):
        odometry_poses(f"{tmp_path}/mine.py:Bad", replace(EPISODE, duration_s=0.5))


def test_the_key_knows_who_tells() -> None:
    def key(tracker):
        return Job("tracking", "entry", "noisy", tracker, EPISODE, Eligibility()).key

    specs = ["gnn", "gnn?ego=none", "gnn?ego=voxel-map", "gnn?ego=voxel-map?voxel_m=0.7"]
    assert len(set(map(key, specs))) == len(specs)
    assert key("gnn?ego=truth") == key("gnn")


SUITE = """
name = "told"
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


def test_a_suite_tells_every_tracker_every_pose() -> None:
    plain, both = parse_suite(SUITE, ""), parse_suite(SUITE + 'ego = ["truth", "voxel-map"]', "")
    assert plain.egos == ("truth",)
    assert parse_suite(SUITE + 'ego = "none"', "").egos == ("none",)
    entries = [job.entry for job in tracking_jobs(both, both.trackers)]
    assert entries == ["gnn", "gnn?ego=voxel-map", "nearest?ego=none"]


@pytest.mark.parametrize("given", ["1", "[]", '[""]', "[1]"])
def test_a_suite_names_poses_by_texts(given) -> None:
    with pytest.raises(SuiteError, match="ego"):
        parse_suite(f"{SUITE}ego = {given}", "")


def test_who_tells_must_be_an_odometry() -> None:
    check_tracker("gnn?ego=none")
    check_tracker("gnn?gate_share=0.9&ego=oracle?odometry=voxel-map")
    with pytest.raises(SpecError, match=r"ego=voxel-mab.*did you mean 'voxel-map'.*'none'"):
        check_tracker("gnn?ego=voxel-mab")
    with pytest.raises(SpecError, match="gate"):
        check_tracker("gnn?gates=2&ego=none")


def test_suites_of_the_package_tell_the_truth() -> None:
    assert load_suite("tracking").egos == ("truth",)


@pytest.mark.parametrize("ego", ["noisy-odometry?scale=0.03", "oracle?odometry=voxel-map", "none"])
def test_whoever_tells_poses_need_not_be_an_odometry(ego) -> None:
    assert missing_of(f"gnn?ego={ego}") is None
