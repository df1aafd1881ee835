"""A body's rays are found among the columns about it as among all of the scan."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan

from roadscope.core import Pose
from roadscope.detectors.long_range_body import BUDGET, Shot
from roadscope.detectors.moving.lidar import lidar_of
from roadscope.detectors.moving.view import View
from roadscope.detectors.pose.body_rays import sight
from roadscope.detectors.pose.body_sight_kernels import returns_about

FIGURES = {"range_noise_m": 0.02, "range_max_m": 100.0, "detection_limit": 0.4}
CAR = (4.6, 1.85, 1.5)


@pytest.mark.parametrize("first_deg", [-180.0, 0.0, 30.0])
@given(y=st.integers(-80, 80), yaw=st.integers(-300, 300), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_the_columns_about_a_body_tell_all(first_deg, y, yaw, seed) -> None:
    """Also of a body at the seam of the sweep."""
    azimuths = np.radians(first_deg + np.arange(0.0, 360.0, 0.5))
    boxes = [(15.0, y / 10, *CAR, yaw / 100), (20, -12, 30, 0.4, 3.0, 0.0)]
    beams = np.arange(-8.0, 1.4, 1.33)
    seen = scan(boxes, noise_m=0.02, seed=seed, elevations=beams, azimuths=azimuths)
    mount = CALIBRATION.pose(seen.sensor)
    places = mount.apply(seen.points)
    own = (np.hypot(*(places[:, :2] - [15.0, y / 10]).T) < 2.6) & (places[:, 2] > 0.2)
    spec = lidar_of(seen, **FIGURES)
    assert own.any()
    assert spec is not None
    shot = Shot.of(seen, View.of(seen, mount, np.zeros(3)), Pose.identity(), mount, spec)
    ordered = shot.order, shot.columns
    part, _ = returns_about(shot.returns, ordered, np.flatnonzero(own), spec.columns)
    assert len(part.ring) < len(seen) / 2
    few = shot.sighting(np.flatnonzero(own), 0.0)
    whole = sight(spec, seen, own, mount, budget=BUDGET)
    for one, other in zip(few.rays, whole.rays, strict=True):
        assert np.array_equal(one, other)
