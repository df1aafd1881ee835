from dataclasses import replace

import numpy as np
import pytest
from slow_kalman import innovations, predicted, updated
from tracked_scenes import T as DT
from tracked_scenes import boxes, identities, make, run

from roadscope.core import Category, Pose, TrackState
from roadscope.trackers import (
    FAMILIES,
    FOLDER,
    BoxEstimates,
    DetectedBoxes,
    Gaussians,
    Measurements,
    Neighbours,
    corrected_boxes,
    corrected_states,
    expected_velocities,
    hidden_shares,
    log_odds_of_both,
    oriented_covariances,
    predicted_states,
    read_detector,
)

UNKNOWN = read_detector("unknown").traits
CAR = FAMILIES[Category.CAR]


def existence(traits="roadscope"):
    return make("existence", traits=traits)


def covariances(n, seed):
    rng = np.random.default_rng(seed)
    return oriented_covariances(
        rng.uniform(-3, 3, n), rng.uniform(0.5, 2, n), rng.uniform(0.1, 0.4, n)
    )


def test_states_are_those_of_a_kalman_filter():
    rng, walks, drifts, errors = np.random.default_rng(0), *(covariances(7, k) for k in range(3))
    roots = rng.standard_normal((7, 4, 4))
    before = Gaussians(
        rng.standard_normal((7, 4)), roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(4)
    )
    F = np.eye(4) + DT * np.eye(4, k=2)
    Q = np.block([[walks * DT**3 / 3, walks * DT**2 / 2], [walks * DT**2 / 2, walks * DT]])
    Q[:, :2, :2] += drifts * DT
    slow = predicted(before, F, Q)
    means, spread = predicted_states(before.means, before.covariances, walks, drifts, DT)
    assert means == pytest.approx(slow.means)
    assert spread == pytest.approx(slow.covariances)
    H, measured = np.eye(2, 4), rng.standard_normal((7, 2))
    innovation = innovations(slow, measured, H, errors)
    after = updated(slow, innovation, H, errors)
    means, spread, distances = corrected_states(means, spread, measured, errors)
    assert means == pytest.approx(after.means)
    assert spread == pytest.approx(after.covariances)
    assert distances == pytest.approx(innovation.distances)


def one_box(height, yaw, front=1.0, size=(4.0, 2.0, 1.5), size_weight=1.0):
    """A box with the variances 0.3 of height and 0.2 of heading."""
    return BoxEstimates(
        np.array([[height, 0.3]]),
        np.array([[yaw, 0.2]]),
        np.array([front]),
        np.array([size]),
        np.array([size_weight]),
    )


def after_detection(before, z, yaw, *, size=(4.0, 2.0, 1.5), score=0.5, weight=0.5):
    row = np.array([[0.0, 0.0, z, *size, yaw]])
    detected = DetectedBoxes(row, *(np.array([v]) for v in (score, weight, 0.1, 0.1)))
    return corrected_boxes(before, detected, 1.0, 0.9)


def test_heights_and_headings_are_filtered():
    after = after_detection(one_box(1.0, 3.1), 2.0, -3.1)
    assert after.heights[0] == pytest.approx([1.75, 0.3 * 0.25])
    residual = 2 * np.pi - 6.2
    yaw = 3.1 + 2 / 3 * residual
    assert after.yaws[0] == pytest.approx([np.angle(np.exp(1j * yaw)), 0.2 / 3])


def test_fronts_are_voted_for():
    opposed = after_detection(one_box(1.0, 0.1), 1.0, 0.1 - np.pi)
    assert opposed.yaws[0, 0] == pytest.approx(0.1), "outvoted"
    assert opposed.fronts[0] == pytest.approx(0.9 - 0.5)
    turned = after_detection(one_box(1.0, 0.1, front=0.2), 1.0, 0.1 - np.pi)
    assert turned.yaws[0, 0] == pytest.approx(0.1 - np.pi)
    assert turned.fronts[0] == pytest.approx(0.5 - 0.18)


def test_sizes_are_averaged_over_a_limited_memory():
    after = after_detection(one_box(1.0, 0.0, size_weight=5.0), 1.0, 0.0, size=(7.0, 2.0, 1.5))
    assert after.size_weights[0] == pytest.approx(1.5)
    assert after.sizes[0] == pytest.approx([5, 2, 1.5])


def test_covariances_lie_along_the_heading():
    (covariance,) = oriented_covariances(np.array([np.pi / 2]), np.array([2.0]), np.array([0.5]))
    assert covariance == pytest.approx(np.diag([0.25, 4.0]))


