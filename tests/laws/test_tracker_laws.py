"""Every registered tracker: the contract of all trackers, and laws of ours."""

from dataclasses import replace

import numpy as np
import pytest
import toy_boxes
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Category, Detections, Pose, TrackState
from roadscope.testing import contract_items
from roadscope.trackers import TRACKERS, OfflineTracker, is_offline

KNOW_NO_CATEGORIES = {"nearest"}
"""Lu 2018's targets are all of one kind."""
KNOW_UPRIGHT_BOXES_ONLY = {"roboflow-sort", "roboflow-bytetrack", "roboflow-oc-sort"}
"""Made for images: boxes lie along the axes, so the same overlap only after a quarter turn."""


VARIANTS = {"nearest-q", "nearest-q-confirmed", "existence-offline"}
"""Online they are other trackers with other settings; that the last one is so is a law below."""
LAWFUL = [name for name in TRACKERS.installed() if name not in VARIANTS]


@pytest.fixture(params=LAWFUL)
def tracker(request):
    return TRACKERS.make(request.param)


def boxes(centres, stamp_s, score=0.9, category=Category.CAR):
    return toy_boxes.detections(
        centres,
        sizes=[4.6, 1.85, 1.5],
        categories=category,
        scores=score,
        frame="ego",
        stamp_s=stamp_s,
    )


