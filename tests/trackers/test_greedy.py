import pytest
from tracked_scenes import boxes, identities, make, run

from roadscope.core import Category


def test_the_higher_score_is_assigned_first():
    tracker = make("greedy")
    run(tracker, [boxes([(0, 0)], k) for k in range(3)])
    tracks = tracker.update(boxes([(0.3, 0), (1.5, 0)], 3, [0.5, 0.9]), None)
    of_id = dict(zip(tracks.ids.tolist(), tracks.scores.tolist(), strict=True))
    assert of_id == {0: 0.9, 1: 0.5}


def test_of_equal_scores_the_nearer_is_assigned_first():
    tracker = make("greedy")
    run(tracker, [boxes([(0, 0)], k) for k in range(3)])
    tracks = tracker.update(boxes([(-1.5, 0), (0.3, 0)], 3), None)
    assert tracks.ids[tracks.centres[:, 0].argmax()] == 0


def test_tracks_are_predicted_by_their_velocity():
    """At 30 m/s a car comes nearer to the last position of the next one than to its own."""
    episode = [boxes([(3 * k, 0), (3 * k + 5, 0)][: 1 + (k > 3)], k) for k in range(8)]
    tracks = run(make("greedy"), episode)
    assert identities(tracks) == {0, 1}
    assert tracks[-1].centres[:, 0].tolist() == pytest.approx([21, 26], abs=0.1)


@pytest.mark.parametrize(
    ("category", "gate"), [(Category.CAR, 4.0), (Category.CYCLIST, 3.0), (Category.PEDESTRIAN, 1.0)]
)
def test_each_family_has_its_gate(category, gate):
    for jump, ids in ((0.95 * gate, {0}), (1.05 * gate, {0, 1})):
        episode = [boxes([(0, jump * k)], k, category=category) for k in range(2)]
        assert identities(run(make("greedy"), episode)) == ids


def test_a_track_is_dropped_after_three_misses():
    episode = [boxes([(0, 0)] if k < 2 else [], k) for k in range(7)]
    assert [len(each) for each in run(make("greedy"), episode)] == [1, 1, 1, 1, 1, 0, 0]
