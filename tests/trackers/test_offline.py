from dataclasses import replace

import numpy as np
import pytest
from tracked_scenes import T as DT
from tracked_scenes import boxes, identities, make

from roadscope.core import Category, Detections, Pose, Tracks, TrackState
from roadscope.trackers import (
    OfflineRules,
    TargetTrajectory,
    TrackNoise,
    offline_tracks,
    read_detector,
    smoothed_states,
    trajectories,
)

KITTI = "kitti-pointrcnn"


def drive(ticks=40, hidden=(), sigma=0.2, seed=0, score=0.999):
    """Tracks of one car at 8 m/s, tentative ones too."""
    rng = np.random.default_rng(seed)
    tracker, history = make("existence", traits="roadscope"), []
    for t in range(ticks):
        x, y = np.array([10 + 0.8 * t, 3.0]) + sigma * rng.standard_normal(2)
        detected = boxes([(x, y)], t, score) if t not in hidden else Detections.empty(DT * t)
        history.append(tracker.update(detected, Pose.identity()))
    return history


def errors(history):
    return np.array(
        [
            np.hypot(*(tracks.centres[0, :2] - (10 + 0.8 * t, 3.0)))
            for t, tracks in enumerate(history)
            if len(tracks)
        ]
    )


def test_smoothing_improves_positions():
    drives = [drive(seed=seed) for seed in range(6)]
    after, before = (
        np.mean([errors(tracks).mean() for tracks in each])
        for each in ([offline_tracks(online) for online in drives], drives)
    )
    assert after < 0.8 * before


def test_gaps_are_filled_as_coasting():
    after = offline_tracks(drive(hidden=range(15, 21)))
    states = [int(tracks.states[0]) for tracks in after]
    assert states == [
        TrackState.COASTING if t in range(15, 21) else TrackState.CONFIRMED for t in range(40)
    ]
    assert len({int(tracks.ids[0]) for tracks in after}) == 1
    assert errors(after)[15:21].max() < 1.0


def test_tracks_end_with_their_last_detection():
    after = offline_tracks(drive(hidden=range(30, 40)))
    assert [len(tracks) for tracks in after] == [1] * 30 + [0] * 10


def test_one_score_for_a_whole_track_and_weak_ones_dropped():
    after = offline_tracks(drive())
    assert len({float(tracks.scores[0]) for tracks in after}) == 1
    assert not any(len(tracks) for tracks in offline_tracks(drive(score=0.05)))


def test_tracks_begin_with_their_first_detection_even_if_tentative():
    history = drive(score=0.5)
    assert history[0].states[0] == TrackState.TENTATIVE
    after = offline_tracks(history, OfflineRules(least_score=0.1))
    assert [len(tracks) for tracks in after] == [1] * 40


def test_fragments_are_joined_and_crossing_the_gap_keeps_the_first_id():
    late = drive()
    fragments = [
        replace(tracks, ids=tracks.ids + (100 if t > 22 else 0))
        if t < 19 or t > 22
        else Tracks.empty(tracks.stamp_s, tracks.frame)
        for t, tracks in enumerate(late)
    ]
    after = offline_tracks(fragments)
    assert {int(tracks.ids[0]) for tracks in after} == {0}
    assert errors(after).max() < 0.6
    unjoined = offline_tracks(fragments, OfflineRules(longest_gap_s=0.2))
    assert {int(i) for tracks in unjoined for i in tracks.ids} == {0, 100}


def test_missed_ticks_are_recognised():
    history = drive(hidden=(9, 10))
    (whole,) = trajectories(history, [TrackNoise.uniform(len(t), 0.8) for t in history])
    assert np.flatnonzero(~whole.detected).tolist() == [9, 10]


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
    zeros, flags = np.zeros((n, 2, 2)), np.ones(n, bool)
    walks = np.tile(walk**2 * np.eye(2), (n, 1, 1))
    body = np.zeros(n), np.ones((n, 3)), np.zeros(n), np.ones(n)
    smooth, spread = smoothed_states(
        TargetTrajectory(
            0,
            Category.CAR,
            np.arange(n),
            DT * np.arange(n),
            np.array(means),
            np.array(covariances),
            walks,
            zeros,
            zeros,
            *body,
            flags,
        )
    )
    joint = np.linalg.inv(information)
    assert smooth.ravel() == pytest.approx(joint @ vector, abs=1e-9)
    assert spread[2] == pytest.approx(joint[8:12, 8:12], abs=1e-9)


def test_the_input_is_unchanged_and_may_be_empty():
    history = drive(10)
    before = [replace(tracks) for tracks in history]
    assert offline_tracks(history) == offline_tracks(history)
    assert history == before
    assert offline_tracks([]) == []
    assert [len(t) for t in offline_tracks([Tracks.empty(0.0), Tracks.empty(0.1)])] == [0, 0]


