import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import Detections, Pose, TrackState
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.life_cycle import kept, track_states
from roadscope.trackers.ticks import Tick
from roadscope.trackers.tracklets import Tracklets, boxes_of


def detections(n, seed=0, stamp_s=0.0, frame="ego"):
    rng = np.random.default_rng(seed)
    return Detections(
        rng.uniform(-9, 9, (n, 3)), rng.uniform(1, 4, (n, 3)), rng.uniform(-3, 3, n),
        rng.integers(0, 7, n), rng.random(n), frame, stamp_s,
    )  # fmt: skip


def started(targets, first_id=0):
    n = len(targets)
    means = np.column_stack([targets.centres[:, :2], np.zeros((n, 2))])
    return Tracklets.opened(first_id, targets, Gaussians(means, np.tile(np.eye(4), (n, 1, 1))))


def test_a_track_from_first_to_last():
    first, second = detections(2), detections(1, seed=1)
    tracks = started(first, first_id=5)
    assert tracks.ids.tolist() == [5, 6]
    np.testing.assert_array_equal(tracks.boxes, boxes_of(first))
    on = tracks.moved_on(Gaussians(tracks.beliefs.means + 1, tracks.beliefs.covariances))
    rows = np.array([1])
    seen = on.seen(rows, second, on.beliefs.select(rows))
    assert seen.hits.tolist() == [1, 2]
    assert seen.misses.tolist() == [1, 0]
    assert seen.ages.tolist() == [1, 1]
    assert seen.sizes.tolist() == [first.sizes[0].tolist(), second.sizes[0].tolist()]
    assert seen.scores.tolist() == [first.scores[0], second.scores[0]]
    told = seen.report(seen.beliefs, np.array([2, 1], np.int8), "ego", 0.1)
    assert told.ids.tolist() == [5, 6]
    np.testing.assert_array_equal(told.centres[:, :2], first.centres[:, :2] + 1)
    assert told.centres[1, 2] == second.centres[0, 2]
    assert tracks.hits.tolist() == [1, 1], "the table before stays as it was"


def test_rows_are_selected_and_joined():
    tracks = started(detections(3))
    both = tracks.select(np.array([2, 0])).joined(started(detections(1, seed=4), first_id=3))
    assert both.ids.tolist() == [2, 0, 3]
    assert len(both.beliefs) == 3
    assert len(Tracklets.empty(4).joined(both)) == 3
    assert len(both.select(np.zeros(3, bool))) == 0


def test_states():
    hits, misses = np.array([1, 3, 3, 3]), np.array([0, 0, 1, 2])
    states = track_states(hits, misses, confirm_hits=3, shown_misses=1)
    assert states.dtype == np.int8
    assert states.tolist() == [
        TrackState.TENTATIVE, TrackState.CONFIRMED, TrackState.COASTING, TrackState.TENTATIVE,
    ]  # fmt: skip


def test_patience():
    hits, misses = np.array([1, 1, 3, 3]), np.array([1, 2, 5, 6])
    alive = kept(hits, misses, confirm_hits=3, coast_frames=5, tentative_frames=1)
    assert alive.tolist() == [True, False, True, False]


def test_tick_moves_into_the_world_and_knows_the_egos_speed():
    first = Tick.after(None, detections(2), Pose.planar(0, 0, 1.0))
    assert (first.frame, first.period_s, first.ego_velocity) == ("world", 0.0, None)
    second = Tick.after(first, detections(2, stamp_s=0.5), Pose.planar(2, 1, 1.0))
    assert second.period_s == 0.5
    assert second.ego_velocity.tolist() == [4, 2]


@given(seed=st.integers(0, 1000))
def test_tick_has_one_order(seed):
    rng = np.random.default_rng(seed)
    given_now = detections(5, seed)
    mixed = given_now.select(rng.permutation(5))
    assert Tick.after(None, mixed, None).targets == Tick.after(None, given_now, None).targets


@pytest.mark.parametrize(
    ("later", "pose", "message"),
    [
        (detections(1), None, "stamps must increase: 0.0 s after 0.0 s"),
        (detections(1, stamp_s=np.nan), None, "stamps must be finite, got nan s"),
        (detections(1, stamp_s=1.0), Pose.identity(), "at every update or at none"),
        (detections(1, stamp_s=1.0, frame="world"), None, "one frame: 'world' after 'ego'"),
    ],
)
def test_what_a_tick_refuses(later, pose, message):
    first = Tick.after(None, detections(1), None)
    with pytest.raises(ValueError, match=message):
        Tick.after(first, later, pose)
