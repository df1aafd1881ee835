import numpy as np
import pytest
from dense_costs import candidates
from tracked_scenes import T, boxes, identities, make, run

from roadscope.core import Detections, TrackState
from roadscope.trackers import Observations, PositionFilter, unit_vectors


def braking(k):
    """A car at 10 m/s that, hidden from 1 s to 3 s, brakes at once and stands."""
    return (10 * min(k * T, 1.3), 0.0)


def test_recovery_at_the_last_detection_continues_what_prediction_loses():
    episode = [boxes([] if 10 <= k < 30 else [braking(k)], k) for k in range(45)]
    with_recovery, without = make("oc-sort"), make("gnn", coast_frames=30)
    assert len(identities(run(with_recovery, episode), TrackState.CONFIRMED)) == 1
    assert len(identities(run(without, episode), TrackState.CONFIRMED)) == 2


def bending(k):
    """Straight on for a second, then around a bend of 25 m."""
    angle = 0.4 * max(k * T - 1, 0)
    return (min(10 * k * T, 10) + 25 * np.sin(angle), 25 - 25 * np.cos(angle))


def test_re_update_removes_the_drift_of_a_stiff_filter():
    """Hidden in a bend; what is believed two ticks after it came back, noise as detectors have."""
    errors = {"oc-sort": [], "gnn": []}
    for seed in range(10):
        rng = np.random.default_rng(seed)
        ticks = [k for k in range(27) if not 15 <= k < 26]
        places = {k: [bending(k) + 0.2 * rng.standard_normal(2)] for k in ticks}
        for kind, errors_of_kind in errors.items():
            wide = {"least": -0.5} if kind == "oc-sort" else {"gate_share": 0.9999999}
            tracker = make(kind, coast_frames=20, velocity_walk=0.5, **wide)
            tracks = run(tracker, [boxes(places.get(k, []), k) for k in range(30)])[-1]
            assert tracks.ids.tolist() == [0]
            errors_of_kind.append(np.hypot(*(tracks.centres[0, :2] - bending(29))))
    assert np.median(errors["oc-sort"]) < 0.5 * np.median(errors["gnn"])


def test_re_update_is_a_filter_along_the_line():
    """Two tracks, missed for two ticks and for none, with uneven ticks."""
    stamps, last_s = [0.0, 0.1, 0.25, 0.3], np.array([0.0, 0.25])
    places, detected = np.array([[0.0, 0.0], [50.0, 1.0]]), np.array([[3.0, 0.6], [50.4, 1.1]])
    detections = boxes(places, 0)
    kalman = PositionFilter()
    beliefs = kalman.started(detections)
    observed = Observations.started(detections, beliefs, 3)
    observed.stamps[:] = last_s
    tracker = make("oc-sort", velocity_walk=1.0)
    tracker._stamps = stamps
    again = tracker._re_updated(observed, detected)
    for k in range(2):
        row, last = np.array([k]), last_s[k]
        one = beliefs.select(row)
        for t in [t for t in stamps if t > last]:
            share = (t - last_s[k]) / (0.3 - last_s[k])
            virtual = (1 - share) * places[row] + share * detected[row]
            one = kalman.corrected(kalman.predicted(one, t - last), virtual)
            last = t
        np.testing.assert_allclose(again.means[k], one.means[0], atol=1e-12)
        np.testing.assert_allclose(again.covariances[k], one.covariances[0], atol=1e-12)


def test_momentum_prefers_detections_ahead():
    tracker = make("oc-sort")
    first = boxes([(0, 0)], 0)
    beliefs = PositionFilter().started(first)
    observed = Observations.started(first, beliefs, 3).next_tick()
    observed = observed.updated(np.array([0]), boxes([(1, 0)], 1), beliefs, 0.5).next_tick()
    targets = boxes([(3, 0), (0, 3), (-3, 0), (0.1, 0)], 2, scores=0.8)
    agreement = tracker._agreement(candidates(np.zeros((1, 4))), observed, targets)
    assert agreement.tolist() == pytest.approx([0.4, 0, -0.4, 0])


def test_anchors_are_a_few_ticks_old_or_the_last_detection():
    first = boxes([(0, 0)], 0)
    beliefs = PositionFilter().started(first)
    observed = Observations.started(first, beliefs, 2)
    anchors = [observed.anchors[0, 0]]
    for k in range(1, 4):
        observed = observed.next_tick()
        if k < 2:
            observed = observed.updated(np.array([0]), boxes([(k, 0)], k), beliefs, 0.5)
        anchors.append(observed.anchors[0, 0])
    assert anchors == [0, 0, 0, 1]
    assert observed.next_tick().anchors.tolist() == [[1, 0]]
    assert observed.directions.tolist() == [[1, 0]]


def test_short_vectors_have_no_direction():
    directions = unit_vectors(np.array([[3.0, 4.0], [0.3, 0.0], [0.0, 0.0]]), 0.5)
    assert directions.tolist() == [[0.6, 0.8], [0, 0], [0, 0]]
    assert unit_vectors(np.zeros((1, 2)), 0.0).tolist() == [[0, 0]]


def test_ignores_detections_of_low_score():
    tracks = run(make("oc-sort"), [boxes([(5, 0)], k, scores=0.2) for k in range(5)])
    assert not any(len(each) for each in tracks)


def test_old_stamps_are_forgotten():
    tracker = make("oc-sort", coast_frames=5)
    run(tracker, [boxes([(5, 0)] if k % 3 else [], k) for k in range(50)])
    assert len(tracker._stamps) < 10
    tracker.update(Detections.empty(100.0), None)
