import numpy as np
from tracked_scenes import boxes, identities, make, run

from roadscope.core import TrackState


def bend(k):
    """A bend of 12 m, which no straight prediction follows for long."""
    return (12 * np.sin(0.08 * k), 12 - 12 * np.cos(0.08 * k))


def fading(k):
    """Scores are low from tick 12 to 26, when the car is half hidden."""
    return 0.25 if 12 <= k < 27 else 0.9


def test_low_scores_keep_a_track_that_a_cut_by_score_loses():
    episode = [boxes([bend(k)], k, fading(k), yaws=0.08 * k) for k in range(40)]
    tracks = run(make("bytetrack"), episode)
    assert len(identities(tracks)) == 1
    assert {int(each.states[0]) for each in tracks[1:]} == {TrackState.CONFIRMED}
    cut = run(make("gnn", least_score=0.6, coast_frames=30), episode)
    assert len(identities(cut, TrackState.CONFIRMED)) == 2


def test_low_scores_start_no_track():
    tracks = run(make("bytetrack"), [boxes([(5, 0)], k, 0.5) for k in range(5)])
    assert not any(len(each) for each in tracks)
    between = run(make("bytetrack"), [boxes([(5, 0)], k, 0.65) for k in range(5)])
    assert not any(len(each) for each in between), "sure, but not sure enough for a new track"


def test_detections_below_the_low_score_are_ignored():
    scores = [0.9, 0.9, 0.05, 0.05]
    tracks = run(make("bytetrack"), [boxes([(5, 0)], k, s) for k, s in enumerate(scores)])
    assert [each.states.tolist() for each in tracks] == [[0], [1], [0], [0]]


def test_high_scores_are_assigned_first():
    """The detection of low score lies nearer, yet that of high score gets the track."""
    tracker = make("bytetrack")
    run(tracker, [boxes([(5, 0)], k) for k in range(3)])
    tracks = tracker.update(boxes([(5, 0), (6, 0)], 3, [0.3, 0.8]), None)
    assert len(tracks) == 1
    assert tracks.scores.tolist() == [0.8]


def test_a_coasting_track_continues_with_high_scores_only():
    tracker = make("bytetrack")
    run(tracker, [boxes([(5, 0)] if k < 3 else [], k) for k in range(5)])
    unsure = tracker.update(boxes([(5, 0)], 5, 0.3), None)
    assert unsure.states.tolist() == [TrackState.TENTATIVE]
    sure = tracker.update(boxes([(5, 0)], 6, 0.9), None)
    assert sure.states.tolist() == [TrackState.CONFIRMED]
    assert sure.ids.tolist() == [0]


def test_a_tentative_track_is_dropped_at_its_first_miss():
    tracks = run(make("bytetrack"), [boxes([(5, 0)], 0), boxes([], 1), boxes([(5, 0)], 2)])
    assert [each.ids.tolist() for each in tracks] == [[0], [], [1]]
