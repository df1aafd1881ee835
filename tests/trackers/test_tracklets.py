from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import Detections, Pose, TrackState
from roadscope.trackers import Gaussians, LifeCycle, TrackerTick, Tracklets


def detections(n, seed=0, stamp_s=0.0, frame="ego"):
    rng = np.random.default_rng(seed)
    return Detections(
        rng.uniform(-9, 9, (n, 3)),
        rng.uniform(1, 4, (n, 3)),
        rng.uniform(-3, 3, n),
        rng.integers(0, 7, n),
        rng.random(n),
        frame,
        stamp_s,
    )


def started(targets, first_id=0):
    n = len(targets)
    means = np.column_stack([targets.centres[:, :2], np.zeros((n, 2))])
    return Tracklets.started(first_id, targets, Gaussians(means, np.tile(np.eye(4), (n, 1, 1))))


def test_a_track_from_first_to_last():
    first, second = detections(2), detections(1, seed=1)
    tracks = started(first, first_id=5)
    assert tracks.ids.tolist() == [5, 6]
    np.testing.assert_array_equal(tracks.boxes[:, 3:6], first.sizes)
    np.testing.assert_array_equal(tracks.boxes[:, :3], first.centres)
    on = tracks.predicted(Gaussians(tracks.beliefs.means + 1, tracks.beliefs.covariances))
    rows = np.array([1])
    updated = on.updated(rows, second, on.beliefs.select(rows))
    assert updated.hits.tolist() == [1, 2]
    assert updated.misses.tolist() == [1, 0]
    assert updated.sizes.tolist() == [first.sizes[0].tolist(), second.sizes[0].tolist()]
    assert updated.scores.tolist() == [first.scores[0], second.scores[0]]
    tick = TrackerTick.after(None, detections(0, stamp_s=0.1), None)
    reported = updated.as_tracks(np.array([2, 1], np.int8), tick)
    assert reported.ids.tolist() == [5, 6]
    np.testing.assert_array_equal(reported.centres[:, :2], first.centres[:, :2] + 1)
    assert reported.centres[1, 2] == second.centres[0, 2]
    assert (reported.frame, reported.stamp_s) == ("ego", 0.1)
    assert tracks.hits.tolist() == [1, 1], "the table before stays as it was"


def test_rows_are_selected_and_joined():
    tracks = started(detections(3))
    both = tracks.select(np.array([2, 0])).joined(started(detections(1, seed=4), first_id=3))
    assert both.ids.tolist() == [2, 0, 3]
    assert len(both.beliefs) == 3
    assert len(Tracklets.empty(4).joined(both)) == 3
    assert len(both.select(np.zeros(3, bool))) == 0


def test_states_and_survivors():
    rule = LifeCycle(confirm_hits=3, coast_frames=5, tentative_frames=1, shown_misses=1)
    tracks = replace(
        started(detections(6)),
        hits=np.array([1, 3, 3, 3, 1, 3]),
        misses=np.array([0, 0, 1, 2, 2, 6]),
    )
    assert rule.states(tracks)[:4].tolist() == [
        TrackState.TENTATIVE,
        TrackState.CONFIRMED,
        TrackState.COASTING,
        TrackState.TENTATIVE,
    ]
    assert rule.survivors(tracks).ids.tolist() == [0, 1, 2, 3]


def test_tick_moves_into_the_world_and_knows_the_egos_speed():
    first = TrackerTick.after(None, detections(2), Pose.planar(0, 0, 1.0))
    assert (first.frame, first.period_s, first.ego_velocity) == ("world", 0.0, None)
    second = TrackerTick.after(first, detections(2, stamp_s=0.5), Pose.planar(2, 1, 1.0))
    assert second.period_s == 0.5
    assert second.ego_velocity.tolist() == [4, 2]


@given(seed=st.integers(0, 1000))
def test_tick_has_one_order(seed):
    rng = np.random.default_rng(seed)
    original = detections(5, seed)
    mixed = original.select(rng.permutation(5))
    one, other = (TrackerTick.after(None, each, None) for each in (original, mixed))
    assert one.detections == other.detections


@pytest.mark.parametrize(
    ("later", "pose", "message"),
    [
        (detections(1), None, "stamps must increase: 0.0 s after 0.0 s"),
        (detections(1, stamp_s=np.nan), None, "stamps must be finite, got nan s"),
        (detections(1, stamp_s=1.0), Pose.identity(), "at every update or at none"),
        (detections(1, stamp_s=1.0, frame="world"), None, "one frame: 'world' after 'ego'"),
    ],
)
def test_a_tick_refuses(later, pose, message):
    first = TrackerTick.after(None, detections(1), None)
    with pytest.raises(ValueError, match=message):
        TrackerTick.after(first, later, pose)
