"""Every registered odometry: the contract of all odometries, and laws of ours."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from toy_drive import columns_for, driven, emptied, offset

from roadscope.core import Pose
from roadscope.odometry import ODOMETRIES
from roadscope.testing import PromiseError, contract_items

READ_NO_SCANS = {"still", "dead-reckoning"}
"""They look at stamps only, so that a poor scan does them no harm."""
FOLLOW = {
    "scan-to-scan": (0.5, 0.02),
    "voxel-map": (0.1, 0.01),
    "kiss-icp": (1.3, 0.03),
    "small-gicp-scan": (0.3, 0.02),
    "small-gicp": (0.3, 0.02),
    "genz-icp": (0.3, 0.02),
    "rko-lio": (0.5, 0.02),
    "lego-loam": (0.4, 0.02),
    "lego-loam-loop": (0.4, 0.02),
    "zhang2022": (0.5, 0.03),
    "zhang2022-guarded": (0.5, 0.03),
    "zhang2022-map": (0.5, 0.03),
    "zhang2022-loop": (0.5, 0.03),
    "loam": (1.0, 0.06),
    "lidar-inertial": (0.1, 0.01),
}
"""How far off, in metres and radians, those that look may be after a dozen scans, 9 m."""
KNOWS_SPEED = {"lidar-inertial": 3}
"""Those that call themselves degraded until they know the speed, and the scan by which they do."""
SLOW_M_S = {"rko-lio": 1.0, "zhang2022": 1.0, "zhang2022-map": 1.0, "zhang2022-loop": 1.0}
"""Those that do not find a start at speed are driven slowly."""
SETTINGS = {"scan-to-scan", "zhang2022-guarded", "loam"}
"""Classes with other settings, which keep the promises that the class keeps."""
UNEVEN = {"genz-icp"}
"""Their threads add up in any order, so that the same input gives poses some millimetres apart."""


@pytest.fixture(params=ODOMETRIES.names())
def name(request):
    if ODOMETRIES.missing(request.param):
        pytest.skip(ODOMETRIES.missing(request.param))
    return request.param


@pytest.fixture
def odometry(name):
    return ODOMETRIES.make(name)


def drive_for(name, scans=12):
    return driven(scans, SLOW_M_S.get(name, 8.0), columns_for(name))


def run(odometry, inputs):
    return [odometry.update(scan, imu) for scan, imu in inputs]


def check_finite(estimates):
    for estimate in estimates:
        matrix = estimate.start_from_lidar.matrix
        assert np.isfinite(matrix).all()
        assert np.abs(matrix[:3, :3] @ matrix[:3, :3].T - np.eye(3)).max() < 1e-9
        assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1)
        assert np.isfinite(estimate.covariance).all()
        assert np.linalg.eigvalsh(estimate.covariance)[0] > -1e-9 * (1 + estimate.covariance.max())


def promised(name):
    """Return the promises of an odometry but those that it cannot keep."""
    *items, figure = contract_items(name)
    if name in UNEVEN:
        items = [item for item in items if not {"same", "reset"} & set(item.promise.words.split())]
    promises = [] if name in SETTINGS else items
    return promises if name in READ_NO_SCANS | set(SLOW_M_S) else [*promises, figure]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "item", [item for name in ODOMETRIES.installed() for item in promised(name)], ids=str
)
def test_contract(item):
    item.verify()


@pytest.mark.parametrize("name", sorted(UNEVEN), indirect=True)
def test_reset_forgets_what_is_no_rounding(odometry):
    """The contract asks for equality, which these cannot keep."""
    _, inputs = driven(6)
    first = run(odometry, inputs)
    run(odometry, driven(4, 3.0)[1])
    odometry.reset()
    for one, other in zip(run(odometry, inputs), first, strict=True):
        difference = one.start_from_lidar.matrix - other.start_from_lidar.matrix
        assert np.abs(difference).max() < 0.02


@pytest.mark.parametrize("name", sorted(READ_NO_SCANS))
def test_the_contract_refuses_the_figure_of_what_reads_no_scan(name):
    with pytest.raises(PromiseError):
        contract_items(name)[-1].verify()


@pytest.mark.sampled(3)
def test_follows_a_drive(name, odometry):
    if name not in FOLLOW:
        pytest.skip("does not look at scans")
    drive, inputs = drive_for(name)
    reported_estimates = run(odometry, inputs)
    away_m, turned = offset(reported_estimates[-1], drive.pose(inputs[-1][0].stamp_s))
    assert all(each.ok for each in reported_estimates[KNOWS_SPEED.get(name, 0) :])
    assert away_m < FOLLOW[name][0]
    assert turned < FOLLOW[name][1]


@pytest.mark.sampled(4)
def test_takes_the_mounting_of_the_imu(name, odometry):
    _, inputs = driven(8)
    turned = Pose.from_euler(0, 0, 0, yaw=1.0, pitch=0.2, roll=-2.0)
    turn = turned.inverse().apply
    mounted = [
        (
            scan,
            replace(
                imu,
                angular_velocity=turn(imu.angular_velocity),
                specific_force=turn(imu.specific_force),
            ),
        )
        for scan, imu in inputs
    ]
    level = run(odometry, inputs)
    odometry.reset(turned)
    for one, other in zip(level, run(odometry, mounted), strict=True):
        same = np.abs(one.start_from_lidar.matrix - other.start_from_lidar.matrix)
        assert same.max() < (0.02 if name in UNEVEN else 1e-3)


POOR = {"empty": emptied, "few points": lambda scan: scan.select(np.arange(len(scan)) % 400 == 0)}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", POOR)
def test_a_poor_first_scan_is_survived(name, odometry, kind):
    _, inputs = drive_for(name, 8)
    reported_estimates = run(odometry, [(POOR[kind](inputs[0][0]), inputs[0][1]), *inputs[1:]])
    check_finite(reported_estimates)
    if name not in READ_NO_SCANS:
        assert [reported_estimates[0].ok, reported_estimates[-1].ok] == [False, True]


@pytest.mark.sampled(4)
def test_points_that_are_no_numbers_are_passed_over(odometry):
    _, inputs = driven(6)
    spoilt = copy.deepcopy(inputs)
    for scan, _ in spoilt:
        scan.points[::7] = np.nan
        scan.points[3::11] = np.inf
    check_finite(run(odometry, spoilt))
    spoilt[-1][0].points[:] = np.nan
    check_finite(run(odometry, spoilt))


@pytest.mark.sampled(3)
def test_a_stamp_that_is_no_number_is_reported(name, odometry):
    drive, inputs = drive_for(name)
    again = replace(inputs[5][0], stamp_s=float("nan"))
    reported_estimates = run(odometry, [*inputs[:6], (again, None), *inputs[6:]])
    check_finite(reported_estimates)
    assert not reported_estimates[6].ok
    assert reported_estimates[-1].ok
    if name not in READ_NO_SCANS:
        assert (
            offset(reported_estimates[-1], drive.pose(inputs[-1][0].stamp_s))[0] < FOLLOW[name][0]
        )


def test_a_dropped_second_is_made_up_for():
    """Others: `test_odometry_recovery.py`, as for scans and samples spoilt in a drive."""
    drive, inputs = drive_for("voxel-map", 26)
    reported_estimates = run(ODOMETRIES.make("voxel-map"), inputs[:6] + inputs[16:])
    assert offset(reported_estimates[-1], drive.pose(inputs[-1][0].stamp_s))[0] < 0.3
