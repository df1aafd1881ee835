"""Whatever comes in, every odometry tells what is wrong, and soon follows again."""

import copy
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from toy_drive import ToyDrive, columns_for, emptied

from roadscope.core import ImuSamples
from roadscope.odometry import NO_SAMPLES, ODOMETRIES

READ_NO_SCANS = {"still", "dead-reckoning"}
"""What they tell does not depend on points."""
SPEED_M_S = 8.0
FROM_REST_S = {"rko-lio": 3.0}
"""Those that do not find a start at speed get so long to come to it."""
MAPPED = {"zhang2022-map", "zhang2022-loop"}
"""Their map corrects at times what steps have gathered: a step towards the truth is no error."""
UNGUARDED = MAPPED | {"zhang2022"}
"""The paper's method has no remedy for a wrong speed: it reports it, but need not recover."""
FIRST, LAST, SCANS, SETTLED = 10, 13, 26, 5
"""Which scans are spoilt, how many there are, how many at the end have to be right."""
WRONG_M, WRONG_RAD = 0.5, 0.1
"""A step that is further off than this, of 0.8 m from scan to scan, has to be reported."""
RIGHT_M, RIGHT_RAD = 0.05, 0.01
"""In the end no step is further off than this, or by more than a quarter more than it ever is
on undisturbed scans: these are coarse, and an odometry that matches few features of them errs."""
FEEL = {
    "dead-reckoning",
    "lidar-inertial",
    "voxel-map",
    "zhang2022",
    "zhang2022-guarded",
    "zhang2022-map",
    "zhang2022-loop",
    "loam",
    "lego-loam",
    "lego-loam-loop",
}
"""They tell when an inertial unit that was there falls silent or sends what is no number."""
TELL_ALONG = {"lidar-inertial"}
"""They are right, by the inertial unit, where all that is seen moves along, and yet tell it."""


@pytest.fixture(params=ODOMETRIES.names())
def name(request):
    if ODOMETRIES.missing(request.param):
        pytest.skip(ODOMETRIES.missing(request.param))
    return request.param


def drive_of(name):
    """A drive that is at speed from the first spoilt scan on, and the number of that scan."""
    ramp_s = FROM_REST_S.get(name, 0.0)
    drive = ToyDrive(SPEED_M_S, ramp_s=ramp_s, columns=columns_for(name))
    return drive, FIRST + round(10 * ramp_s)


def inputs_of(name, scans=SCANS):
    drive, first = drive_of(name)
    return taken(drive.ramp_s, drive.columns, scans + first - FIRST)


@cache
def taken(ramp_s, columns, scans):
    """Scans with their samples, which tests leave alone."""
    drive = ToyDrive(SPEED_M_S, ramp_s=ramp_s, columns=columns)
    return [(drive.scan(k), drive.imu(k)) for k in range(scans)]


def no_numbers(scan):
    spoilt = copy.deepcopy(scan)
    spoilt.points[:] = np.nan
    return spoilt


def along(scan, first):
    """All that is seen moves along with the sensor."""
    return replace(first, stamp_s=scan.stamp_s)


def loud(scan, first):
    """Ten times the noise of a VLP-16."""
    rng = np.random.default_rng(round(100 * scan.stamp_s))
    ranges = np.linalg.norm(scan.points, axis=1, keepdims=True)
    spoilt = copy.deepcopy(scan)
    spoilt.points[:] = scan.points * (1 + rng.normal(0, 0.3, ranges.shape) / ranges)
    return spoilt


SPOILT = {
    "empty": lambda scan, _: emptied(scan),
    "one ring": lambda scan, _: scan.select(scan.ring == 8),
    "few points": lambda scan, _: scan.select(np.arange(len(scan)) % 400 == 0),
    "no numbers": lambda scan, _: no_numbers(scan),
    "all dynamic": along,
    "loud": loud,
    "same stamp": lambda scan, first: replace(scan, stamp_s=first.stamp_s),
    "backward": lambda scan, first: replace(scan, stamp_s=first.stamp_s - 0.8),
}
TOLD = {"empty", "one ring", "few points", "no numbers", "loud", "same stamp", "backward"}
"""These scans tell nothing, or by far less than they should, so that they are degraded however good
a guess was."""


def steps(poses):
    """Motions from each pose to the next."""
    return [np.linalg.inv(one) @ other for one, other in pairwise(poses)]


def errors_of(estimates, truth):
    """(K, 2) metres and radians between each estimated step and the true one."""
    rest = [np.linalg.inv(b) @ a for a, b in zip(steps(estimates), steps(truth), strict=True)]
    turns = [np.arccos(np.clip((np.trace(m[:3, :3]) - 1) / 2, -1, 1)) for m in rest]
    return np.column_stack([[np.linalg.norm(m[:3, 3]) for m in rest], turns])