def traffic(seed, ticks=25):
    """Five vehicles at constant velocity, 20 % of them missed, clutter now and then."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform(-40, 40, (5, 2)), rng.uniform(-8, 8, (5, 2))
    for k in range(ticks):
        places = start + 0.1 * k * speed + 0.1 * rng.standard_normal((5, 2))
        clutter = rng.uniform(-60, 60, (rng.integers(0, 3), 2))
        yield boxes(np.concatenate([places[rng.random(5) < 0.8], clutter]), 0.1 * k)


def run(tracker, episode, pose=None):
    return [tracker.update(detections, pose) for detections in episode]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", TRACKERS.installed())
def test_contract(name):
    for item in contract_items(name):
        item.verify()


def test_one_object_keeps_one_identity(tracker):
    rng = np.random.default_rng(0)
    episode = [
        boxes(np.array([[20 + 0.5 * k, 3.0]]) + 0.1 * rng.standard_normal(2), 0.1 * k)
        for k in range(30)
    ]
    reports = run(tracker, episode)
    assert len({int(i) for tracks in reports for i in tracks.ids}) == 1
    assert reports[-1].centres[0, :2] == pytest.approx((34.5, 3.0), abs=0.3)
    assert reports[-1].velocities[0] == pytest.approx((5, 0), abs=0.5)
    assert reports[-1].sizes[0].tolist() == [4.6, 1.85, 1.5]


def test_identities_are_never_used_again(tracker):
    last: dict[int, int] = {}
    for k, tracks in enumerate(run(tracker, traffic(3, ticks=60))):
        assert len(set(tracks.ids.tolist())) == len(tracks)
        for identity in tracks.ids.tolist():
            assert last.get(identity, k - 1) == k - 1, "an identity came back"
            last[identity] = k
    assert len(last) > 10


def test_covariances_are_proper_and_grow_with_misses(tracker):
    reports = run(tracker, traffic(4))
    for tracks in reports:
        assert np.allclose(tracks.covariances, tracks.covariances.transpose(0, 2, 1))
        assert (np.linalg.eigvalsh(tracks.covariances) > 0).all()
    unseen = tracker.update(Detections.empty(2.5), None)
    before = dict(zip(reports[-1].ids.tolist(), reports[-1].covariances, strict=True))
    for identity, covariance in zip(unseen.ids.tolist(), unseen.covariances, strict=True):
        if identity in before:
            assert np.trace(covariance[:2, :2]) > np.trace(before[identity][:2, :2])


def test_known_pose_gives_world_or_ego_frame(tracker):
    pose = Pose.planar(100.0, 50.0, np.pi / 2)
    tracks = tracker.update(boxes(np.array([[10.0, 0.0]]), 0.0), pose)
    expected = {"world": (100.0, 60.0), "ego": (10.0, 0.0)}[tracks.frame]
    assert tracks.centres[0, :2] == pytest.approx(expected)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(LAWFUL))
def test_any_sequence_gives_proper_tracks(seed, name):
    rng = np.random.default_rng(seed)
    tracker = TRACKERS.make(name)
    for k in range(12):
        n = rng.integers(0, 6)
        # So far apart that no tracker takes two of them for one.
        places = rng.permutation(25)[:n]
        centres = 6.0 * np.column_stack(np.divmod(places, 5)) + rng.integers(-1, 1, (n, 2))
        tracks = tracker.update(boxes(centres, 0.1 * k), None)
        # Every sure detection is in some track's place or drew one towards it.
        assert len(tracks) >= n


def test_low_scores_make_no_more_tracks_than_high_ones(tracker):
    """Trackers that look at scores may leave them aside, others take them like any."""
    sure = run(tracker, traffic(5))
    tracker.reset()
    unsure = run(tracker, (replace(d, scores=0.05 * d.scores) for d in traffic(5)))
    assert all(len(a) <= len(b) for a, b in zip(unsure, sure, strict=True))


def crossing(k):
    """Two cars on crossing roads; the second is there 1.2 s after the first."""
    return np.array([[8 * (0.1 * k - 1.0), 0.0], [0.0, 8 * (0.1 * k - 2.2)]])


def test_crossing_paths_keep_their_identities(tracker):
    rng = np.random.default_rng(0)
    followers = [set(), set()]
    for k in range(35):
        places = crossing(k)
        frame_boxes = boxes(places + 0.1 * rng.standard_normal((2, 2)), 0.1 * k)
        tracks = tracker.update(frame_boxes, None)
        for place, ids in zip(places, followers, strict=True):
            distances = np.hypot(*(tracks.centres[:, :2] - place).T)
            assert distances.min() < 1.0
            ids.add(int(tracks.ids[distances.argmin()]))
    assert [len(ids) for ids in followers] == [1, 1]
    assert followers[0] != followers[1]


def test_coasting_ends(tracker):
    run(tracker, traffic(6))
    for k in range(60):
        tracks = tracker.update(Detections.empty(2.5 + 0.1 * k), None)
        assert (tracks.states != TrackState.CONFIRMED).all()
    assert len(tracks) == 0


def test_moving_the_world_moves_the_tracks(tracker, request):
    """Origin and orientation of the world frame do not matter."""
    upright = request.node.callspec.params["tracker"] in KNOW_UPRIGHT_BOXES_ONLY
    world = Pose.planar(-120.0, 340.0, np.pi / 2 if upright else 2.2)
    poses = [Pose.planar(1.5 * k, 0.02 * k**2, 0.01 * k) for k in range(25)]
    here = [tracker.update(d, p) for d, p in zip(traffic(7), poses, strict=True)]
    tracker.reset()
    there = [tracker.update(d, world @ p) for d, p in zip(traffic(7), poses, strict=True)]
    names: dict[int, int] = {}
    for one, other in zip(here, there, strict=True):
        assert len(one) == len(other)
        expected = one.moved(world, "world") if one.frame == "world" else one
        distances_m = np.linalg.norm(expected.centres[:, None] - other.centres, axis=2)
        # Which of two tracks in one place is which can be reports by their ids only.
        same = [[names.get(a, b) == b for b in other.ids.tolist()] for a in one.ids.tolist()]
        columns = (distances_m + 1e3 * ~np.array(same, bool).reshape(distances_m.shape)).argmin(
            axis=1
        )
        assert len(set(columns.tolist())) == len(columns)
        names.update(zip(one.ids.tolist(), other.ids[columns].tolist(), strict=True))
        for field in ("centres", "velocities", "covariances", "sizes", "scores", "states"):
            np.testing.assert_allclose(
                getattr(other, field)[columns], getattr(expected, field), atol=1e-6
            )
        turned = other.yaws[columns] - expected.yaws
        np.testing.assert_allclose(np.cos(turned), 1, atol=1e-9)


def test_stamps_that_do_not_increase_are_refused_and_change_nothing(tracker):
    episode = list(traffic(8))
    expected = run(tracker, episode)
    tracker.reset()
    reports = []
    for k, detections in enumerate(episode):
        reports.append(tracker.update(detections, None))
        for wrong in (detections.stamp_s, detections.stamp_s - 1.0, np.nan, np.inf):
            if k == 10:
                with pytest.raises(ValueError, match="stamps"):
                    tracker.update(replace(detections, stamp_s=wrong), None)
    assert reports == expected


def test_a_pose_that_comes_and_goes_is_refused(tracker):
    for first, second in ((None, Pose.identity()), (Pose.identity(), None)):
        tracker.reset()
        tracker.update(boxes(np.array([[10.0, 0.0]]), 0.0), first)
        with pytest.raises(ValueError, match="ego pose"):
            tracker.update(boxes(np.array([[10.0, 0.0]]), 0.1), second)


def test_late_and_missing_ticks_lose_no_track(tracker):
    """A car at 12 m/s; ticks come late by up to 40 ms, every seventh not at all."""
    rng = np.random.default_rng(0)
    stamps = [0.1 * k + 0.04 * rng.random() for k in range(40) if k % 7 != 5]
    reports = run(tracker, (boxes(np.array([[12 * t - 20, 3.0]]), t) for t in stamps))
    assert {int(i) for tracks in reports for i in tracks.ids} == {0}
    assert reports[-1].velocities[0] == pytest.approx((12, 0), abs=0.3)


def test_empty_frames_lose_no_track(tracker):
    episode = [boxes(np.array([[1.2 * k - 20, 3.0]])[: k % 9 != 7], 0.1 * k) for k in range(40)]
    reports = run(tracker, episode)
    assert {int(i) for tracks in reports for i in tracks.ids} == {0}


def test_a_detection_that_comes_twice_is_one_object_or_two(tracker):
    reports = run(tracker, (boxes(np.array([[0.8 * k, 3.0]] * 2), 0.1 * k) for k in range(20)))
    assert len({int(i) for tracks in reports for i in tracks.ids}) <= 2
    assert reports[-1].centres[:, :2] == pytest.approx(
        np.tile([15.2, 3.0], (len(reports[-1]), 1)), abs=0.3
    )


def car_then_pedestrian(k):
    """A car that stands, and from the eleventh frame on a pedestrian in its place."""
    return boxes(
        np.array([[10.0, 0.0]]), 0.1 * k, category=[Category.CAR, Category.PEDESTRIAN][k > 9]
    )


def families(tracker):
    """Return the families that each identity went by."""
    families_of_ids: dict[int, set[str]] = {}
    for tracks in run(tracker, map(car_then_pedestrian, range(20))):
        for identity, category in zip(tracks.ids.tolist(), tracks.categories, strict=True):
            families_of_ids.setdefault(identity, set()).add(Category(category).family)
    return families_of_ids


@pytest.mark.parametrize("name", [n for n in LAWFUL if n not in KNOW_NO_CATEGORIES])
def test_a_car_never_becomes_a_pedestrian(name):
    families_of_ids = families(TRACKERS.make(name))
    assert all(len(of_one) == 1 for of_one in families_of_ids.values())
    assert len(families_of_ids) == 2


def test_without_categories_the_position_decides_alone():
    assert len(families(TRACKERS.make("nearest"))) == 1


OFFLINE = [n for n in TRACKERS.installed() if is_offline(TRACKERS.resolve(n).factory)]


@pytest.mark.parametrize("name", OFFLINE)
def test_until_the_end_an_offline_tracker_is_its_online_one_to_the_last_bit(name):
    online = TRACKERS.make(name.removesuffix("-offline"))
    late = TRACKERS.make(name)
    assert isinstance(late, OfflineTracker)
    assert not is_offline(type(online))
    expected = run(online, traffic(9))
    assert run(late, traffic(9)) == expected
    late.rescored(expected)
    after = boxes(np.array([[10.0, 0.0]]), 2.5)
    assert late.update(after, None) == online.update(after, None)
