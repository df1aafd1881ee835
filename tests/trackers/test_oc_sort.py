import numpy as np
import pytest
from dense_costs import candidates
from tracked_scenes import T, boxes, identities, told

from roadscope.core import Detections, TrackState
from roadscope.trackers.gnn import GnnTracker
from roadscope.trackers.observations import Observations, units
from roadscope.trackers.oc_sort import OcSortTracker
from roadscope.trackers.place_filter import PlaceFilter


def braking(k):
    """A car at 10 m/s that, hidden from 1 s to 3 s, brakes at once and stands."""
    return (10 * min(k * T, 1.3), 0.0)


def test_recovers_where_it_was_last_seen_what_prediction_loses():
    episode = [boxes([] if 10 <= k < 30 else [braking(k)], k) for k in range(45)]
    with_recovery, without = OcSortTracker(), GnnTracker(coast_frames=30)
    assert len(identities(told(with_recovery, episode), TrackState.CONFIRMED)) == 1
    assert len(identities(told(without, episode), TrackState.CONFIRMED)) == 2


def bending(k):
    """Straight on for a second, then around a bend of 25 m."""
    angle = 0.4 * max(k * T - 1, 0)
    return (min(10 * k * T, 10) + 25 * np.sin(angle), 25 - 25 * np.cos(angle))


def test_a_stiff_filter_forgets_its_drift():
    """Hidden in a bend; what is believed two ticks after it came back, noise as detectors have."""
    errors = {OcSortTracker: [], GnnTracker: []}
    for seed in range(10):
        rng = np.random.default_rng(seed)
        seen = [k for k in range(27) if not 15 <= k < 26]
        places = {k: [bending(k) + 0.2 * rng.standard_normal(2)] for k in seen}
        for kind, found in errors.items():
            wide = {"least": -0.5} if kind is OcSortTracker else {"gate_share": 0.9999999}
            tracker = kind(coast_frames=20, velocity_walk=0.5, **wide)
            tracks = told(tracker, [boxes(places.get(k, []), k) for k in range(30)])[-1]
            assert tracks.ids.tolist() == [0]
            found.append(np.hypot(*(tracks.centres[0, :2] - bending(29))))
    assert np.median(errors[OcSortTracker]) < 0.5 * np.median(errors[GnnTracker])


def test_re_update_equals_a_filter_along_the_line():
    """Two tracks, unseen for two ticks and for none, with uneven ticks."""
    stamps, seen = [0.0, 0.1, 0.25, 0.3], np.array([0.0, 0.25])
    places, found = np.array([[0.0, 0.0], [50.0, 1.0]]), np.array([[3.0, 0.6], [50.4, 1.1]])
    detections = boxes(places, 0)
    kalman = PlaceFilter()
    beliefs = kalman.started(detections)
    observed = Observations.opened(detections, beliefs, 3)
    observed.stamps[:] = seen
    tracker = OcSortTracker(velocity_walk=1.0)
    tracker._stamps = stamps
    again = tracker._updated_again(observed, found)
    for k in range(2):
        row, last = np.array([k]), seen[k]
        one = beliefs.select(row)
        for t in [t for t in stamps if t > last]:
            share = (t - seen[k]) / (0.3 - seen[k])
            virtual = (1 - share) * places[row] + share * found[row]
            one = kalman.corrected(kalman.predicted(one, t - last), virtual)
            last = t
        np.testing.assert_allclose(again.means[k], one.means[0], atol=1e-12)
        np.testing.assert_allclose(again.covariances[k], one.covariances[0], atol=1e-12)


def test_momentum_prefers_what_lies_ahead():
    tracker = OcSortTracker()
    first = boxes([(0, 0)], 0)
    beliefs = PlaceFilter().started(first)
    observed = Observations.opened(first, beliefs, 3).moved_on()
    observed = observed.seen(np.array([0]), boxes([(1, 0)], 1), beliefs, 0.5).moved_on()
    targets = boxes([(3, 0), (0, 3), (-3, 0), (0.1, 0)], 2, scores=0.8)
    agreement = tracker._consistency(candidates(np.zeros((1, 4))), observed, targets)
    assert agreement.tolist() == pytest.approx([0.4, 0, -0.4, 0])


def test_memory_reaches_back_a_few_ticks_and_then_to_the_last():
    first = boxes([(0, 0)], 0)
    beliefs = PlaceFilter().started(first)
    observed = Observations.opened(first, beliefs, 2)
    anchors = [observed.anchors[0, 0]]
    for k in range(1, 4):
        observed = observed.moved_on()
        if k < 2:
            observed = observed.seen(np.array([0]), boxes([(k, 0)], k), beliefs, 0.5)
        anchors.append(observed.anchors[0, 0])
    assert anchors == [0, 0, 0, 1]
    assert observed.moved_on().anchors.tolist() == [[1, 0]]
    assert observed.directions.tolist() == [[1, 0]]


def test_short_vectors_have_no_direction():
    found = units(np.array([[3.0, 4.0], [0.3, 0.0], [0.0, 0.0]]), 0.5)
    assert found.tolist() == [[0.6, 0.8], [0, 0], [0, 0]]
    assert units(np.zeros((1, 2)), 0.0).tolist() == [[0, 0]]


def test_ignores_detections_of_low_score():
    tracks = told(OcSortTracker(), [boxes([(5, 0)], k, scores=0.2) for k in range(5)])
    assert not any(len(each) for each in tracks)


def test_memory_of_stamps_does_not_grow():
    tracker = OcSortTracker(coast_frames=5)
    told(tracker, [boxes([(5, 0)] if k % 3 else [], k) for k in range(50)])
    assert len(tracker._stamps) < 10
    tracker.update(Detections.empty(100.0), None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"overlap": "dice"}, "no overlap 'dice'; possible: iou, giou"),
        ({"least": -2.0}, "the least giou must lie in -1 to 1, got -2.0"),
        ({"momentum": -1.0}, "momentum must be 0 or more, got -1.0"),
        ({"momentum_ticks": 0}, "momentum_ticks must be 1 or more, got 0"),
        ({"least_score": 1.5}, "least_score must lie in 0 to 1, got 1.5"),
        ({"coast_frames": -1}, "coast_frames must be 0 or more, got -1"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        OcSortTracker(**arguments)
