"""The motion between the features of two scans."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from toy_drive import ToyDrive

from roadscope.odometry import deskewed, exp_se3, log_se3
from roadscope.odometry.loam import (
    DEVIATION,
    NOISE_M,
    TUKEY,
    Pairs,
    distances,
    extract,
    joined,
    match_features,
    moved,
    normal_equations,
    pair_weights,
    settle,
)


def features(drive, k, rows=None):
    """Of a scan whose sweep's own motion is taken out; label 0 is the ground."""
    scan = drive.scan(k)
    scan = scan if rows is None else scan.select(rows)
    points = deskewed(scan.points, scan.time_offset_s, drive.twist)
    labels = (points[:, 2] > -1.6).astype(int)
    return extract(points, scan.ring, scan.column, labels, edge_rows=labels == 1)


def off(match, drive, scans=1):
    twist = np.abs(
        log_se3(np.linalg.inv(exp_se3(0.1 * scans * drive.twist)) @ match.before_from_now)
    )
    return twist[:3].max(), twist[3:].max()


@pytest.mark.parametrize(("speed_m_s", "yaw_rate_rad_s"), [(0, 0), (8, 0.1), (5, -0.6)])
def test_finds_the_motion_between_two_scans(speed_m_s, yaw_rate_rad_s):
    drive = ToyDrive(speed_m_s, yaw_rate_rad_s)
    matched = match_features(features(drive, 1), features(drive, 0), np.eye(4))
    away_m, turned = off(matched, drive)
    assert away_m < 0.1
    assert turned < 0.003
    assert matched.pair_count > 100
    assert matched.residual_m < 0.1
    assert np.linalg.eigvalsh(matched.information)[0] > 0


def test_the_start_matters_little():
    drive = ToyDrive()
    now, before = features(drive, 1), features(drive, 0)
    from_rest = match_features(now, before, np.eye(4))
    from_truth = match_features(now, before, exp_se3(0.1 * drive.twist))
    assert from_rest.before_from_now == pytest.approx(from_truth.before_from_now, abs=2e-3)


def test_two_steps_find_what_one_does():
    """Ground planes give height, roll and pitch; edges the rest (Shan and Englot 2018)."""
    drive = ToyDrive()
    now, before = features(drive, 1), features(drive, 0)
    level = (False, False, True, True, True, False)
    first = match_features(now, before, np.eye(4), edges=False, free=level)
    assert first.before_from_now[:2, 3].tolist() == [0, 0]
    second = match_features(
        now, before, first.before_from_now, planes=False, free=tuple(not f for f in level)
    )
    assert second.before_from_now[2, 3] == first.before_from_now[2, 3]
    away_m, turned = off(second, drive)
    assert away_m < 0.1
    assert turned < 0.01


def test_ground_alone_does_not_determine_the_horizontal_motion():
    drive = ToyDrive()
    low = [drive.scan(k).points[:, 2] < -1.6 for k in (0, 1)]
    matched = match_features(features(drive, 1, low[1]), features(drive, 0, low[0]), np.eye(4))
    free, whole = np.linalg.eigvalsh(matched.information)[[2, 3]]
    assert whole > 20 * free
    assert np.isfinite(matched.before_from_now).all()
    assert np.abs(log_se3(matched.before_from_now)[[2, 3, 4]]).max() < 0.02


@pytest.mark.parametrize("rows", [np.zeros(0, int), np.arange(12)])
def test_nothing_to_match_is_no_motion(rows):
    drive = ToyDrive()
    whole, poor = features(drive, 0), features(drive, 1, rows)
    start = exp_se3(np.array([1.0, 2, 3, 0.1, 0.2, 0.3]))
    for now, before in ((poor, whole), (whole, poor), (poor, poor)):
        matched = match_features(now, before, start)
        assert matched.before_from_now == pytest.approx(start)
        assert matched.pair_count == 0
        assert np.isnan(matched.residual_m)
        assert not matched.information.any()