def test_only_nearer_ones_hide():
    rows = np.array([[10, 0, 1, 2, 4, 2, 0.0], [20, 0, 1, 2, 4, 2, 0], [20, 30, 1, 2, 4, 2, 0]])
    every, eye = np.ones(3, bool), np.zeros(2)
    assert hidden_shares(rows, every, every, eye).tolist() == [0, 1, 0]
    assert hidden_shares(rows, ~every, every, eye).tolist() == [0, 0, 0]
    assert hidden_shares(rows, every, ~every, eye).tolist() == [0, 0, 0]
    rows[1, 1] = 4.0
    assert 0.2 < hidden_shares(rows, every, every, eye)[1] < 0.8
    behind = np.array([[-10, 0.1, 1, 2, 4, 2, 0.0], [-20, -0.1, 1, 2, 2, 2, 0]])
    assert hidden_shares(behind, every[:2], every[:2], eye).tolist() == [0, 1], "beyond the seam"


def test_odds_of_both_are_those_of_the_product():
    a, b = np.meshgrid(np.linspace(-8, 8, 9), np.linspace(-8, 8, 9))
    p = 1 / (1 + np.exp(-a)) / (1 + np.exp(-b))
    assert log_odds_of_both(a, b) == pytest.approx(np.log(p / (1 - p)), abs=1e-6)


def expected_velocity(neighbours=(), yaw=0.0, family=CAR, traits=UNKNOWN):
    """Of a new car at the origin; neighbours: x, y, vx, vy."""
    table = np.array(neighbours, float).reshape(-1, 4)
    known = Neighbours(table[:, :2], table[:, 2:], np.full(len(table), family))
    new = Measurements.of(boxes([(0, 0)], 0, yaws=yaw), np.zeros(2), traits)
    velocity = expected_velocities(new, known, traits)
    return velocity.means[0], velocity.covariances[0]


def test_alone_a_new_target_moves_as_usual():
    mean, covariance = expected_velocity(yaw=np.pi / 2)
    forward = (2 * UNKNOWN.front[0] - 1) * UNKNOWN.cruise_m_s[0]
    assert mean == pytest.approx([0, forward])
    assert covariance[1, 1] + forward**2 == pytest.approx(UNKNOWN.speed_m_s[0] ** 2)
    assert covariance[0, 0] < 0.1 * covariance[1, 1]
    no_front, _ = expected_velocity(traits=replace(UNKNOWN, front=np.full(7, 0.5)))
    assert no_front == pytest.approx([0, 0])


def test_neighbours_suggest_speed_and_direction():
    mean, covariance = expected_velocity([(-20, 0, 25, 0), (15, 1, 26, 0), (30, 0, 25, 0)])
    assert mean[0] == pytest.approx(24, abs=2)
    assert covariance[0, 0] < expected_velocity()[1][0, 0]
    back, _ = expected_velocity([(-20, 0, -25, 0), (15, 1, -26, 0), (30, 0, -25, 0)])
    assert back[0] < -5


def test_far_and_crossing_neighbours_and_pedestrians_suggest_nothing():
    alone = expected_velocity()[0]
    for far in [(500, 0, 25, 0), (0, 40, 25, 0), (10, 0, 0, 25)]:
        assert expected_velocity([far])[0] == pytest.approx(alone, abs=0.1)
    walking = expected_velocity([(1, 0, 1.5, 0)], family=FAMILIES[Category.PEDESTRIAN])
    assert walking[0] == pytest.approx(alone)


def test_a_car_that_follows_others_has_their_speed_at_once():
    tracker = existence("unknown")
    for t in range(20):
        tracker.update(boxes([[10 + 2 * t + 12 * k, 0] for k in range(3)], t, 0.95), None)
    late = [*[[50 + 12 * k, 0] for k in range(3)], [38, 0]]
    tracks = tracker.update(boxes(late, 20, 0.95), None)
    assert tracks.velocities[-1] == pytest.approx([20, 0], abs=4)


def test_high_scores_are_confirmed_at_once_low_ones_later_clutter_never():
    sure = existence().update(boxes([(10, 0)], 0, 0.95), None)
    assert sure.states.tolist() == [TrackState.CONFIRMED]
    unsure = run(existence(), [boxes([(10, 0)], t, 0.55) for t in range(6)])
    assert unsure[0].states[0] == TrackState.TENTATIVE
    assert unsure[-1].states[0] == TrackState.CONFIRMED
    clutter = run(existence(), [boxes([(10, 0)], t, 0.1) for t in range(40)])
    assert {int(s) for tracks in clutter for s in tracks.states} == {TrackState.TENTATIVE}


def unknown_but(shipped, changed, folder):
    """The path of the traits `unknown` with one value of each class changed."""
    text = (FOLDER / "unknown.toml").read_text("utf-8")
    assert shipped in text
    path = folder / "changed.toml"
    path.write_text(text.replace(shipped, changed), "utf-8")
    return str(path)


