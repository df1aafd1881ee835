import numpy as np
import pytest
from tracked_scenes import boxes, identities, told

from roadscope.core import TrackState
from roadscope.trackers.bytetrack import ByteTracker
from roadscope.trackers.gnn import GnnTracker


def bend(k):
    """A bend of 12 m, which no straight prediction follows for long."""
    return (12 * np.sin(0.08 * k), 12 - 12 * np.cos(0.08 * k))


def fading(k):
    """Half hidden from tick 12 to 26, the detector is unsure."""
    return 0.25 if 12 <= k < 27 else 0.9


def test_low_scores_keep_a_track_that_a_cut_by_score_loses():
    episode = [boxes([bend(k)], k, fading(k), yaws=0.08 * k) for k in range(40)]
    tracks = told(ByteTracker(), episode)
    assert len(identities(tracks)) == 1
    assert {int(each.states[0]) for each in tracks[1:]} == {TrackState.CONFIRMED}
    cut = told(GnnTracker(least_score=0.6, coast_frames=30), episode)
    assert len(identities(cut, TrackState.CONFIRMED)) == 2


def test_low_scores_open_no_track():
    tracks = told(ByteTracker(), [boxes([(5, 0)], k, 0.5) for k in range(5)])
    assert not any(len(each) for each in tracks)
    between = told(ByteTracker(), [boxes([(5, 0)], k, 0.65) for k in range(5)])
    assert not any(len(each) for each in between), "sure, but not sure enough for a new track"


def test_below_the_low_score_nothing_is_looked_at():
    scores = [0.9, 0.9, 0.05, 0.05]
    tracks = told(ByteTracker(), [boxes([(5, 0)], k, s) for k, s in enumerate(scores)])
    assert [each.states.tolist() for each in tracks] == [[0], [1], [0], [0]]


def test_sure_detections_choose_first():
    """The unsure one lies nearer, yet the sure one gets the track."""
    tracker = ByteTracker()
    told(tracker, [boxes([(5, 0)], k) for k in range(3)])
    tracks = tracker.update(boxes([(5, 0), (6, 0)], 3, [0.3, 0.8]), None)
    assert len(tracks) == 1
    assert tracks.scores.tolist() == [0.8]


def test_a_lost_track_is_found_by_sure_detections_only():
    tracker = ByteTracker()
    told(tracker, [boxes([(5, 0)] if k < 3 else [], k) for k in range(5)])
    unsure = tracker.update(boxes([(5, 0)], 5, 0.3), None)
    assert unsure.states.tolist() == [TrackState.TENTATIVE]
    sure = tracker.update(boxes([(5, 0)], 6, 0.9), None)
    assert sure.states.tolist() == [TrackState.CONFIRMED]
    assert sure.ids.tolist() == [0]


def test_a_first_detection_alone_is_dropped_at_once():
    tracks = told(ByteTracker(), [boxes([(5, 0)], 0), boxes([], 1), boxes([(5, 0)], 2)])
    assert [each.ids.tolist() for each in tracks] == [[0], [], [1]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"high_score": 0.8}, "must not fall, got 0.1, 0.8, 0.7"),
        ({"low_score": -0.1}, "low_score must lie in 0 to 1, got -0.1"),
        ({"least_again": 1.0}, "the least giou must lie in -1 to 1, got 1.0"),
        ({"speed_m_s": 0.0}, "speed_m_s must be positive, got 0.0"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        ByteTracker(**arguments)
