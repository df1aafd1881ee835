from dataclasses import replace

import numpy as np
import pytest

from research.zhang2017_calibration import (
    NO_PHASES,
    PassingCar,
    body_of,
    drive_through,
    fitted_pose,
    lidar,
)
from roadscope.benchmarks.papers import RobotLidar, ford_fusion, sense_drive, sense_sweeps
from roadscope.detectors.pose import MOTION, VALUES, Smoother, axis_difference


def smoothed_poses(run, model=None, **options):
    """Poses of a run's frames, one for each."""
    smoother = Smoother(run.spec, model or ford_fusion(), **options)
    rolling = run.drive.rolling
    poses = [
        smoother.update(s.scan, s.target, s.world_from_lidar, rolling=rolling) for s in run.sweeps
    ]
    lag = options.get("lag", options.get("frames", 7) // 2)
    return poses[lag:] + smoother.flush()


def errors(run, poses):
    """(K, 3) errors of x, y and yaw up to half a turn, where there are three returns or more."""
    pairs = [(p, s) for p, s in zip(poses, run.sweeps, strict=True) if p and s.target.sum() >= 3]
    off = np.array([[p.x, p.y, p.yaw] for p, _ in pairs]) - [s.truth for _, s in pairs]
    off[:, 2] = axis_difference(off[:, 2], 0.0)
    return off


def rms(values):
    return float(np.sqrt(np.mean(np.sum(values**2, axis=-1))))


@pytest.fixture(scope="module")
def curve():
    return sense_drive("curve", 0, frames=12)


def test_more_frames_are_better_on_a_curve_too(curve):
    places = [rms(errors(curve, smoothed_poses(curve, frames=k))[:, :2]) for k in (1, 3, 7)]
    assert places[0] > places[1] > places[2]
    assert places[2] < 0.01


def test_the_newest_frame_can_be_asked_for(curve):
    newest = errors(curve, smoothed_poses(curve, frames=5, lag=0))
    assert len(newest) == 12
    # Two scans alone see nothing beforehand.
    assert rms(newest[4:, :2]) < 0.02


def test_a_scan_with_one_return_feeds_the_window(curve):
    smoother = Smoother(curve.spec, ford_fusion(), frames=5)
    for k, shot in enumerate(curve.sweeps[:7]):
        target = shot.target.copy()
        if k == 3:
            target[np.flatnonzero(target)[1:]] = False
        pose = smoother.update(shot.scan, target, shot.world_from_lidar, rolling=False)
        if k == 5:
            truth = curve.sweeps[3].truth
            assert np.hypot(pose.x - truth[0], pose.y - truth[1]) < 0.05


@pytest.mark.parametrize("seed", [3, 6])
def test_the_second_scan_shows_how_the_sensor_moved_in_the_first(seed):
    """At 3 m/s a rear end 10 m away seems turned by 1/3 deg to a sensor taken to stand."""
    run = sense_drive("following-10", seed, frames=5)
    corrected, uncorrected = (Smoother(run.spec, ford_fusion(), frames=5, lag=1) for _ in range(2))
    before, *shots = run.sweeps
    corrected.update(before.scan, np.zeros_like(before.target), before.world_from_lidar)
    for s in shots:
        one, other = (
            x.update(s.scan, s.target, s.world_from_lidar) for x in (corrected, uncorrected)
        )
    assert np.hypot(one.x - other.x, one.y - other.y) < 0.0015
    assert abs(one.yaw - other.yaw) < np.radians(0.02)


def test_without_a_return_there_is_no_pose(curve):
    smoother = Smoother(curve.spec, ford_fusion(), frames=3, lag=0)
    shot = curve.sweeps[0]
    empty = np.zeros_like(shot.target)
    assert smoother.update(shot.scan, empty, shot.world_from_lidar) is None
    assert smoother.flush() == []


@pytest.mark.parametrize("back_s", [0.0, 0.1])
def test_refuses_stamps_that_do_not_increase_and_goes_on(back_s, curve):
    smoother, other = (Smoother(curve.spec, ford_fusion(), frames=3, lag=0) for _ in range(2))
    first, second = curve.sweeps[:2]
    for each in (smoother, other):
        each.update(first.scan, first.target, first.world_from_lidar, rolling=False)
    again = replace(first.scan, stamp_s=first.scan.stamp_s - back_s)
    with pytest.raises(ValueError, match="stamps must increase"):
        smoother.update(again, first.target, first.world_from_lidar, rolling=False)
    one, two = (
        each.update(second.scan, second.target, second.world_from_lidar, rolling=False)
        for each in (smoother, other)
    )
    assert one == two


@pytest.mark.parametrize(
    ("options", "message"),
    [({"frames": 0}, "frames must be at least 1"), ({"frames": 3, "lag": 3}, "lag must be")],
)
def test_refuses_windows_by_name(options, message, curve):
    with pytest.raises(ValueError, match=message):
        Smoother(curve.spec, ford_fusion(), **options)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", [5, 9])
def test_sharp_noise_turns_no_vehicle_across_its_path(seed):
    """Seen from behind with little noise, a scan alone fits best with the body across."""
    run = sense_drive("straight", seed, noise=0.5)
    turned = np.abs(errors(run, smoothed_poses(run, frames=3))[:, 2])
    assert turned.max() < np.radians(45.0)


AT_THE_SEAM = [
    (-13.0, 4.4, -2.0, 78.0),
    (-10.65, 1.4, -1.68, 42.0),
    (-22.0, 0.05, 0.04, 31.0),
    (-16.0, 1.6, 1.67, 37.0),
    (-12.0, -1.0, 0.6, 5.0),
    (-22.6, -0.02, 0.2, 0.08),
    (-58.0, -0.06, 0.2, 0.08),
]
"""x, y, yaw, speed in the middle frame."""


@pytest.mark.sampled(4)
@pytest.mark.parametrize("frames", [1, 3, 7])
@pytest.mark.parametrize("path", AT_THE_SEAM)
def test_cars_that_the_sweep_begins_and_ends_on_are_found(path, frames):
    """The sweep begins behind the LiDAR: it hits cars there in part, or twice at two places.

    It hits a standing car twice, too, from two sides.
    """
    model, rng = ford_fusion(), np.random.default_rng(3)
    body = body_of(model, np.zeros(VALUES - MOTION))
    drive = drive_through(np.array([*path, 0.1, 0.3]))
    shots = sense_sweeps(drive, RobotLidar(lidar()), body, NO_PHASES, rng)
    velocity = path[3] * np.array([np.cos(path[2]), np.sin(path[2])])
    pose = fitted_pose(model, PassingCar(shots, np.array(path[:3]), velocity), frames)
    off = np.array([pose.x - path[0], pose.y - path[1], axis_difference(pose.yaw, path[2])])
    assert off @ np.linalg.solve(pose.covariance, off) < 25.0
