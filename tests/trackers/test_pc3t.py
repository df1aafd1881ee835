import numpy as np
import pytest
from tracked_scenes import boxes, identities, told

from roadscope.core import TrackState
from roadscope.trackers.pc3t import Pc3tTracker


def test_the_surest_prediction_chooses_first():
    """Two tracks, one detection between them, nearer to the track that was less sure."""
    tracker = Pc3tTracker()
    told(tracker, [boxes([(0, 0), (0, 3)], k, [0.9, 0.7]) for k in range(4)])
    tracks = tracker.update(boxes([(0, 2)], 4, 0.8), None)
    seen = tracks.states == TrackState.CONFIRMED
    assert tracks.ids[seen].tolist() == [0]


def test_confidence_falls_while_unseen():
    """The track that was surer has been missed for ten ticks."""
    tracker = Pc3tTracker(gate_m=2.5)
    told(tracker, [boxes([(0, 0), (0, 3)], k, [0.9, 0.8]) for k in range(4)])
    told(tracker, [boxes([(0, 3)], k, 0.8) for k in range(4, 14)])
    tracks = tracker.update(boxes([(0, 1.5)], 14, 0.8), None)
    assert tracks.ids[tracks.states == TrackState.CONFIRMED].tolist() == [1]


@pytest.mark.parametrize(
    ("boxed", "turned"), [((4.6, 1.85, 1.5), np.pi / 2), ((8.0, 2.5, 3.0), 0.0)]
)
def test_boxes_and_headings_cost(boxed, turned):
    """Of two detections the nearer is turned, or larger: the other is taken."""
    tracker = Pc3tTracker()
    told(tracker, [boxes([(0, 0)], k) for k in range(4)])
    pair = boxes([(0, 0.4), (0, -0.8)], 4, yaws=[turned, 0.0])
    pair.sizes[0] = boxed
    tracks = tracker.update(pair, None)
    assert tracks.centres[tracks.ids == 0][0, 1] < -0.1


def test_speeds_cost():
    """Aside or ahead by as much: who drives at 10 m/s does not cover 18 in a tick's time."""
    tracker = Pc3tTracker()
    told(tracker, [boxes([(1.0 * k, 0)], k) for k in range(8)])
    tracks = tracker.update(boxes([(8.8, 0), (8.0, 0.81)], 8), None)
    assert tracks.centres[tracks.ids == 0][0, 1] > 0.2


def test_new_tracks_are_given_up_sooner():
    fresh = told(Pc3tTracker(), [boxes([(5, 0)] if k < 1 else [], k) for k in range(6)])
    assert [len(t) for t in fresh] == [1, 1, 1, 0, 0, 0]
    old = told(Pc3tTracker(), [boxes([(5, 0)] if k < 4 else [], k) for k in range(20)])
    assert [len(t) for t in old] == [1] * 16 + [0] * 4


def test_scores_that_open_and_continue():
    episode = [boxes([(5, 0)], k, 0.6) for k in range(4)]
    assert identities(told(Pc3tTracker(), episode)) == {0}
    assert not identities(told(Pc3tTracker(new_score=0.9), episode))
    assert not identities(told(Pc3tTracker(least_score=0.7), episode))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"decay": 1.5}, "decay must lie in 0 to 1, got 1.5"),
        ({"gate_m": 0.0}, "gate_m must be positive, got 0.0"),
        ({"coast_frames": -1}, "coast_frames must be 0 or more, got -1"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        Pc3tTracker(**arguments)
