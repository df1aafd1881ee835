import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator, KalmanFilter
from tracked_scenes import T as DT
from tracked_scenes import boxes, make

from roadscope.trackers import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    Gaussians,
    ImmFilter,
    PositionFilter,
    mixed,
)

WALKS = (0.1, 2.0, 8.0)


def filterpys(imm, place):
    """filterpy's estimator with the same three models of constant velocity."""
    filters = []
    for each in imm.filters:
        started = each.started(boxes([place], 0))
        one = KalmanFilter(dim_x=4, dim_z=2)
        one.x, one.P = started.means[0].copy(), started.covariances[0].copy()
        one.F, one.Q = each.motion.jacobian(one.x, DT), each.motion.noise(one.x, DT)
        one.H, one.R = each.H, each.R
        filters.append(one)
    return IMMEstimator(filters, np.full(3, 1 / 3), imm.transition(DT))


def test_the_filter_is_filterpys_estimator():
    rng = np.random.default_rng(2)
    imm = ImmFilter(tuple(PositionFilter(motion=ConstantVelocity(walk)) for walk in WALKS), 0.7)
    path = np.cumsum(rng.normal([1, 0.3], 0.4, (20, 2)), axis=0)
    still = rng.normal(0, 0.3, (20, 2))
    modes = imm.started(boxes([path[0], still[0]], 0))
    others = [filterpys(imm, place) for place in (path[0], still[0])]
    for places in zip(path[1:], still[1:], strict=True):
        modes = imm.corrected(imm.predicted(modes, DT), np.array(places))
        for k, (one, place) in enumerate(zip(others, places, strict=True)):
            one.predict()
            one.update(place)
            np.testing.assert_allclose(modes.probabilities[k], one.mu, atol=1e-9)
            np.testing.assert_allclose(modes.mixture.means[k], one.x, atol=1e-8)
            np.testing.assert_allclose(modes.mixture.covariances[k], one.P, atol=1e-8)
    assert modes.probabilities[0].argmax() != modes.probabilities[1].argmax()


def filterpys_step(each, mixed_before, place):
    """filterpy's prediction and correction of one model's belief, and its likelihood."""
    mean, covariance = mixed_before.means[0], mixed_before.covariances[0]
    one = ExtendedKalmanFilter(dim_x=len(mean), dim_z=2)
    one.F = each.motion.jacobian(mean[None], DT).reshape(len(mean), len(mean))
    one.Q, one.R = each.motion.noise(mean[None], DT).reshape(one.F.shape), each.R
    one.P = one.F @ covariance @ one.F.T + one.Q
    # filterpy moves states linearly; a turning one moves along its arc.
    one.x = each.motion.moved(mean[None], DT)[0][:, None]
    one.update(place[:, None], lambda x: each.H, lambda x: each.H @ x)
    return one.x[:, 0], one.P, one.likelihood


def test_each_model_is_corrected_as_by_filterpy():
    """Constant velocity, constant acceleration and turn, from what the three exchanged."""
    imm, rng = default_filter(), np.random.default_rng(6)
    t = np.arange(15) * DT
    path = np.column_stack([9 * t - t**2, 4 * np.sin(t)]) + rng.normal(0, 0.1, (15, 2))
    modes = imm.started(boxes([path[0]], 0))
    for place in path[1:]:
        flow = modes.probabilities[0][:, None] * imm.transition(DT)
        mixing = flow / flow.sum(axis=0)
        shared, likelihoods = modes.planar, np.empty(3)
        after = imm.corrected(imm.predicted(modes, DT), place[None])
        for j, (each, own, part) in enumerate(
            zip(imm.filters, modes.parts, after.parts, strict=True)
        ):
            before = mixed(own, shared, mixing[None, :, j], j)
            mean, covariance, likelihoods[j] = filterpys_step(each, before, place)
            np.testing.assert_allclose(part.means[0], mean, atol=1e-9)
            np.testing.assert_allclose(part.covariances[0], covariance, atol=1e-9)
        shares = flow.sum(axis=0) * likelihoods
        np.testing.assert_allclose(after.probabilities[0], shares / shares.sum(), atol=1e-9)
        modes = after


def default_filter():
    motions = (ConstantVelocity(0.5), ConstantAcceleration(2.0), CoordinatedTurn())
    return ImmFilter(tuple(PositionFilter(0.1, motion=motion) for motion in motions))


def drive(velocities):
    """Mode probabilities at the end of a drive at the (K, 2) velocities."""
    imm = default_filter()
    places = np.cumsum(velocities * DT, axis=0)
    modes = imm.started(boxes([places[0]], 0))
    for place in places[1:]:
        modes = imm.corrected(imm.predicted(modes, DT), place[None])
    return modes


def test_the_model_that_is_right_is_the_likeliest():
    t = np.arange(40) * DT
    straight = drive(np.stack([np.full(40, 10.0), np.zeros(40)], axis=1))
    braking = drive(np.stack([20 - 4 * t, np.zeros(40)], axis=1))
    turning = drive(10 * np.stack([np.cos(0.6 * t), np.sin(0.6 * t)], axis=1))
    assert straight.probabilities[0].argmax() == 0
    assert braking.probabilities[0].argmax() == 1
    assert turning.probabilities[0].argmax() == 2
    assert turning.turn.means[0, 4] == pytest.approx(0.6, abs=0.1)
    assert braking.acceleration.means[0, 4] == pytest.approx(-4, abs=0.7)


def test_mixing_keeps_covariances_proper_and_accelerations_unchanged():
    modes = drive(np.random.default_rng(1).normal(5, 3, (30, 2)))
    after = default_filter().predicted(modes, DT)
    for part in after.parts:
        assert (np.linalg.eigvalsh(part.covariances) > 0).all()
        turned = part.covariances.transpose(0, 2, 1)
        np.testing.assert_allclose(part.covariances, turned, atol=1e-12)
    # Mixing itself touches no acceleration, and a prediction leaves its mean.
    np.testing.assert_allclose(after.acceleration.means[:, 4:], modes.acceleration.means[:, 4:])


def test_hard_braking_is_tracked_better_than_by_one_model():
    rng = np.random.default_rng(4)
    speed = np.concatenate([np.full(30, 20.0), np.linspace(20, 0, 25), np.zeros(15)])
    path = np.stack([np.cumsum(speed * DT), np.zeros(70)], axis=1)
    errors = {}
    for name, tracker in (("imm", make("imm")), ("gnn", make("gnn", velocity_walk=0.5))):
        speed_errors = []
        for k, place in enumerate(path):
            tracks = tracker.update(boxes([place + 0.3 * rng.standard_normal(2)], k), None)
            speed_errors.append(abs(tracks.velocities[0, 0] - speed[k]))
        errors[name] = np.mean(speed_errors[30:])
    assert errors["imm"] < 0.7 * errors["gnn"]


def test_rows_of_modes_are_selected_together():
    modes = default_filter().started(boxes([[0, 0], [5, 5], [9, 1]], 0))
    picked = modes.select(np.array([2, 0]))
    assert isinstance(picked.turn, Gaussians)
    np.testing.assert_array_equal(picked.mixture.means[:, :2], [[9, 1], [0, 0]])