def test_frames_must_not_change():
    with pytest.raises(ValueError, match="one frame"):
        offline_tracks([Tracks.empty(0.0, "ego"), Tracks.empty(0.1, "world")])


def test_lasting_errors_are_not_smoothed_away():
    history = drive()
    plain = offline_tracks(history)
    lasting = [
        replace(alike, offsets=np.tile(0.01 * np.eye(2), (len(alike), 1, 1)))
        for alike in (TrackNoise.uniform(len(t), 0.8) for t in history)
    ]
    wider = [
        replace(t, covariances=t.covariances + 0.01 * np.diag([1.0, 1, 0, 0])) for t in history
    ]
    after = offline_tracks(wider, noises=lasting)
    for one, other in zip(plain, after, strict=True):
        assert one.centres == pytest.approx(other.centres, abs=1e-6)
        added = other.covariances - one.covariances
        assert added == pytest.approx(0.01 * np.diag([1.0, 1, 0, 0])[None], abs=1e-6)


def walk_of(kind, rng, ticks=60):
    """States (T, 4) x, y, vx, vy of one that moves as was learned of its class."""
    traits = read_detector(KITTI).traits
    walk = np.array([traits.accelerate_m_s2[kind], traits.swerve_m_s2[kind]])
    steps = np.sqrt(DT) * walk * rng.standard_normal((ticks, 2))
    velocities = np.array([traits.cruise_m_s[kind], 0.0]) + np.cumsum(steps, axis=0)
    places = np.array([8.0, 3.0]) + np.cumsum(DT * velocities, axis=0)
    return np.hstack([places, velocities])


def detection_errors(kind, rng, ranges_m):
    """Errors (T, 2) of places as was learned of the detector: part of them lasts."""
    traits, ticks = read_detector(KITTI).traits, len(ranges_m)
    share, correlation = traits.lasting[kind], np.exp(-DT / traits.lasting_s[kind])
    new, lasting = rng.standard_normal((2, ticks, 2))
    for k in range(1, ticks):
        lasting[k] = correlation * lasting[k - 1] + np.sqrt(1 - correlation**2) * lasting[k]
    sigma = np.array([traits.along_m[kind], traits.across_m[kind]])
    growth = 1 + traits.growth_per_m[kind] * ranges_m[:, None]
    return growth * sigma * (np.sqrt(share) * lasting + np.sqrt(1 - share) * new)


def tracked(kind, places):
    """A tracker and its tracks of one object at (T, 2) places, NaN without a detection."""
    tracker = make("existence-offline", traits=KITTI)
    rows = [place[None][np.isfinite(place[:1])] for place in places]
    episode = [boxes(row, t, 0.999, kind) for t, row in enumerate(rows)]
    return tracker, [tracker.update(d, Pose.identity()) for d in episode]


def state_errors(history, truth):
    """Errors (K, 4) of states, and their covariances."""
    pairs = [(tracks, state) for tracks, state in zip(history, truth, strict=True) if len(tracks)]
    errors_of_states = [np.append(t.centres[0, :2], t.velocities[0]) - state for t, state in pairs]
    return np.array(errors_of_states), np.array([tracks.covariances[0] for tracks, _ in pairs])


def test_pedestrians_are_smoothed_by_their_own_noise():
    """As far off as the covariances say; with one walk for all velocities are 0.13 m/s off."""
    rng, kind = np.random.default_rng(0), Category.PEDESTRIAN
    velocities, squares = [], []
    for _ in range(15):
        truth = walk_of(kind, rng)
        places = truth[:, :2] + detection_errors(kind, rng, np.hypot(*truth[:, :2].T))
        tracker, history = tracked(kind, places)
        errors_of_states, spread = state_errors(tracker.rescored(history), truth)
        velocities.append(errors_of_states[:, 2:])
        solved = np.linalg.solve(spread, errors_of_states[..., None])[..., 0]
        squares.append(np.einsum("ki,ki->k", errors_of_states, solved) / 4)
    assert np.sqrt((np.concatenate(velocities) ** 2).mean()) < 0.12
    assert 0.5 < np.concatenate(squares).mean() < 1.2


def test_fragments_are_not_joined_where_pedestrians_cannot_have_gone():
    """A car may have gone two metres aside in a second and a half: one walk for all joins them."""
    before = np.column_stack([8 + 0.12 * np.arange(20), np.full(20, 3.0)])
    gap = np.full((14, 2), np.nan)
    after = np.column_stack([8 + 0.12 * np.arange(34, 54), np.full(20, 5.0)])
    tracker, history = tracked(Category.PEDESTRIAN, np.concatenate([before, gap, after]))
    assert identities(tracker.rescored(history)) == {0, 1}
    assert identities(offline_tracks(history)) == {0}
