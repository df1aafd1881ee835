"""Odometries of other libraries; skipped where these are not installed."""

import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from toy_drive import ToyDrive, offset

from roadscope.core import NotInstalledError, Pose, Requirement
from roadscope.odometry import ODOMETRIES, hat

PEERS = [name for name in ODOMETRIES if ODOMETRIES.resolve(name).requirement is not None]
AT_SPEED = {"small-gicp-scan": 0.25, "small-gicp": 0.1, "genz-icp": 0.1}
"""Largest errors in metres after 18 m from rest to 8 m/s in a scene with little structure."""


@pytest.fixture(params=PEERS)
def name(request):
    if ODOMETRIES.missing(request.param):
        pytest.skip(ODOMETRIES.missing(request.param))
    return request.param


@cache
def ridden(speed_m_s, yaw_rate_rad_s, scans):
    """From rest to speed within two seconds."""
    drive = ToyDrive(speed_m_s, yaw_rate_rad_s, ramp_s=2.0)
    return drive, [(drive.scan(k), drive.imu(k)) for k in range(scans)]


def off(spec, drive, inputs, mounting=None):
    """Errors of the last pose in metres and radians."""
    odometry = ODOMETRIES.make(spec)
    odometry.reset(mounting)
    estimates = [odometry.update(scan, imu) for scan, imu in inputs]
    return offset(estimates[-1], drive.pose(inputs[-1][0].stamp_s))


def test_five_of_four_libraries():
    assert len(PEERS) == 5
    assert {ODOMETRIES.resolve(name).requirement.distribution for name in PEERS} == {
        "kiss-icp",
        "small_gicp",
        "genz-icp",
        "rko_lio",
    }


def test_true_times_of_points_are_used_and_poses_are_of_the_stamp(name):
    drive, inputs = ridden(1.0, 1.5, 36)
    away_m, turned = off(name, drive, inputs)
    # Half a sweep is 0.05 m and 0.075 rad.
    assert away_m < 0.12
    assert turned < 0.015
    backward = [(replace(s, time_offset_s=-s.time_offset_s), i) for s, i in inputs]
    assert off(name, drive, backward)[1] > 0.08


def test_libraries_follow_without_the_ground(name):
    drive, inputs = ridden(1.0, 1.5, 36)
    away_m, turned = off(f"{name}?ground=false", drive, inputs)
    assert (away_m, turned) != off(name, drive, inputs)
    assert away_m < 0.3
    assert turned < 0.03


def test_follows_up_to_driving_speed(name):
    if name not in AT_SPEED:
        pytest.skip("holds on to what it saw first where little stands out of the ground")
    away_m, turned = off(name, *ridden(8.0, 0.1, 38))
    assert away_m < AT_SPEED[name]
    assert turned < 0.015


def test_rko_lio_knows_where_the_imu_is():
    if ODOMETRIES.missing("rko-lio"):
        pytest.skip(ODOMETRIES.missing("rko-lio"))
    drive, inputs = ridden(1.0, 1.5, 36)
    mounting = Pose.from_euler(1.0, -0.5, 0.3, yaw=1.0, pitch=0.2, roll=-2.0)
    felt = [(scan, moved(imu, mounting)) for scan, imu in inputs]
    there = off("rko-lio", drive, felt, mounting)
    assert there == pytest.approx(off("rko-lio", drive, inputs), abs=0.02)
    assert off("rko-lio", drive, felt)[1] > 0.1


def moved(imu, mounting):
    """Samples of an IMU that is mounted elsewhere on the same body, `lidar_from_imu`."""
    growing = np.gradient(imu.angular_velocity, imu.stamps_s, axis=0)
    pulls = [
        (hat(grows) + hat(rate) @ hat(rate)) @ mounting.translation
        for rate, grows in zip(imu.angular_velocity, growing, strict=True)
    ]
    back = mounting.rotation.T
    forces = imu.specific_force + np.array(pulls)
    return replace(
        imu, angular_velocity=imu.angular_velocity @ back.T, specific_force=forces @ back.T
    )


@pytest.mark.parametrize("name", PEERS)
def test_a_missing_package_is_named(name, monkeypatch):
    monkeypatch.setattr(Requirement, "version", None)
    with pytest.raises(NotInstalledError, match=r"not installed: pip install roadscope\[peers\]"):
        ODOMETRIES.make(name)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("kiss-icp?voxel_m=0", "voxel_m must be positive"),
        ("small-gicp?voxel_m=-1", "voxel_m must be positive"),
        ("small-gicp-scan?neighbours=2", "neighbours must be a whole number from 5 up, got 2"),
        ("genz-icp?points=0", "points must be positive"),
        ("rko-lio?voxel_m=-2", "voxel_m must be positive"),
    ],
)
def test_settings_that_make_no_sense_are_refused(spec, message):
    if ODOMETRIES.missing(spec):
        pytest.skip(ODOMETRIES.missing(spec))
    with pytest.raises(ValueError, match=message):
        ODOMETRIES.make(spec)


def test_listing_odometries_loads_no_library():
    code = (
        "import sys; from roadscope.odometry import ODOMETRIES; ODOMETRIES.installed();"
        "print({'kiss_icp', 'small_gicp', 'genz_icp', 'rko_lio', 'pydantic'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"


def test_rko_lio_prints_nothing():
    if ODOMETRIES.missing("rko-lio"):
        pytest.skip(ODOMETRIES.missing("rko-lio"))
    code = (
        "import sys; sys.path.insert(0, 'tests'); from toy_drive import driven;"
        "from roadscope.odometry import ODOMETRIES; odometry = ODOMETRIES.make('rko-lio');"
        "[odometry.update(*each) for each in driven(3)[1]]; print('done')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "done\n"
    assert not done.stderr
