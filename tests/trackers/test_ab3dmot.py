import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from tracked_scenes import T, boxes, identities, make, run

from roadscope.core import TrackState


def papers_filter(box):
    """The filter as the paper prints it, per frame: x y z yaw l w h and the change of x y z."""
    kalman = KalmanFilter(dim_x=10, dim_z=7)
    kalman.F = np.eye(10) + np.eye(10, k=7)
    kalman.H = np.eye(7, 10)
    kalman.P *= 10.0
    kalman.P[7:, 7:] *= 1000.0
    kalman.Q[7:, 7:] *= 0.01
    kalman.x[:7, 0] = box
    return kalman


def test_the_filter_is_the_papers():
    rng = np.random.default_rng(0)
    tracker, kalman = make("ab3dmot"), None
    for k in range(12):
        place = (k + 0.1 * rng.standard_normal(), 3 + 0.1 * rng.standard_normal())
        detection = boxes([place], k, yaws=0.1 * rng.standard_normal())
        tracks = tracker.update(detection, None)
        row = np.concatenate([detection.centres[0], detection.yaws, detection.sizes[0]])
        if kalman is None:
            kalman = papers_filter(row)
        else:
            kalman.predict()
            kalman.update(row)
        np.testing.assert_allclose(tracks.centres[0], kalman.x[:3, 0], atol=1e-9)
        np.testing.assert_allclose(tracks.yaws[0], kalman.x[3, 0], atol=1e-9)
        np.testing.assert_allclose(tracks.sizes[0], kalman.x[4:7, 0], atol=1e-9)
        np.testing.assert_allclose(tracks.velocities[0], kalman.x[7:9, 0] / T, atol=1e-8)
        plane, scale = np.ix_([0, 1, 7, 8], [0, 1, 7, 8]), np.array([1, 1, T, T])
        np.testing.assert_allclose(
            tracks.covariances[0] * np.outer(scale, scale), kalman.P[plane], atol=1e-8
        )


def test_a_detection_half_a_turn_off_does_not_turn_the_track():
    """A detector that takes the front for the rear does not turn the track through the side."""
    tracker = make("ab3dmot")
    for k, yaw in enumerate([0.1, 0.1, 0.1 + np.pi, 0.1]):
        tracks = tracker.update(boxes([(5, 0)], k, yaws=yaw), None)
        assert abs(np.sin(tracks.yaws[0] - 0.1)) < 1e-9


def test_confirmed_after_three_detections_dropped_after_two_misses():
    episode = [boxes([(5, 0)] if k in (0, 1, 2, 4) else [], k) for k in range(8)]
    states = [each.states.tolist() for each in run(make("ab3dmot"), episode)]
    tentative, confirmed, coasting = list(TrackState)
    assert states == [
        [tentative],
        [tentative],
        [confirmed],
        [coasting],
        [confirmed],
        [coasting],
        [],
        [],
    ]


def test_generalised_overlap_tracks_cars_that_move_more_than_their_length():
    """At 50 m/s a car covers more than its length in a tenth of a second."""
    episode = [boxes([(5.0 * k, 0)], k) for k in range(6)]
    assert len(identities(run(make("ab3dmot"), episode))) == 6
    assert len(identities(run(make("ab3dmot", overlap="giou", least=-0.2), episode))) == 1


def test_a_late_tick_is_predicted_by_its_time():
    episode = [boxes([(10 * k * T, 0)], k) for k in (0, 1, 2, 3, 4, 7, 8)]
    tracks = run(make("ab3dmot"), episode)
    assert identities(tracks) == {0}
    assert tracks[-1].velocities[0] == pytest.approx((10, 0), abs=0.5)
