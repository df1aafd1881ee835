"""The adapter with an artificial library."""

from dataclasses import replace

import numpy as np
import pytest
from toy_drive import driven, emptied

from roadscope.odometry import LOST
from roadscope.odometry.peers import OdometryAdapter, Placed

DRIVE, INPUTS = driven(12)


class Knowing:
    """Returns the truth at the stamp, relative to its start; `spoil` changes its poses."""

    started = 0

    def __init__(self, spoil):
        Knowing.started += 1
        self.spoil, self.given, self.first = spoil, [], None

    def place(self, scan):
        self.given.append(scan)
        pose = DRIVE.pose(scan.stamp_s)
        self.first = pose if self.first is None else self.first
        pose = np.linalg.inv(self.first) @ pose
        return Placed(self.spoil(pose, scan.stamp_s), scan.stamp_s)


class InertialAdapter(OdometryAdapter):
    takes_imu = True


@pytest.fixture(autouse=True)
def counted():
    Knowing.started = 0


def adapter(spoil=lambda pose, _: pose):
    return OdometryAdapter(lambda _: Knowing(spoil))


def far(estimate, k):
    return np.abs(estimate.start_from_lidar.matrix - DRIVE.pose(INPUTS[k][0].stamp_s)).max()


def test_the_truth_passes_through():
    runs = adapter()
    for k, (scan, imu) in enumerate(INPUTS):
        estimate = runs.update(scan, imu)
        assert estimate.ok
        # Adapters' clocks begin at 0, this drive at 0.05 s.
        assert np.linalg.norm(estimate.start_from_lidar.translation) == pytest.approx(
            np.linalg.norm(DRIVE.pose(scan.stamp_s)[:3, 3]), abs=1e-6
        ), k


def test_poor_and_late_scans_do_not_reach_the_library():
    runs = adapter()
    for scan, imu in INPUTS[:4]:
        runs.update(scan, imu)
    library = runs._library
    assert "0 points" in runs.update(emptied(INPUTS[4][0]), None).reason
    assert "repeats the last" in runs.update(emptied(INPUTS[4][0]), None).reason
    assert "before it" in runs.update(INPUTS[2][0], None).reason
    assert len(library.given) == 4
    estimate = runs.update(*INPUTS[5])
    assert estimate.ok
    assert library.given[-1].elapsed_s == pytest.approx(0.2)
    assert runs._library is library


def raising(pose, stamp_s):
    if stamp_s > 0.45:
        raise RuntimeError("too\n few  points")
    return pose


def test_a_library_that_refuses_scans_is_restarted():
    runs = adapter(raising)
    reasons = [runs.update(scan, imu).reason for scan, imu in INPUTS]
    assert reasons[:5] == [""] * 5
    assert set(reasons[5:]) == {"refused: too few points"}
    assert Knowing.started == 1 + (len(INPUTS) - 5) // LOST


@pytest.mark.parametrize(
    ("bad", "message"), [(np.nan, "not finite"), (1e3, "not the speed of a vehicle")]
)
def test_impossible_poses_are_rejected(bad, message):
    runs = adapter(lambda pose, s: pose + bad * np.eye(4, k=3) if 0.45 < s < 0.55 else pose)
    estimates = [runs.update(scan, imu) for scan, imu in INPUTS]
    assert message in estimates[5].reason
    assert estimates[6].reason == "the library was restarted"
    assert all(each.ok for each in estimates[7:])
    assert max(np.linalg.norm(each.start_from_lidar.translation) for each in estimates) < 10


def test_a_jump_of_speed_is_reported():
    back = np.eye(4)
    back[0, 3] = -0.8
    runs = adapter(lambda pose, s: pose @ back if s > 0.45 else pose)
    estimates = [runs.update(scan, imu) for scan, imu in INPUTS]
    assert "the speed jumps by 8 m/s" in estimates[5].reason
    assert all(each.ok for k, each in enumerate(estimates) if k != 5)


def test_samples_are_passed_on_once_on_the_adapters_clock():
    runs = adapter()
    shifted = [
        (replace(s, stamp_s=s.stamp_s + 1e6), replace(i, stamps_s=i.stamps_s + 1e6))
        for s, i in INPUTS
    ]
    for scan, imu in shifted:
        runs.update(scan, imu)
        runs.update(scan, imu)
    stamps = np.concatenate([library_input.imu.stamps_s for library_input in runs._library.given])
    assert len(stamps) == sum(len(i.stamps_s) for _, i in INPUTS)
    assert (np.diff(stamps) > 0).all()
    ends = [
        library_input.stamp_s + library_input.after_s.max() for library_input in runs._library.given
    ]
    last = [library_input.imu.stamps_s[-1] for library_input in runs._library.given]
    assert np.abs(np.subtract(ends, last)).max() < 0.005


def test_missing_samples_are_reported_if_the_library_uses_them():
    for kind, reason in ((InertialAdapter, "no inertial samples"), (OdometryAdapter, "")):
        runs = kind(lambda _: Knowing(lambda pose, _: pose))
        estimates = [runs.update(s, None if k in (4, 5) else i) for k, (s, i) in enumerate(INPUTS)]
        # The sweep before the first scan with samples again reached beyond its stamp.
        assert [each.reason for each in estimates[3:8]] == ["", reason, reason, reason, ""]
    runs = InertialAdapter(lambda _: Knowing(lambda pose, _: pose))
    assert all(runs.update(scan, None).ok for scan, _ in INPUTS)


def test_the_ground_is_left_out_on_request():
    def shown(ground):
        library = Knowing(lambda pose, _: pose)
        runs = OdometryAdapter(lambda _: library, ground=ground)
        runs.update(*INPUTS[0])
        return library.given[0].points

    whole, above = shown(True), shown(False)
    assert len(whole) == len(INPUTS[0][0])
    assert 60 < len(above) < len(whole)
    assert above[:, 2].min() > whole[:, 2].min() + 0.1
