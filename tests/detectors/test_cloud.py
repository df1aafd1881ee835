import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, FRONT_M, HEIGHT_M, scan, scan_of

from roadscope.core import Pose
from roadscope.detectors import Cloud


def test_points_come_in_the_ego_frame_in_firing_order():
    sweep = scan([(25, 3, 4.6, 1.85, 1.5, 0)], ground=False)
    cloud = Cloud.of(sweep, CALIBRATION.pose("lux"))
    assert np.allclose(cloud.points, sweep.points + np.array([FRONT_M, 0, HEIGHT_M]), atol=1e-6)
    assert np.allclose(cloud.ranges, np.hypot(*sweep.points[:, :2].T), atol=1e-6)
    assert np.allclose(cloud.azimuths, np.arctan2(sweep.points[:, 1], sweep.points[:, 0]))
    assert np.array_equal(cloud.column, sweep.column)
    assert np.array_equal(cloud.select(cloud.ring == 2).rows, np.flatnonzero(sweep.ring == 2))


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([3, 40, 65536]))
def test_sorted_by_column_ring_and_place(seed, count, columns):
    """Copies and several returns of a beam included, whatever the order they came in."""
    rng = np.random.default_rng(seed)
    points = rng.integers(1, 4, (count, 3)).astype(np.float32)
    ring, column = rng.integers(0, 3, count), rng.integers(0, columns, count)
    returns = Cloud.of(scan_of(points, ring, column), Pose.identity())
    assert np.array_equal(returns.rows, np.lexsort((*points.T[::-1], ring, column)))
    assert np.array_equal(returns.points, points[returns.rows])
    assert np.array_equal(returns.column, column[returns.rows])
    selected = rng.random(count) < 0.5
    assert np.array_equal(
        returns.select(selected).rows, returns.select(np.flatnonzero(selected)).rows
    )


@given(*[st.floats(-3, 3)] * 4)
def test_points_are_mapped_as_poses_map_them(x, yaw, pitch, roll):
    sweep = scan([(25, 3, 4.6, 1.85, 1.5, 0)])
    pose = Pose.from_euler(x, -1.0, 1.7, yaw=yaw, pitch=pitch, roll=roll)
    returns = Cloud.of(sweep, pose)
    assert np.array_equal(returns.points, pose.apply(sweep.points[returns.rows].astype(float)))


def test_nothing():
    cloud = Cloud.of(scan([], ground=False), CALIBRATION.pose("lux"))
    assert len(cloud) == 0
    assert cloud.ranges.shape == cloud.azimuths.shape == (0,)