def test_a_target_detected_once_is_doubted_until_the_second_detection(tmp_path):
    odds = []
    for traits in ("unknown", unknown_but("seen_once = 0.0", "seen_once = -1.5", tmp_path)):
        episode = [boxes([(10, 0)] if t != 1 else [], t, 0.95) for t in range(4)]
        scores = np.array([tracks.scores[0] for tracks in run(existence(traits), episode)])
        odds.append(np.log(scores) - np.log1p(-scores))
    assert odds[1] - odds[0] == pytest.approx([-1.5, -1.5, 0, 0])


def test_a_hidden_target_is_doubted_less():
    scores = []
    for front in ([(10, 0)], [(10, 20)]):
        tracker, pose = existence(), Pose.identity()
        for t in range(14):
            behind = [(20, 0)] if t < 10 else []
            tracks = tracker.update(boxes([*behind, *front], t, 0.95), pose)
        (far,) = np.flatnonzero(np.abs(tracks.centres[:, 0] - 20) < 1)
        scores.append(tracks.scores[far])
    assert scores[0] > 0.03 + scores[1]


def test_misses_count_less_when_missed_targets_come_back():
    """Ten detections, four misses, and so on."""
    tracker = existence()
    episode = [boxes([(10, 0)] if t % 14 < 10 else [], t, 0.95) for t in range(21 * 14)]
    reported_tracks = run(tracker, episode)
    scores = np.reshape([tracks.scores[0] for tracks in reported_tracks], (21, 14))[:, 10:]
    assert (np.diff(scores, axis=0) > 0).all(), "from run to run"
    assert (np.diff(scores, axis=1) < 0).all(), "but less with every miss of a run"
    assert scores[-1, 0] > 2 * scores[0, 0]
    shown = [TrackState.TENTATIVE not in tracks.states for tracks in reported_tracks]
    assert sum(shown[-14:]) > sum(shown[:14])


def test_new_targets_must_be_detected_again_soon():
    tracker = existence()
    run(tracker, [boxes([(10, 0)] if t in (0, 7) else [], t, 0.95) for t in range(8)])
    new = tracker._reappearances.new
    assert (new.detected_again, new.lost) == (0, 1)


@pytest.mark.parametrize(
    ("detections", "coast_known_s", "targets"), [(15, 3.0, 1), (15, 1.5, 2), (3, 3.0, 2)]
)
def test_the_identity_of_a_known_target_outlives_an_occlusion_of_seconds(
    detections, coast_known_s, targets
):
    end = detections + 25
    episode = [
        boxes([(10 + 0.8 * t, 0)] if not detections <= t < end else [], t, 0.95) for t in range(60)
    ]
    tracker = make("existence", traits="roadscope", coast_known_s=coast_known_s)
    assert len(identities(run(tracker, episode))) == targets


@pytest.mark.parametrize("sigma", [0.1, 0.8])
def test_covariances_follow_the_errors_of_detections(sigma):
    """Squared errors of positions over covariances, per degree of freedom.

    Below 1: errors of an unknown detector are assumed to last, and these do not.
    """
    rng, tracker, ratios = np.random.default_rng(0), existence("unknown"), []
    cars = np.array([[10.0 * k, 8.0 * (k % 5)] for k in range(20)])
    for t in range(80):
        truth = cars + np.array([0.8 * t, 0])
        detected = boxes(truth + sigma * rng.standard_normal((20, 2)), t, 0.95)
        tracks = tracker.update(detected, None)
        distances = np.linalg.norm(tracks.centres[:, None, :2] - truth, axis=2)
        row, column = np.nonzero(distances < 2.0)
        errors = tracks.centres[row, :2] - truth[column]
        solved = np.linalg.solve(tracks.covariances[row, :2, :2], errors[..., None])[..., 0]
        ratios.append((errors * solved).sum(axis=1) / 2)
    assert 0.06 < np.concatenate(ratios[40:]).mean() < 0.15


def test_surplus_widens_covariances_of_positions_alone(tmp_path):
    one, other = (
        run(existence(traits), [boxes([(10 + 0.5 * t, 0)], t, 0.95) for t in range(10)])[-1]
        for traits in ("unknown", unknown_but("surplus = 4.0", "surplus = 16.0", tmp_path))
    )
    assert other.centres == pytest.approx(one.centres)
    assert other.covariances[:, :2, :2] == pytest.approx(4 * one.covariances[:, :2, :2])
    assert other.covariances[:, 2:, :] == pytest.approx(one.covariances[:, 2:, :])
    assert (np.linalg.eigvalsh(other.covariances) > 0).all()
