import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from toy_boxes import detections
from tracked_scenes import make

from roadscope.core import Pose, TrackState
from roadscope.trackers import ConstantVelocityFilter, FilterNoise, process_noise

T = 0.08


def detections_at(tick, *places, frame="ego"):
    return detections(places, sizes=[4.6, 1.85, 1.5], frame=frame, stamp_s=tick * T)


def test_an_identity_survives_13_misses():
    tracker = make("nearest", coast_frames=13)
    for k in range(20):
        before = tracker.update(detections_at(k, (20 + 0.1 * k, 3)), None)
    for k in range(20, 33):
        between = tracker.update(detections_at(k), None)
        assert between.states.tolist() == [TrackState.COASTING]
    assert between.centres[0, 0] == pytest.approx(20 + 0.1 * 32, abs=0.01)
    after = tracker.update(detections_at(33, (20 + 0.1 * 33, 3)), None)
    assert after.ids.tolist() == before.ids.tolist()
    assert after.states.tolist() == [TrackState.CONFIRMED]


def test_a_filter_is_dropped_after_13_misses_and_its_id_is_gone():
    tracker = make("nearest", coast_frames=13)
    first = tracker.update(detections_at(0, (20, 3)), None)
    counts = [len(tracker.update(detections_at(k), None)) for k in range(1, 16)]
    assert counts == [1] * 13 + [0, 0]
    again = tracker.update(detections_at(16, (20, 3)), None)
    assert again.ids[0] != first.ids[0]


def test_a_track_is_tentative_until_it_has_enough_detections():
    tracker = make("nearest", confirm_hits=3)
    states = [
        tracker.update(detections_at(k, *places), None).states[0]
        for k, places in enumerate([[(20, 3)], [(20, 3)], [], [(20, 3)], []])
    ]
    assert states == [0, 0, 0, TrackState.CONFIRMED, TrackState.COASTING]


def test_a_far_target_starts_a_filter():
    tracker = make("nearest", gate_m=2.0)
    tracker.update(detections_at(0, (20, 0)), None)
    tracks = tracker.update(detections_at(1, (20, 1.9), (30, 0)), None)
    assert tracks.ids.tolist() == [0, 1]
    tracks = tracker.update(detections_at(2, (20, 5)), None)
    assert len(tracks) == 3


def test_constant_velocity_and_its_frame():
    tracker = make("nearest")
    for k in range(30):
        tracks = tracker.update(detections_at(k, (20 + 0.4 * k, 3 - 0.08 * k)), None)
    assert tracks.frame == "ego"
    assert tracks.velocities[0] == pytest.approx((5.0, -1.0), abs=0.01)


def turning(k):
    """The ego's pose on a circle of 30 m at 10 m/s."""
    angle = 10 / 30 * k * T
    return Pose.planar(30 * np.sin(angle), 30 - 30 * np.cos(angle), angle)


def test_a_standing_target_stands_while_the_ego_turns():
    standing = np.array([40.0, 5.0, 0.0])
    world, ego = make("nearest"), make("nearest", frame="ego")
    for k in range(40):
        x, y, _ = turning(k).inverse().apply(standing)
        reported_tracks = world.update(detections_at(k, (x, y)), turning(k))
        lost = ego.update(detections_at(k, (x, y)), turning(k))
    assert reported_tracks.frame == "world"
    assert reported_tracks.ids.tolist() == [0]
    assert reported_tracks.centres[0, :2] == pytest.approx((40, 5), abs=0.05)
    assert reported_tracks.velocities[0] == pytest.approx((0, 0), abs=0.3)
    assert lost.frame == "ego"
    assert np.hypot(*(lost.centres[0, :2] - (x, y))) > 0.3


def test_first_velocity_is_the_egos():
    """At 40 m/s a target moves 3.2 m a tick in the world, more than the gate."""
    tracker = make("nearest", gate_m=2.0)
    for k in range(5):
        places = [(20.0, 3.0)] if k < 2 else [(20.0, 3.0), (40.0, -3.0)]
        tracks = tracker.update(detections_at(k, *places), Pose.planar(3.2 * k, 0, 0))
    assert tracks.ids.tolist() == [0, 1]
    assert np.allclose(tracks.velocities, [[40, 0], [40, 0]], atol=0.5)


