"""What every pose estimator promises; a new one needs a line in `ESTIMATORS`."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from roadscope.benchmarks.papers import ford_fusion, sense_drive
from roadscope.core import Pose, RecordError
from roadscope.detectors.pose import (
    BodyFit,
    Smoother,
    axis_difference,
    fit_multi,
    fit_ransac,
    fit_single,
)

SIZE = {"length_m": 4.87, "width_m": 1.85}


def by_points(fit, shots):
    return fit(shots[1].points_xy, shots[1].origin_xy, **SIZE)


def by_drawn_points(shots):
    return by_points(partial(fit_ransac, rng=np.random.default_rng(0)), shots)


def by_frames(shots):
    points, origins = [s.points_xy for s in shots], [s.origin_xy for s in shots]
    return fit_multi(points, origins, [s.scan.stamp_s for s in shots], **SIZE)


def by_rays(shots):
    """One scan hardly tells the car's front from its rear, so that is said."""
    shot = shots[1]
    fit = BodyFit(spec(), ford_fusion(0.0, 0.0))
    heading = float(shot.truth[2])
    return fit.fit(shot.scan, shot.target, shot.world_from_lidar, rolling=False, towards=heading)


def smoothed(shots):
    smoother = Smoother(spec(), ford_fusion(0.0, 0.0), frames=3)
    return smoothed_poses(smoother, shots)[-1]


def smoothed_poses(smoother, shots):
    return [smoother.update(s.scan, s.target, s.world_from_lidar, rolling=False) for s in shots]


ESTIMATORS = {
    "single": partial(by_points, fit_single),
    "multi": by_frames,
    "ransac": by_drawn_points,
    "body": by_rays,
    "smoother": smoothed,
}
"""Each is given three scans and tells where the car is in the middle one."""

TOLERANCE = {"single": (0.01, 0.002), "multi": (0.01, 0.002), "ransac": (1e-5, 1e-5)}
SAMPLED = (0.06, 0.006)
"""Metres and radians: the others draw few samples, along axes that turn with the scene up to a
sign; the standard deviations of what they estimate here are 0.02 to 0.05 m and 0.01 rad."""
FINDS_M = {"multi": 0.15}
"""Three times the RMSE of the paper's three-frame fit on the curve, 0.05 m over 30 seeds."""
NO_ANSWER = {"body", "smoother"}
"""Without a return these answer None; those that are given points refuse none by name."""

every = pytest.mark.parametrize("name", ESTIMATORS)
few = settings(max_examples=5, phases=[Phase.generate])


@cache
def spec():
    return sense_drive("straight", 0, frames=1).spec


@cache
def sweeps_of(drive="straight", seed=0):
    return sense_drive(drive, seed, frames=3).sweeps


def changed(shots, change):
    """Change every scan; `change` maps scan and target to such."""
    pairs = [change(shot.scan, shot.target) for shot in shots]
    return [replace(s, scan=a, target=b) for s, (a, b) in zip(shots, pairs, strict=True)]


def carried(shots, motion):
    return [
        replace(
            shot,
            world_from_lidar=motion @ shot.world_from_lidar,
            truth=np.append(moved(shot.truth[:2], motion), shot.truth[2] + motion.yaw),
        )
        for shot in shots
    ]


def moved(place, motion):
    return motion.apply(np.append(place, 0.0)[None])[0, :2]


def off(name, estimate, expected, motion=None):
    """Return how far a pose is off the expected one, moved, in units of what is allowed."""
    motion = Pose.identity() if motion is None else motion
    metres, radians = TOLERANCE.get(name, SAMPLED)
    place = moved(expected.centre, motion)
    turn = abs(axis_difference(estimate.yaw, expected.yaw + motion.yaw))
    return max(np.hypot(*(estimate.centre - place)) / metres, turn / radians)


@every
def test_finds_the_car(name):
    for drive in ("straight", "curve"):
        pose, (x, y, yaw) = ESTIMATORS[name](sweeps_of(drive)), sweeps_of(drive)[1].truth
        assert np.hypot(pose.x - x, pose.y - y) < FINDS_M.get(name, 0.1)
        assert abs(axis_difference(pose.yaw, yaw)) < np.radians(1)


@every
@few
@given(
    turn=st.floats(-3.1, 3.1),
    x=st.floats(-50, 50),
    y=st.floats(-50, 50),
    drive=st.sampled_from(["straight", "curve"]),
)
def test_rigid_motion_moves_the_pose(name, turn, x, y, drive):
    motion, shots = Pose.planar(x, y, turn), sweeps_of(drive)
    here, there = (ESTIMATORS[name](s) for s in (shots, carried(shots, motion)))
    assert off(name, there, here, motion) < 1
    assert (there.length, there.width) == pytest.approx((here.length, here.width), abs=0.01)
    if here.covariance is not None:
        spreads = [np.linalg.eigvalsh(p.covariance) ** 0.5 for p in (here, there)]
        assert (spreads[0] / spreads[1] > 0.4).all()
        assert (spreads[0] / spreads[1] < 2.5).all()


