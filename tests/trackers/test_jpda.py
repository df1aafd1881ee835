import numpy as np
import pytest
from dense_costs import candidates

from roadscope.core import Detections, TrackState
from roadscope.trackers.jpda import JpdaTracker, likeliest, merged
from roadscope.trackers.jpda_existence import Existence, Sighting
from roadscope.trackers.kalman import Gaussians
from roadscope.trackers.place_filter import PlaceFilter
from roadscope.trackers.pmbm import PmbmTracker


def seen(tick, places, score=0.5):
    places = np.asarray(places, float).reshape(-1, 2)
    n = len(places)
    return Detections(
        np.column_stack([places, np.full(n, 0.75)]), np.tile([4.6, 1.85, 1.5], (n, 1)),
        np.zeros(n), np.zeros(n, int), np.full(n, score), "ego", 0.1 * tick,
    )  # fmt: skip


def test_merged_has_the_moments_of_the_mixture():
    kalman = PlaceFilter()
    belief = Gaussians(np.array([[1.0, 2, 3, 4]]), np.diag([0.5, 0.4, 2, 3])[None])
    places, shares = np.array([[1.5, 2.2], [0.4, 1.7]]), np.array([[0.5, 0.2]])
    found = merged(belief, places, candidates(shares), kalman.R)
    parts = [belief, *(kalman.corrected(belief, place[None]) for place in places)]
    weights = np.array([0.3, 0.5, 0.2])
    mean = sum(w * part.means[0] for w, part in zip(weights, parts, strict=True))
    covariance = sum(
        w * (part.covariances[0] + np.outer(part.means[0] - mean, part.means[0] - mean))
        for w, part in zip(weights, parts, strict=True)
    )
    np.testing.assert_allclose(found.means[0], mean, atol=1e-12)
    np.testing.assert_allclose(found.covariances[0], covariance, atol=1e-12)


def test_chain_in_two_steps_is_the_chain_in_one():
    sighting, start = Sighting(), Existence(np.array([0.7, 0.1]), np.array([0.1, 0.8]))
    once = sighting.moved_on(start, 0.3)
    twice = sighting.moved_on(sighting.moved_on(start, 0.1), 0.2)
    np.testing.assert_allclose(once.visible, twice.visible, atol=1e-12)
    np.testing.assert_allclose(once.there, start.there * np.exp(-0.3 / 30), atol=1e-12)
    late = sighting.moved_on(start, 20.0)
    np.testing.assert_allclose(late.visible / late.hidden, 10.0, rtol=1e-6)


def test_a_hidden_target_is_doubted_less_than_a_visible_one():
    visible = Existence(np.array([0.9]), np.array([0.0])).missed(0.9)
    hidden = Existence(np.array([0.0]), np.array([0.9])).missed(0.9)
    assert visible.there == pytest.approx(0.09 / 0.19)
    assert hidden.there == pytest.approx(0.9)


def test_marginals_are_read_one_to_one():
    beta = np.array([[0.6, 0.3], [0.35, 0.0]])
    rows, columns = likeliest(candidates(beta), np.array([0.05, 0.7]))
    assert (rows.tolist(), columns.tolist()) == ([0], [0])
    rows, columns = likeliest(candidates(beta), np.array([0.05, 0.01]))
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [1, 0])


def test_existence_rises_with_hits_and_falls_with_misses():
    tracker = JpdaTracker(traits="unknown")
    rising = [tracker.update(seen(k, [(20 + k, 0)]), None) for k in range(6)]
    scores = [tracks.scores[0] for tracks in rising]
    assert scores[0] < 0.2
    assert scores[-1] > 0.99
    assert rising[0].states.tolist() == [TrackState.TENTATIVE]
    assert rising[-1].states.tolist() == [TrackState.CONFIRMED]
    falling = []
    for k in range(6, 200):
        tracks = tracker.update(seen(k, []), None)
        if not len(tracks):
            break
        falling.append(tracks.scores[0])
    assert (np.diff(falling) < 0).all()
    assert len(falling) > 12


def test_clutter_alone_confirms_nothing():
    rng = np.random.default_rng(5)
    tracker = JpdaTracker(traits="unknown")
    for k in range(100):
        places = rng.uniform(-50, 50, (rng.poisson(1.0), 2))
        states = tracker.update(seen(k, places), None).states
        assert (states == TrackState.TENTATIVE).all()


def test_surer_detections_are_believed_sooner():
    first = [
        JpdaTracker(traits="unknown").update(seen(0, [(5, 5)], s), None).scores[0]
        for s in (0.3, 0.9)
    ]
    assert first[0] < first[1]
    assert JpdaTracker(score_weight=0, traits="unknown", clutter_m2=1e-4).update(
        seen(0, [(5, 5)], 0.3), None
    ).scores[0] == pytest.approx(0.9e-5 / (0.9e-5 + 1e-4))


@pytest.mark.parametrize(
    ("kind", "score", "clutter_m2"),
    [(JpdaTracker, 0.5, 2e-3), (PmbmTracker, 0.5, 2e-3)],
)
def test_what_is_unlikely_alone_is_proved_by_coming_back(kind, score, clutter_m2):
    """Of low scores, or where clutter is dense, every first detection is most likely nothing."""
    tracker = kind(clutter_m2=clutter_m2, traits="unknown")
    told = [tracker.update(seen(k, [(20 + 0.5 * k, 0)], score), None) for k in range(20)]
    assert told[0].scores[0] < 0.02
    assert told[-1].ids[told[-1].states == TrackState.CONFIRMED].tolist() == [0]
    passing = kind(clutter_m2=clutter_m2, traits="unknown")
    passing.update(seen(0, [(20, 0)], score), None)
    assert len(passing.update(seen(1, [], score), None)) == 0


def test_one_of_two_detections_takes_not_all():
    """Between two detections alike the track goes to their mean, and is less sure of it."""
    tracker, sure = JpdaTracker(traits="unknown"), JpdaTracker(traits="unknown")
    for k in range(10):
        tracker.update(seen(k, [(0, 0)]), None)
        sure.update(seen(k, [(0, 0)]), None)
    shared = tracker.update(seen(10, [(0, 0.4), (0, -0.4)]), None)
    alone = sure.update(seen(10, [(0, 0)]), None)
    assert shared.centres[0, 1] == pytest.approx(0, abs=1e-9)
    assert shared.covariances[0, 1, 1] > alone.covariances[0, 1, 1] + 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"clutter_m2": 0.0}, "clutter_m2 must be positive"),
        ({"detection": 1.0}, "detection must lie between 0 and 1"),
        ({"confirm": 1.5}, "confirm must lie in 0 to 1"),
        ({"shown_misses": -1}, "shown_misses must be 0 or more"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        JpdaTracker(**arguments)