def run_with_errors(name, inputs):
    """Return the estimates and each step's error, without scans whose stamps do not advance."""
    odometry, (drive, _) = ODOMETRIES.make(name), drive_of(name)
    reported_estimates = [odometry.update(scan, imu) for scan, imu in inputs]
    poses = np.array([each.start_from_lidar.matrix for each in reported_estimates])
    assert np.isfinite(poses).all()
    assert all(np.isfinite(each.covariance).all() for each in reported_estimates)
    latest = np.maximum.accumulate([scan.stamp_s for scan, _ in inputs])
    truth = np.array([drive.pose(stamp_s) for stamp_s in latest])
    off = errors_of(poses, truth)
    if name in MAPPED:
        off[np.diff(np.linalg.norm((poses - truth)[:, :3, 3], axis=1)) < 0] = 0.0
    return reported_estimates, off


@cache
def unspoilt(name):
    """The most metres and radians that a step is off in a drive without faults."""
    most = run_with_errors(name, inputs_of(name))[1][drive_of(name)[1] // 2 :].max(axis=0)
    assert (most < [0.3, 0.03]).all(), most
    return most


def check_reported_and_recovered(name, estimates, off):
    first = drive_of(name)[1]
    wrong = (off[:, 0] > WRONG_M) | (off[:, 1] > WRONG_RAD)
    silent = [k + 1 for k in np.flatnonzero(wrong) if estimates[k + 1].ok and k + 1 >= first]
    assert not silent, f"steps {silent} are off by {off[np.array(silent) - 1].round(2).tolist()}"
    if name in UNGUARDED:
        return
    assert all(each.ok for each in estimates[-SETTLED:])
    most = np.maximum([RIGHT_M, RIGHT_RAD], 1.25 * unspoilt(name))
    assert (off[-SETTLED:] < most).all(), (off[-SETTLED:].max(axis=0), most)


VARIANTS = {
    "scan-to-scan",
    "zhang2022-map",
    "zhang2022-loop",
    "loam",
    "lego-loam-loop",
    "small-gicp-scan",
}
"""They read scans as others do: two kinds of spoilt ones show that they go on."""
OF_VARIANTS = {"all dynamic", "same stamp"}


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("name", "kind"),
    [(n, k) for n in ODOMETRIES.names() for k in SPOILT if n not in VARIANTS or k in OF_VARIANTS],
    indirect=["name"],
)
def test_spoilt_scans_are_reported_and_recovered_from(name, kind):
    inputs, first = inputs_of(name), drive_of(name)[1]
    last = first + LAST - FIRST
    disturbed_inputs = [
        (SPOILT[kind](s, inputs[first][0]) if first <= k < last else s, i)
        for k, (s, i) in enumerate(inputs)
    ]
    reported_estimates, off = run_with_errors(name, disturbed_inputs)
    if name in READ_NO_SCANS:
        return
    if kind in TOLD or (kind == "all dynamic" and name in TELL_ALONG):
        # The first of those with the same stamp, or the same view, is the scan itself.
        first_reported = first + (kind in ("same stamp", "all dynamic"))
        assert not any(each.ok for each in reported_estimates[first_reported:last])
    check_reported_and_recovered(name, reported_estimates, off)


@pytest.mark.sampled(1)
def test_a_lost_second_is_reported_and_recovered_from(name):
    inputs, first = inputs_of(name, SCANS + 10), drive_of(name)[1]
    reported_estimates, off = run_with_errors(name, inputs[:first] + inputs[first + 10 :])
    assert not reported_estimates[first].ok
    if name not in READ_NO_SCANS:
        check_reported_and_recovered(name, reported_estimates, off)


NOTHING = ImuSamples(np.empty(0), np.empty((0, 3)), np.empty((0, 3)))


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        (name, kind)
        for name in ODOMETRIES.names()
        for kind in ("gap", "none", "no numbers", "backward")
        if name not in VARIANTS or kind == "gap"
    ],
    indirect=["name"],
)
def test_a_faulty_imu_is_recovered_from(name, kind):
    inputs, first = inputs_of(name), drive_of(name)[1]
    last = first + LAST - FIRST
    disturbed_inputs = [
        (s, spoilt_imu(i, kind) if first <= k < last else i) for k, (s, i) in enumerate(inputs)
    ]
    reported_estimates, off = run_with_errors(name, disturbed_inputs)
    if name in FEEL and kind != "none":
        assert any(each.reason == NO_SAMPLES for each in reported_estimates[first:last])
    if name not in READ_NO_SCANS:
        check_reported_and_recovered(name, reported_estimates, off)


def spoilt_imu(imu, kind):
    spoilt = copy.deepcopy(imu)
    spoilt.angular_velocity[:] = np.nan
    backward = replace(imu, stamps_s=imu.stamps_s[::-1])
    return {"gap": NOTHING, "none": None, "no numbers": spoilt, "backward": backward}[kind]