def test_detections_in_the_world_frame_are_taken_as_they_are():
    tracks = make("nearest").update(detections_at(0, (20, 3), frame="world"), Pose.planar(5, 5, 1))
    assert tracks.centres[0, :2].tolist() == [20, 3]
    assert tracks.frame == "world"


def test_the_filter_is_the_printed_recursion():
    """Eq. 8 to 16 as they are printed, with Q at 0."""
    rng = np.random.default_rng(0)
    places = rng.normal(size=(30, 2)) + np.arange(30)[:, None]
    kalman = ConstantVelocityFilter(FilterNoise(0.5, 0.2, 0.0), places[0], np.zeros(2), T)
    A = np.array([[1, T, 0, 0], [0, 1, 0, 0], [0, 0, 1, T], [0, 0, 0, 1]])
    H = np.array([[1, 0, 0, 0], [0, 0, 1, 0]])
    a, b, c = 0.25, 0.25 / T, 0.5 / T**2
    P = np.array([[a, b, 0, 0], [b, c, 0, 0], [0, 0, a, b], [0, 0, b, c]])
    x, R = np.array([places[0, 0], 0, places[0, 1], 0]), 0.04 * np.eye(2)
    for z in places[1:]:
        kalman.predict(T)
        kalman.update(z)
        x, P = A @ x, A @ P @ A.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (z - H @ x), (np.eye(4) - K @ H) @ P
    assert np.allclose(kalman.position, x[[0, 2]])
    assert np.allclose(kalman.velocity, x[[1, 3]])
    assert np.allclose(kalman.covariance, P[np.ix_([0, 2, 1, 3], [0, 2, 1, 3])], atol=1e-9)


def test_the_filter_is_filterpys_to_the_bit():
    rng = np.random.default_rng(0)
    places = rng.normal(size=(30, 2)) + np.arange(30)[:, None]
    ours = ConstantVelocityFilter(FilterNoise(0.5, 0.2, 2.0), places[0], np.ones(2), T)
    theirs = KalmanFilter(dim_x=4, dim_z=2)
    theirs.x, theirs.H = np.array([places[0, 0], 1, places[0, 1], 1]), np.eye(4)[[0, 2]]
    theirs.P = np.kron(np.eye(2), [[1.0, 1 / T], [1 / T, 2 / T**2]]) * 0.5**2
    theirs.F, theirs.Q = np.kron(np.eye(2), [[1, T], [0, 1]]), process_noise(2.0, T)
    theirs.R = 0.2**2 * np.eye(2)
    for z in places[1:]:
        ours.predict(T)
        theirs.predict()
        ours.update(z)
        theirs.update(z)
        assert (ours.position == theirs.x[[0, 2]]).all()
        assert (ours.velocity == theirs.x[[1, 3]]).all()
        assert (ours.covariance == theirs.P[np.ix_([0, 2, 1, 3], [0, 2, 1, 3])]).all()


def test_without_process_noise_the_gain_goes_to_zero():
    still, alive = (
        ConstantVelocityFilter(FilterNoise(0.5, 0.2, a), np.zeros(2), np.zeros(2), T)
        for a in (0.0, 2.0)
    )
    for kalman in (still, alive):
        for _ in range(200):
            kalman.predict(T)
            kalman.update(np.zeros(2))
        kalman.update(np.array([1.0, 0.0]))
    assert still.position[0] < 0.05
    assert alive.position[0] > 0.15


def test_process_noise_is_that_of_a_constant_acceleration_between_frames():
    rng = np.random.default_rng(0)
    a = 2.0 * rng.standard_normal(200_000)
    drawn = np.cov(np.stack([a * T**2 / 2, a * T]))
    assert np.allclose(process_noise(2.0, T)[:2, :2], drawn, rtol=0.02)
