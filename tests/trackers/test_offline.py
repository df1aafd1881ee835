from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Detections, Pose, Tracks, TrackState
from roadscope.trackers.existence import ExistenceTracker
from roadscope.trackers.offline import Rescoring, rescored
from roadscope.trackers.offline_noise import MotionNoise
from roadscope.trackers.offline_smoothing import backward
from roadscope.trackers.offline_trajectories import trajectories

DT = 0.1


def box(x, y, t, score=0.95):
    return Detections(
        np.array([[x, y, 0.8]]), np.array([[4.5, 1.8, 1.5]]), np.zeros(1), np.zeros(1, int),
        np.array([score]), "ego", DT * t,
    )  # fmt: skip


def drive(ticks=40, hidden=(), sigma=0.2, seed=0, score=0.999):
    """One car at 8 m/s, and what a tracker said of it, tentative tracks too."""
    rng = np.random.default_rng(seed)
    tracker, history = ExistenceTracker(traits="roadscope"), []
    for t in range(ticks):
        x, y = np.array([10 + 0.8 * t, 3.0]) + sigma * rng.standard_normal(2)
        seen = box(x, y, t, score) if t not in hidden else Detections.empty(DT * t)
        history.append(tracker.update(seen, Pose.identity()))
    return history


def errors(history):
    return np.array(
        [
            np.hypot(*(tracks.centres[0, :2] - (10 + 0.8 * t, 3.0)))
            for t, tracks in enumerate(history)
            if len(tracks)
        ]
    )


def test_knowing_the_future_places_better():
    drives = [drive(seed=seed) for seed in range(6)]
    after, before = (
        np.mean([errors(told).mean() for told in each])
        for each in ([rescored(online) for online in drives], drives)
    )
    assert after < 0.8 * before


def test_gaps_are_filled_and_called_coasting():
    told = rescored(drive(hidden=range(15, 21)))
    states = [int(tracks.states[0]) for tracks in told]
    assert states == [
        TrackState.COASTING if t in range(15, 21) else TrackState.CONFIRMED for t in range(40)
    ]
    assert len({int(tracks.ids[0]) for tracks in told}) == 1
    assert errors(told)[15:21].max() < 1.0


def test_nothing_is_told_after_the_last_detection():
    told = rescored(drive(hidden=range(30, 40)))
    assert [len(tracks) for tracks in told] == [1] * 30 + [0] * 10


def test_one_score_for_a_whole_track_and_weak_ones_dropped():
    told = rescored(drive())
    assert len({float(tracks.scores[0]) for tracks in told}) == 1
    assert not any(len(tracks) for tracks in rescored(drive(score=0.05)))


def test_the_beginning_is_told_although_it_was_tentative():
    history = drive(score=0.5)
    assert history[0].states[0] == TrackState.TENTATIVE
    told = rescored(history, Rescoring(least_score=0.1))
    assert [len(tracks) for tracks in told] == [1] * 40


def test_fragments_are_joined_and_crossing_the_gap_keeps_the_first_id():
    late = drive()
    fragments = [
        replace(tracks, ids=tracks.ids + (100 if t > 22 else 0)) if t < 19 or t > 22 else
        Tracks.empty(tracks.stamp_s, tracks.frame)
        for t, tracks in enumerate(late)
    ]  # fmt: skip
    told = rescored(fragments)
    assert {int(tracks.ids[0]) for tracks in told} == {0}
    assert errors(told).max() < 0.6
    apart = rescored(fragments, Rescoring(longest_gap_s=0.2))
    assert {int(i) for tracks in apart for i in tracks.ids} == {0, 100}


def test_unseen_ticks_are_recognised():
    history = drive(hidden=(9, 10))
    (whole,) = trajectories(history, [MotionNoise.alike(len(t), 0.8) for t in history])
    assert np.flatnonzero(~whole.seen).tolist() == [9, 10]


def test_smoothing_is_least_squares_of_all_states():
    """Against the joint Gaussian of all states given all measurements, solved at once."""
    rng = np.random.default_rng(1)
    n, r, walk = 6, 0.3, 1.2
    F = np.eye(4) + DT * np.eye(4, k=2)
    q = np.kron([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]], np.eye(2)) * walk**2
    H, measured = np.eye(2, 4), rng.standard_normal((n, 2))
    x, P = np.zeros(4), np.diag([1.0, 1.0, 4.0, 4.0])
    information, vector = np.zeros((4 * n, 4 * n)), np.zeros(4 * n)
    information[:4, :4] = np.linalg.inv(P)
    means, covariances = [], []
    for k in range(n):
        if k:
            x, P = F @ x, F @ P @ F.T + q
            step = np.zeros((4, 4 * n))
            step[:, 4 * k - 4 : 4 * k], step[:, 4 * k : 4 * k + 4] = -F, np.eye(4)
            information += step.T @ np.linalg.inv(q) @ step
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + r**2 * np.eye(2))
        x, P = x + K @ (measured[k] - H @ x), (np.eye(4) - K @ H) @ P
        information[4 * k : 4 * k + 2, 4 * k : 4 * k + 2] += np.eye(2) / r**2
        vector[4 * k : 4 * k + 2] += measured[k] / r**2
        means.append(x)
        covariances.append(P)
    smooth, spread = backward(
        DT * np.arange(n), np.array(means), np.array(covariances),
        np.tile(walk**2 * np.eye(2), (n, 1, 1)), np.zeros((n, 2, 2)),
    )  # fmt: skip
    joint = np.linalg.inv(information)
    assert smooth.ravel() == pytest.approx(joint @ vector, abs=1e-9)
    assert spread[2] == pytest.approx(joint[8:12, 8:12], abs=1e-9)


def test_pure_and_empty():
    history = drive(10)
    before = [replace(tracks) for tracks in history]
    assert rescored(history) == rescored(history)
    assert history == before
    assert rescored([]) == []
    assert [len(t) for t in rescored([Tracks.empty(0.0), Tracks.empty(0.1)])] == [0, 0]


def test_frames_must_not_change():
    with pytest.raises(ValueError, match="one frame"):
        rescored([Tracks.empty(0.0, "ego"), Tracks.empty(0.1, "world")])


def test_what_lasts_is_not_smoothed_away():
    history = drive()
    plain = rescored(history)
    lasting = [
        replace(alike, offsets=np.tile(0.01 * np.eye(2), (len(alike), 1, 1)))
        for alike in (MotionNoise.alike(len(t), 0.8) for t in history)
    ]
    wider = [
        replace(t, covariances=t.covariances + 0.01 * np.diag([1.0, 1, 0, 0])) for t in history
    ]
    told = rescored(wider, noises=lasting)
    for one, other in zip(plain, told, strict=True):
        assert one.centres == pytest.approx(other.centres, abs=1e-6)
        added = other.covariances - one.covariances
        assert added == pytest.approx(0.01 * np.diag([1.0, 1, 0, 0])[None], abs=1e-6)
