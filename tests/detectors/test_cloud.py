import numpy as np
from toy_lidar import CALIBRATION, FRONT_M, HEIGHT_M, scan

from roadscope.detectors.cloud import Cloud


def test_points_come_in_the_ego_frame_in_firing_order():
    found = scan([(25, 3, 4.6, 1.85, 1.5, 0)], ground=False)
    cloud = Cloud.of(found, CALIBRATION.pose("lux"))
    assert np.allclose(cloud.points, found.points + np.array([FRONT_M, 0, HEIGHT_M]), atol=1e-6)
    assert np.allclose(cloud.ranges, np.hypot(*found.points[:, :2].T), atol=1e-6)
    assert np.allclose(cloud.azimuths, np.arctan2(found.points[:, 1], found.points[:, 0]))
    assert np.array_equal(cloud.column, found.column)
    assert np.array_equal(cloud.select(cloud.ring == 2).rows, np.flatnonzero(found.ring == 2))


def test_nothing():
    cloud = Cloud.of(scan([], ground=False), CALIBRATION.pose("lux"))
    assert len(cloud) == 0
    assert cloud.ranges.shape == cloud.azimuths.shape == (0,)
