"""A drive that comes back, and the poses that agree with that."""

from dataclasses import replace

import numpy as np
import pytest
import toy_drive
from scipy.optimize import least_squares
from toy_drive import ToyDrive, offset

from roadscope.odometry import LegoLoamOdometry, exp_se3, inverse, log_se3
from roadscope.odometry.lego import (
    DRIVEN_M,
    Keyframe,
    Link,
    LoopClosing,
    best_motion,
    icp_motion,
    misfits,
    nearest_candidate,
    optimised_poses,
    overlap,
    relocalised,
)

RADIUS_M, STEPS = 20.0, 40


def ring_of_links(rng, count, noise):
    """A ring of poses, links along it measured with noise, one link that closes it; and drift."""
    truth = [exp_se3(np.array([0, 0, 0, 0, 0, 2 * np.pi * k / count])) for k in range(count)]
    truth = np.array([t @ exp_se3(np.array([0, -10.0, 0, 0, 0, 0])) for t in truth])
    spread = np.array([0.05] * 3 + [0.01] * 3)
    links, odometry_poses = [], [truth[0]]
    for k in range(count - 1):
        error = exp_se3(noise * spread * rng.standard_normal(6))
        links.append(Link(k, k + 1, inverse(truth[k]) @ truth[k + 1] @ error, spread))
        odometry_poses.append(odometry_poses[-1] @ links[-1].motion)
    links.append(Link(0, count - 1, inverse(truth[0]) @ truth[-1], spread / 5))
    return truth, np.array(odometry_poses), links


