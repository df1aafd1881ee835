"""What every registered tracker promises."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roadscope.core import Detections, Pose, RecordError
from roadscope.trackers import TRACKERS
from roadscope.trackers.api import Tracker


@pytest.fixture(params=TRACKERS.names())
def tracker(request):
    return TRACKERS.make(request.param)


def boxes(centres, stamp_s):
    n = len(centres)
    return Detections(
        np.column_stack([centres, np.full(n, 0.75)]) if n else np.empty((0, 3)),
        np.tile([4.6, 1.85, 1.5], (n, 1)), np.zeros(n), np.zeros(n, int), np.full(n, 0.9),
        "ego", stamp_s,
    )  # fmt: skip


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


@pytest.mark.parametrize("name", TRACKERS.names())
def test_constructor_is_keyword_only_with_defaults(name):
    for parameter in inspect.signature(TRACKERS.resolve(name).factory).parameters.values():
        assert parameter.kind is parameter.KEYWORD_ONLY
        assert parameter.default is not parameter.empty


def test_meets_the_protocol(tracker):
    assert isinstance(tracker, Tracker)


def test_no_detections_no_tracks(tracker):
    for k in range(3):
        tracks = tracker.update(Detections.empty(0.1 * k), None)
        assert len(tracks) == 0
        assert tracks.stamp_s == 0.1 * k


def test_one_object_keeps_one_identity(tracker):
    rng = np.random.default_rng(0)
    episode = [
        boxes(np.array([[20 + 0.5 * k, 3.0]]) + 0.1 * rng.standard_normal(2), 0.1 * k)
        for k in range(30)
    ]
    told = run(tracker, episode)
    assert len({int(i) for tracks in told for i in tracks.ids}) == 1
    assert told[-1].centres[0, :2] == pytest.approx((34.5, 3.0), abs=0.3)
    assert told[-1].velocities[0] == pytest.approx((5, 0), abs=0.5)
    assert told[-1].sizes[0].tolist() == [4.6, 1.85, 1.5]


def test_identities_are_never_given_again(tracker):
    last: dict[int, int] = {}
    for k, tracks in enumerate(run(tracker, traffic(3, ticks=60))):
        assert len(set(tracks.ids.tolist())) == len(tracks)
        for identity in tracks.ids.tolist():
            assert last.get(identity, k - 1) == k - 1, "an identity came back"
            last[identity] = k
    assert len(last) > 10


def test_reset_forgets(tracker):
    first = run(tracker, traffic(1))
    tracker.reset()
    run(tracker, traffic(2))
    tracker.reset()
    assert run(tracker, traffic(1)) == first


@pytest.mark.parametrize("seed", range(3))
def test_order_of_detections_is_irrelevant(tracker, seed):
    rng = np.random.default_rng(seed)
    first = run(tracker, traffic(seed))
    tracker.reset()
    mixed = (d.select(rng.permutation(len(d))) for d in traffic(seed))
    assert run(tracker, mixed) == first


def test_input_is_left_alone(tracker):
    given_before, given_now = list(traffic(1)), list(traffic(1))
    run(tracker, given_now)
    assert given_now == given_before


def test_covariances_are_proper_and_grow_while_unseen(tracker):
    told = run(tracker, traffic(4))
    for tracks in told:
        assert np.allclose(tracks.covariances, tracks.covariances.transpose(0, 2, 1))
        assert (np.linalg.eigvalsh(tracks.covariances) > 0).all()
    unseen = tracker.update(Detections.empty(2.5), None)
    before = dict(zip(told[-1].ids.tolist(), told[-1].covariances, strict=True))
    for identity, covariance in zip(unseen.ids.tolist(), unseen.covariances, strict=True):
        if identity in before:
            assert np.trace(covariance[:2, :2]) > np.trace(before[identity][:2, :2])


def test_known_pose_gives_world_or_ego_frame(tracker):
    pose = Pose.planar(100.0, 50.0, np.pi / 2)
    tracks = tracker.update(boxes(np.array([[10.0, 0.0]]), 0.0), pose)
    expected = {"world": (100.0, 60.0), "ego": (10.0, 0.0)}[tracks.frame]
    assert tracks.centres[0, :2] == pytest.approx(expected)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(TRACKERS.names()))
def test_any_sequence_gives_proper_tracks(seed, name):
    rng = np.random.default_rng(seed)
    tracker = TRACKERS.make(name)
    for k in range(12):
        n = rng.integers(0, 6)
        centres = np.round(rng.uniform(-5, 5, (n, 2)))
        tracks = tracker.update(boxes(centres, 0.1 * k), None)
        # Every detection is in some track's place or drew one towards it.
        assert len(tracks) >= n


def test_values_that_are_no_boxes_never_reach_a_tracker():
    good = boxes(np.array([[10.0, 0.0]]), 0.0)
    with pytest.raises(RecordError, match=r"Detections\.centres: must be finite"):
        replace(good, centres=np.array([[np.nan, 0, 0]]))
    with pytest.raises(RecordError, match=r"Detections\.sizes: expected positive"):
        replace(good, sizes=np.zeros((1, 3)))
    with pytest.raises(RecordError, match=r"Detections\.centres: expected shape \(N, 3\)"):
        replace(good, centres=np.zeros((1, 2)))
