import numpy as np
import pytest
from tracked_scenes import boxes, identities, make, run

from roadscope.core import TrackState


def test_the_most_confident_prediction_chooses_first():
    """Two tracks, one detection between them, nearer to the track that was less sure."""
    tracker = make("pc3t")
    run(tracker, [boxes([(0, 0), (0, 3)], k, [0.9, 0.7]) for k in range(4)])
    tracks = tracker.update(boxes([(0, 2)], 4, 0.8), None)
    confirmed = tracks.states == TrackState.CONFIRMED
    assert tracks.ids[confirmed].tolist() == [0]


def test_confidence_falls_with_misses():
    """The track that was surer has been missed for ten ticks."""
    tracker = make("pc3t", gate_m=2.5)
    run(tracker, [boxes([(0, 0), (0, 3)], k, [0.9, 0.8]) for k in range(4)])
    run(tracker, [boxes([(0, 3)], k, 0.8) for k in range(4, 14)])
    tracks = tracker.update(boxes([(0, 1.5)], 14, 0.8), None)
    assert tracks.ids[tracks.states == TrackState.CONFIRMED].tolist() == [1]


@pytest.mark.parametrize(
    ("boxed", "turned"), [((4.6, 1.85, 1.5), np.pi / 2), ((8.0, 2.5, 3.0), 0.0)]
)
def test_boxes_and_headings_cost(boxed, turned):
    """Of two detections the nearer is turned, or larger: the other is taken."""
    tracker = make("pc3t")
    run(tracker, [boxes([(0, 0)], k) for k in range(4)])
    pair = boxes([(0, 0.4), (0, -0.8)], 4, yaws=[turned, 0.0])
    pair.sizes[0] = boxed
    tracks = tracker.update(pair, None)
    assert tracks.centres[tracks.ids == 0][0, 1] < -0.1


def test_speeds_cost():
    """Aside or ahead by as much: who drives at 10 m/s does not cover 18 in a tick's time."""
    tracker = make("pc3t")
    run(tracker, [boxes([(1.0 * k, 0)], k) for k in range(8)])
    tracks = tracker.update(boxes([(8.8, 0), (8.0, 0.81)], 8), None)
    assert tracks.centres[tracks.ids == 0][0, 1] > 0.2


def test_tentative_tracks_are_dropped_sooner():
    fresh = run(make("pc3t"), [boxes([(5, 0)] if k < 1 else [], k) for k in range(6)])
    assert [len(t) for t in fresh] == [1, 1, 1, 0, 0, 0]
    old = run(make("pc3t"), [boxes([(5, 0)] if k < 4 else [], k) for k in range(20)])
    assert [len(t) for t in old] == [1] * 16 + [0] * 4


def test_scores_that_start_and_continue_tracks():
    episode = [boxes([(5, 0)], k, 0.6) for k in range(4)]
    assert identities(run(make("pc3t"), episode)) == {0}
    assert not identities(run(make("pc3t", new_score=0.9), episode))
    assert not identities(run(make("pc3t", least_score=0.7), episode))