@every
@few
@given(seed=st.integers(0, 2**32 - 1))
def test_order_of_the_returns_changes_nothing(name, seed):
    def mix(scan, target):
        order = np.random.default_rng(seed).permutation(len(scan))
        return scan.select(order), target[order]

    shots = sweeps_of()
    assert off(name, ESTIMATORS[name](changed(shots, mix)), ESTIMATORS[name](shots)) < 1e-3


@every
def test_copies_of_returns_say_the_same(name):
    def copy(scan, target):
        return scan.select(np.repeat(np.arange(len(scan)), 2)), np.repeat(target, 2)

    shots = sweeps_of()
    pose, here = (ESTIMATORS[name](s) for s in (changed(shots, copy), shots))
    # Random pairs of twice the returns are other pairs.
    assert off(name, pose, here) < 1 or (
        name == "ransac" and np.hypot(*(pose.centre - here.centre)) < 0.2
    )


@every
def test_same_input_same_output_to_the_bit(name):
    assert ESTIMATORS[name](sweeps_of()) == ESTIMATORS[name](sweeps_of())


@every
def test_input_is_left_alone(name):
    shots = sense_drive("straight", 3, frames=3).sweeps
    ESTIMATORS[name](shots)
    for shot, before in zip(shots, sense_drive("straight", 3, frames=3).sweeps, strict=True):
        assert shot.scan == before.scan
        assert np.array_equal(shot.target, before.target)
        assert shot.world_from_lidar == before.world_from_lidar


@every
@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_returns_give_a_pose_beside_them(name, count):
    def few_of(scan, target):
        rows = np.flatnonzero(target)
        return scan, np.isin(np.arange(len(target)), rows[:: -(-len(rows) // count)][:count])

    shots = changed(sweeps_of(), few_of)
    pose = ESTIMATORS[name](shots)
    nearest = np.hypot(*(shots[1].points_xy - pose.centre).T).min()
    assert nearest < np.hypot(*SIZE.values()) / 2 + 0.3
    assert pose.covariance is None or (np.linalg.eigvalsh(pose.covariance) > 0).all()


@every
def test_returns_on_a_line_give_a_pose(name):
    """One beam on the rear: every line but that of the face is unseen."""

    def one_ring(scan, target):
        rings = scan.ring[target]
        return scan, target & (scan.ring == np.bincount(rings).argmax())

    shots = changed(sweeps_of(), one_ring)
    pose, truth = ESTIMATORS[name](shots), shots[1].truth
    assert np.hypot(*(pose.centre - truth[:2])) < 0.1


@every
def test_equal_places_give_a_pose(name):
    def heap(scan, target):
        rows = np.flatnonzero(target)[:1].repeat(9)
        return scan.select(rows), np.ones(9, bool)

    pose = ESTIMATORS[name](changed(sweeps_of(), heap))
    assert np.isfinite((pose.x, pose.y, pose.yaw)).all()


@every
def test_no_return_is_no_pose(name):
    def nothing(scan, target):
        return scan, np.zeros_like(target)

    shots = changed(sweeps_of(), nothing)
    if name in NO_ANSWER:
        assert ESTIMATORS[name](shots) is None
    else:
        with pytest.raises(ValueError, match="a pose needs at least 1 point"):
            ESTIMATORS[name](shots)


@every
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_place_is_refused_by_name(name, bad):
    """Points by the estimator, scans by the record, so that the others never see one."""
    shot = sweeps_of()[1]
    points = shot.points_xy.copy()
    points[3, 1] = bad
    refused = {
        "single": lambda: fit_single(points, shot.origin_xy, **SIZE),
        "multi": lambda: fit_multi([points], [shot.origin_xy], [0.0], **SIZE),
        "ransac": lambda: fit_ransac(points, shot.origin_xy, np.random.default_rng(0), **SIZE),
    }
    scan_refuses = partial(replace, shot.scan, points=np.full_like(shot.scan.points, bad))
    with pytest.raises((ValueError, RecordError), match=r"points.* must be finite"):
        refused.get(name, scan_refuses)()


def test_smoother_forgets_on_reset():
    smoother = Smoother(spec(), ford_fusion(0.0, 0.0), frames=3)
    first = smoothed_poses(smoother, sweeps_of())
    smoother.reset()
    smoothed_poses(smoother, sweeps_of("curve"))
    smoother.reset()
    assert smoothed_poses(smoother, sweeps_of()) == first
