import pytest
from tracked_scenes import boxes, identities, make, run

from roadscope.core import TrackState

TENTATIVE, CONFIRMED, _ = TrackState


def test_one_of_two_boxes_of_a_car_is_suppressed():
    episode = [boxes([(5, 0), (5.8, 0.2)], k, [0.9, 0.8]) for k in range(5)]
    assert len(identities(run(make("simple-track"), episode))) == 1
    assert len(identities(run(make("simple-track", most_overlap=0.9), episode))) == 2


def test_low_scores_keep_a_track_alive_where_it_is_expected():
    """For ten ticks the detector is unsure, and 0.5 m aside."""
    unsure = range(8, 18)
    episode = [
        boxes([(0.5 * k, 0.5 * (k in unsure))], k, 0.3 if k in unsure else 0.9) for k in range(25)
    ]
    tracks = run(make("simple-track"), episode)
    assert identities(tracks) == {0}
    for k in unsure:
        assert tracks[k].states.tolist() == [CONFIRMED]
        assert tracks[k].centres[0, :2] == pytest.approx((0.5 * k, 0.0), abs=0.05)
        assert tracks[k].scores.tolist() == [0.9]
    cut = run(make("ab3dmot", least_score=0.7, overlap="giou", least=-0.5), episode)
    assert len(identities(cut)) == 2


def test_low_scores_start_and_confirm_nothing():
    assert not any(
        len(t) for t in run(make("simple-track"), [boxes([(5, 0)], k, 0.5) for k in range(5)])
    )
    scores = [0.9, 0.9, 0.3, 0.3, 0.9]
    tracks = run(make("simple-track"), [boxes([(5, 0)], k, s) for k, s in enumerate(scores)])
    states = [t.states.tolist() for t in tracks]
    assert states == [[TENTATIVE]] * 4 + [[CONFIRMED]]


def test_scores_below_the_low_one_keep_no_track_alive():
    scores = [0.9, 0.9, 0.9, 0.05, 0.05, 0.05]
    tracks = run(make("simple-track"), [boxes([(5, 0)], k, s) for k, s in enumerate(scores)])
    assert [t.states.tolist() for t in tracks[2:]] == [[CONFIRMED], [TENTATIVE], [], []]


def test_high_scores_are_assigned_first():
    tracker = make("simple-track")
    run(tracker, [boxes([(5, 0)], k) for k in range(3)])
    tracks = tracker.update(boxes([(5, 0), (5, 2.2)], 3, [0.3, 0.8]), None)
    assert tracks.ids.tolist() == [0]
    assert tracks.scores.tolist() == [0.8]


def test_a_car_that_moves_more_than_its_length_is_one_track():
    """At 60 m/s a car jumps clear of itself between two ticks."""
    assert identities(run(make("simple-track"), [boxes([(6.0 * k, 0)], k) for k in range(6)])) == {
        0
    }
