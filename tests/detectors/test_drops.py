"""Every detector takes faint near returns for drops."""

import numpy as np
import pytest
from toy_lidar import CALIBRATION, scan_of

from roadscope.core import Frame
from roadscope.detectors import DROPS_M, ClusterDetector, LongRangeDetector, without_faint


def test_faint_returns_go_when_near_and_all_else_stays():
    points = np.array([[3.0, 0, 0], [3.0, 1, 0], [DROPS_M + 0.1, 0, 0], [-9.0, -9.0, 1]])
    scan = scan_of(points, intensity=[0.005, 0.5, 0.005, 0.009])
    left = without_faint(scan, 0.01)
    assert np.array_equal(left.points, scan.points[1:3])
    assert left.column.tolist() == [1, 2]
    assert without_faint(scan, 0.0) is scan


def test_a_lidar_without_intensities_shows_no_drops():
    scan = scan_of([[3.0, 0, 0], [4.0, 1, 0]], intensity=0.0)
    assert without_faint(scan, 0.01) is scan


def test_an_intensity_that_was_rounded_to_0_is_kept():
    scan = scan_of([[3.0, 0, 0], [4.0, 1, 0], [5.0, 0, 0]], intensity=[0.0, 0.4, 0.005])
    assert without_faint(scan, 0.01).column.tolist() == [0, 1]


@pytest.mark.parametrize("detector", [ClusterDetector, LongRangeDetector])
def test_a_share_of_the_brightness_is_asked_for(detector):
    with pytest.raises(ValueError, match=r"faint must be at least 0 and below 1, got 1\.5"):
        detector(faint=1.5)


def test_moving_objects_are_searched_without_drops():
    """A cloud of drops that comes nearer is a vehicle unless it is left out."""
    rng = np.random.default_rng(3)
    shape = rng.uniform((-2, -0.9, -1.4), (2, 0.9, 0.1), (200, 3))
    far = np.column_stack([np.full(400, 40.0), np.linspace(-30, 30, 400), np.full(400, -0.5)])
    detections_by_limit = {}
    for faint in (0.0, 0.01):
        detector, total = LongRangeDetector(faint=faint), 0
        for k in range(8):
            near = shape + np.array([12.0 - 0.6 * k, 0, 0])
            points = np.concatenate([far, near])
            intensity = np.repeat([0.4, 0.005], [400, 200])
            sweep = scan_of(points, stamp_s=1 + k / 10, intensity=intensity)
            total += len(detector.detect(Frame(sweep.stamp_s, CALIBRATION, sweep)))
        detections_by_limit[faint] = total
    assert detections_by_limit[0.0] > 0
    assert detections_by_limit[0.01] == 0
