"""LiDARs whose x axis does not point ahead, without the command line."""

from dataclasses import replace

import numpy as np
import pytest
from toy_drive import ToyDrive, driven

from roadscope.core import ImuSamples, Pose
from roadscope.odometry import ODOMETRIES, MountedOdometry, Odometry, turned_scan

SCANS = 30
TRUTH = [Pose(ToyDrive().pose(0.05 + 0.1 * k)) for k in range(SCANS)]


def lidar_from_ahead(degrees: float) -> Pose:
    return Pose.from_euler(0, 0, 0, yaw=np.deg2rad(degrees))


def measured(mount: Pose, count: int = SCANS):
    """Scans and samples of a drive, in the axes of a LiDAR that is mounted otherwise."""
    return [
        (
            turned_scan(scan, mount.rotation),
            ImuSamples(
                imu.stamps_s,
                imu.angular_velocity @ mount.rotation.T,
                imu.specific_force @ mount.rotation.T,
            ),
        )
        for scan, imu in driven(count)[1]
    ]


@pytest.mark.parametrize("degrees", [30, 90, 180, -90])
def test_poses_are_degraded_until_the_direction_is_known_and_right_then(degrees):
    mount, odometry = lidar_from_ahead(degrees), MountedOdometry()
    assert isinstance(odometry, Odometry)
    odometry.reset()
    estimates = [odometry.update(*each) for each in measured(mount)]
    known = [each.ok for each in estimates]
    first = known.index(True)
    assert not any(known[:first])
    assert all("direction of travel" in each.reason for each in estimates[:first])
    assert first < 20
    assert all(known[first:])
    # In the LiDAR's own axes, from the first scan on.
    truth = mount @ TRUTH[-1] @ mount.inverse()
    assert estimates[-1].start_from_lidar.translation == pytest.approx(truth.translation, abs=0.4)
    odometry.reset()
    assert not odometry.update(*measured(mount, 1)[0]).ok


def test_a_known_mounting_gives_the_poses_of_a_lidar_with_x_ahead():
    mount = Pose.from_euler(0, 0, 0, roll=np.deg2rad(90), yaw=np.deg2rad(40)).inverse()
    plain, mounted = (
        ODOMETRIES.make("lidar-inertial"),
        MountedOdometry(ahead_from_lidar=mount.inverse()),
    )
    for (scan, imu), turned in zip(driven(10)[1], measured(mount, 10), strict=True):
        one, other = plain.update(scan, imu), mounted.update(*turned)
        expected = (mount @ one.start_from_lidar @ mount.inverse()).matrix
        assert other.start_from_lidar.matrix == pytest.approx(expected, abs=0.01)
        assert other.reason == one.reason


def test_the_imu_is_mounted_in_the_axes_of_the_lidar():
    """A unit whose axes are those of the vehicle, on a LiDAR that looks to the left."""
    mount = lidar_from_ahead(90)
    mounted = MountedOdometry(ahead_from_lidar=mount.inverse())
    mounted.reset(mount)
    for (scan, imu), (turned, _) in zip(driven(10)[1], measured(mount, 10), strict=True):
        last = mounted.update(turned, imu)
        assert len(last.dynamic) == len(scan)
    truth = mount @ TRUTH[9] @ mount.inverse()
    assert last.start_from_lidar.translation == pytest.approx(truth.translation, abs=0.2)


def test_a_standing_lidar_does_not_know_where_ahead_is():
    (scan, _), odometry = driven(1)[1][0], MountedOdometry(odometry="voxel-map")
    for k in range(15):
        last = odometry.update(replace(scan, stamp_s=0.05 + 0.1 * k))
        assert "direction of travel" in last.reason
    assert last.start_from_lidar.translation == pytest.approx([0, 0, 0], abs=0.1)