def test_labels_separate_features():
    drive = ToyDrive()
    now, before = features(drive, 1), features(drive, 0)
    swapped = exp_se3(np.zeros(6))
    assert match_features(now, before, swapped).pair_count > 100
    other = type(before)(
        **{
            name: getattr(before, name) + 5 if name.endswith("labels") else getattr(before, name)
            for name in before.__dataclass_fields__
        }
    )
    assert match_features(now, other, swapped).pair_count == 0
    assert match_features(now, other, swapped, same_label=False).pair_count > 100


def planes_at(rng, truth, count, wrong):
    """Points on planes of all directions, some of them on others than they are paired with."""
    axes = np.zeros((count, 2, 3))
    axes[:, 0] = rng.standard_normal((count, 3))
    axes[:, 0] /= np.linalg.norm(axes[:, 0], axis=1)[:, None]
    anchors = rng.uniform(-20, 20, (count, 3))
    placed = anchors + 0.01 * rng.standard_normal((count, 3))
    placed[:wrong] += axes[:wrong, 0] * rng.uniform(0.5, 2, (wrong, 1))
    return Pairs((placed - truth[:3, 3]) @ truth[:3, :3], anchors, axes)


def test_wrong_pairs_have_no_weight():
    truth = exp_se3(np.array([0.1, 0.05, 0.02, 0.003, 0.002, 0.01]))
    pairs = planes_at(np.random.default_rng(0), truth, 200, 60)
    matched = settle([lambda pose: pairs], np.eye(4))
    assert np.abs(log_se3(np.linalg.inv(truth) @ matched.before_from_now)).max() < 5e-3
    assert matched.pair_count <= 145


def test_the_motion_equals_that_of_a_slow_reweighting():
    truth = exp_se3(np.array([0.1, 0.05, 0.02, 0.003, 0.002, 0.01]))
    pairs = planes_at(np.random.default_rng(1), truth, 120, 12)
    matched = settle([lambda pose: pairs], np.eye(4), most=40).before_from_now
    slow = truth
    for _ in range(20):
        away = distances(pairs, slow)
        sigma = max(DEVIATION * np.median(away), NOISE_M)
        weights = np.maximum(1 - (away / (TUKEY * sigma)) ** 2, 0) ** 2
        placed = lambda x, pose=slow: moved(pose, x)  # noqa: E731
        x = least_squares(
            lambda x, w=weights: np.sqrt(w) * distances_signed(pairs, placed(x)),  # noqa: B023
            np.zeros(6),
            xtol=1e-14,
        ).x
        slow = moved(slow, x)
    assert matched == pytest.approx(slow, abs=2e-4)


def distances_signed(pairs, motion):
    placed = pairs.points @ motion[:3, :3].T + motion[:3, 3]
    return ((placed - pairs.anchors) * pairs.axes[:, 0]).sum(axis=1)


def test_information_comes_from_the_pairs_with_weight():
    pairs = planes_at(np.random.default_rng(2), np.eye(4), 150, 20)
    matched = settle([lambda pose: pairs], np.eye(4))
    weights = pair_weights([pairs], matched.before_from_now)
    H, _, cost = normal_equations(pairs, weights, matched.before_from_now)
    assert matched.information == pytest.approx(H)
    assert matched.residual_m == pytest.approx(np.sqrt(cost / weights.sum()))
    assert weights.max() <= 1 / NOISE_M**2
    assert matched.pair_count == (weights > 0).sum() < 140


def test_each_kind_is_weighted_by_its_own_scatter():
    rng = np.random.default_rng(3)
    sharp, loose = planes_at(rng, np.eye(4), 80, 0), planes_at(rng, np.eye(4), 80, 0)
    loose = Pairs(loose.points + 0.3 * rng.standard_normal((80, 3)), *loose[1:])
    weights = pair_weights([sharp, loose], np.eye(4))
    assert weights[:80].min() > weights[80:].max()
    assert len(joined([]).points) == 0
