"""The smoother beside the information floor, and whether its covariance tells the truth."""

from functools import cache

import numpy as np
import pytest

from roadscope.benchmarks.zhang2017_floor import floor
from roadscope.benchmarks.zhang2017_outline import fusion
from roadscope.benchmarks.zhang2017_scene import film
from roadscope.detectors.pose.estimate import axis_difference
from roadscope.detectors.pose.smoother import Smoother

SEEDS = range(3)
DRIVES = ("straight", "curve", "following-30", "following-50")
PAPER = {"straight": (0.0260, 5.1006), "curve": (0.0759, 7.8444)}
"""Position (m) and heading (degrees) of the paper's multi-frame fit."""


@cache
def runs(drive, body):
    return [film(drive, seed, body=body, frames=30) for seed in SEEDS]


@cache
def judged(drive, body, frames):
    """Errors (K, 3), squared floors of place and heading, and NEES, of scored frames."""
    errors, floors, scores = [], [], []
    for run in runs(drive, body):
        smoother = Smoother(run.spec, fusion(), frames=frames)
        poses = [
            smoother.update(s.scan, s.target, s.world_from_lidar, rolling=run.drive.rolling)
            for s in run.shots
        ]
        poses = poses[frames // 2 :] + smoother.flush()
        least = floor(run, frames)
        for k, (pose, shot) in enumerate(zip(poses, run.shots, strict=True)):
            if shot.target.sum() < 3 or least.shares[k] < 0.005:
                continue
            off = np.array([pose.x, pose.y, pose.yaw]) - shot.truth
            off[2] = axis_difference(off[2], 0.0)
            errors.append(off)
            floors.append([least.position_m[k] ** 2, least.heading_rad[k] ** 2])
            scores.append(off @ np.linalg.solve(pose.covariance, off))
    return np.array(errors), np.array(floors), np.array(scores)


@pytest.mark.slow
@pytest.mark.parametrize("body", ["sharp", "rounded"])
@pytest.mark.parametrize("drive", DRIVES)
def test_stays_within_twice_the_floor(drive, body):
    errors, floors, _ = judged(drive, body, 7)
    place = np.sqrt(np.mean(errors[:, 0] ** 2 + errors[:, 1] ** 2))
    heading = np.sqrt(np.mean(errors[:, 2] ** 2))
    assert place < 2 * np.sqrt(floors[:, 0].mean())
    assert heading < 2 * np.sqrt(floors[:, 1].mean())
    assert np.abs(errors[:, 2]).max() < np.radians(20.0)
    if drive in PAPER:
        assert place < PAPER[drive][0]
        assert np.degrees(heading) < PAPER[drive][1]


@pytest.mark.slow
@pytest.mark.parametrize("body", ["sharp", "rounded"])
@pytest.mark.parametrize("drive", DRIVES)
def test_covariance_is_consistent(drive, body):
    """NEES inside its 95 % band, the windows that share no scan counted as independent."""
    from scipy.stats import chi2

    frames = 3
    _, _, scores = judged(drive, body, frames)
    independent = max(len(scores) // frames, 1)
    low, high = chi2.ppf([0.025, 0.975], 3 * independent) / independent
    assert low < scores.mean() < high