def test_optimised_poses_equal_scipys():
    _, odometry_poses, links = ring_of_links(np.random.default_rng(0), 6, 3.0)
    optimised = optimised_poses(odometry_poses, links)

    def off(x):
        steps = [np.eye(4), *(exp_se3(twist) for twist in x.reshape(-1, 6))]
        return misfits(odometry_poses @ np.array(steps), links).ravel()

    slow = least_squares(
        off, np.zeros(6 * (len(odometry_poses) - 1)), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    cost = (misfits(optimised, links) ** 2).sum()
    assert cost == pytest.approx(2 * slow.cost, rel=1e-4)
    assert cost < 0.5 * (misfits(odometry_poses, links) ** 2).sum()
    assert (optimised[0] == odometry_poses[0]).all()


def test_a_closed_ring_is_nearer_to_the_truth():
    better = 0
    for seed in range(10):
        truth, odometry_poses, links = ring_of_links(np.random.default_rng(seed), 30, 1.0)
        optimised = optimised_poses(odometry_poses, links)
        away = [np.linalg.norm((p - truth)[:, :3, 3], axis=1) for p in (odometry_poses, optimised)]
        assert away[1][-1] < 0.1
        better += away[1].mean() < away[0].mean()
    assert better >= 8


def test_poses_without_links_stay():
    poses = np.array([exp_se3(np.arange(6.0)), np.eye(4)])
    assert (optimised_poses(poses, []) == poses).all()
    assert (optimised_poses(poses[:1], []) == poses[:1]).all()


def test_icp_brings_points_onto_points():
    rng = np.random.default_rng(0)
    target = rng.uniform(-20, 20, (300, 3)) * (1, 1, 0.1)
    motion = exp_se3(np.array([1.0, -0.5, 0.1, 0.01, 0, 0.03]))
    points = (target - motion[:3, 3]) @ motion[:3, :3]
    assert best_motion(points, target) == pytest.approx(motion)
    estimated_motion = icp_motion(
        np.vstack([points, rng.uniform(50, 60, (20, 3))]), target, np.eye(4), 5.0
    )
    assert np.abs(log_se3(inverse(motion) @ estimated_motion)).max() < 1e-3
    assert (icp_motion(points + 500, target, np.eye(4), 5.0) == np.eye(4)).all()
    half = np.vstack([points, points + np.array([0, 0, 50])])
    assert overlap(half, target, motion, 0.1) == 0.5


def poles(rng):
    """Poles and ground about a ring of road, (N, 3) each."""
    angle, away = rng.uniform(0, 2 * np.pi, 60), rng.choice([12.0, 27.0, 33.0], 60)
    away = away * rng.uniform(0.9, 1.1, 60)
    feet = np.column_stack([away * np.cos(angle), away * np.sin(angle)])
    up = np.arange(-1.5, 2, 0.25)
    edges = np.column_stack([np.repeat(feet, len(up), axis=0), np.tile(up, 60)])
    level = rng.uniform(-40, 40, (20000, 2))
    return edges, np.column_stack([level, np.full(len(level), -1.9)])


def driven_round(truth_of, drift):
    """Keyframes of a ring driven slightly more than once, with drift."""
    rng = np.random.default_rng(0)
    edges, planes = poles(rng)
    estimate, truth, frames = truth_of(0), [], []
    for k in range(STEPS + 4):
        truth.append(truth_of(k))
        if k:
            estimate = estimate @ inverse(truth[-2]) @ truth[-1] @ exp_se3(drift)
        parts = []
        for points in (edges, planes):
            near = points[np.linalg.norm(points - truth[-1][:3, 3], axis=1) < 25]
            own = (near - truth[-1][:3, 3]) @ truth[-1][:3, :3]
            parts.append(own + 0.01 * rng.standard_normal(own.shape))
        few = np.arange(0, len(parts[1]), 8)
        frames.append(Keyframe(*parts, few, estimate, 2 * np.pi * RADIUS_M / STEPS * k))
    return frames, np.array(truth)


def centred(k):
    once_round = 2 * np.pi * np.array([RADIUS_M, 0, 0, 0, 0, 1])
    return exp_se3(np.array([0, -RADIUS_M, 0, 0, 0, 0])) @ exp_se3(once_round * k / STEPS)


@pytest.fixture(scope="module")
def ring():
    return driven_round(centred, np.array([0.03, 0.04, 0.01, 0, 0, 0.002]))


def test_a_loop_closes(ring):
    frames, truth = ring
    closing, taken, when = LoopClosing(), [], []
    for each in frames:
        # As in a mapping: keyframes after a loop start from the corrected pose.
        moved = each.map_from_lidar
        if taken:
            step = inverse(frames[len(taken) - 1].map_from_lidar) @ each.map_from_lidar
            moved = taken[-1].map_from_lidar @ step
        taken.append(Keyframe(each.edges, each.planes, each.few, moved, each.driven_m))
        closing.add(taken)
        corrected = closing.closed_by(taken)
        if corrected is not None:
            taken = corrected
            when.append(len(taken))
    away = np.linalg.norm([f.place - t[:3, 3] for f, t in zip(frames, truth, strict=True)], axis=1)
    closed = np.linalg.norm([f.place - t[:3, 3] for f, t in zip(taken, truth, strict=True)], axis=1)
    assert closing.closed >= 1
    assert when[0] > STEPS // 2
    assert away[-1] > 1.0
    assert closed[-1] < away[-1] / 5
    assert closed.mean() < away.mean() / 2


def test_only_earlier_visits_are_candidates(ring):
    frames, _ = ring
    assert nearest_candidate(frames[:1]) is None
    assert nearest_candidate(frames[: STEPS // 2]) is None
    back = nearest_candidate(frames)
    assert frames[-1].driven_m - frames[back].driven_m > DRIVEN_M
    assert back in range(8)


def test_another_place_closes_no_loop(ring):
    frames, _ = ring
    rng = np.random.default_rng(5)
    edges, planes = poles(rng)
    near = edges[np.linalg.norm(edges[:, :2] - [0, -20], axis=1) < 25] + [0, 20, 0]
    last = frames[-1]
    few = np.arange(0, len(planes), 16)
    other = Keyframe(near, planes, few, last.map_from_lidar, last.driven_m)
    assert relocalised([*frames[:-1], other], nearest_candidate(frames)) is None
    nothing = Keyframe(near[:0], planes[:0], np.arange(0), last.map_from_lidar, last.driven_m)
    assert relocalised([*frames[:-1], nothing], nearest_candidate(frames)) is None


def test_a_loop_with_too_large_a_drift_is_rejected(ring):
    frames, truth = ring
    back = nearest_candidate(frames)
    # The place matches, but the distance driven is too short for so large a drift.
    hasty = [replace(f, driven_m=0.1 * f.driven_m) for f in frames]
    assert np.linalg.norm(frames[-1].place - truth[-1][:3, 3]) > 1.0
    assert relocalised(frames, back) is not None
    assert relocalised(hasty, back) is None


def square():
    """Houses around and within a ring of road of 20 m radius, and poles beside it."""
    rng = np.random.default_rng(0)
    boxes = [(0, 20, 3, 6, 6, 6)]
    for angle in np.arange(0, 2 * np.pi, 0.35):
        away = rng.uniform(33, 40)
        boxes.append((away * np.sin(angle), 20 - away * np.cos(angle), 3, *rng.uniform(2, 4, 2), 6))
        pole = angle + rng.uniform(0, 0.2)
        boxes.append((26 * np.sin(pole), 20 - 26 * np.cos(pole), 3, 0.15, 0.15, 4))
    return np.array(boxes)[:, :3], np.array(boxes)[:, 3:]


@pytest.mark.slow
def test_a_loop_closes_in_a_drive(monkeypatch):
    scene = square()
    monkeypatch.setattr(toy_drive, "street", lambda: scene)
    drive = ToyDrive(8.0, 0.4)
    ends = {}
    for loop in (False, True):
        # A short map leaves the drift to the loop.
        odometry = LegoLoamOdometry(loop=loop, reach_m=8.0)
        for k in range(185):
            estimate = odometry.update(drive.scan(k))
        loops = odometry._mapping.loops
        assert (loops.closed if loops else 0) >= loop
        ends[loop] = offset(estimate, drive.pose(estimate.stamp_s))[0]
    assert ends[True] < 0.5
    assert ends[True] <= ends[False] + 0.05
