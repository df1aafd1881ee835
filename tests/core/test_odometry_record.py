"""What an odometry's estimate refuses."""

import numpy as np
import pytest

from roadscope.core import OdometryEstimate, OdometryStatus, Pose, RecordError

WHOLE = (Pose.identity(), np.eye(6), np.zeros(3, bool), 0.1)


def test_is_sure_unless_it_says_why_not():
    assert OdometryEstimate(*WHOLE).ok
    lost = OdometryEstimate(*WHOLE, OdometryStatus.DEGRADED, "an empty scan")
    assert not lost.ok
    with pytest.raises(RecordError, match="reason"):
        OdometryEstimate(*WHOLE, OdometryStatus.DEGRADED)
    with pytest.raises(RecordError, match="reason"):
        OdometryEstimate(*WHOLE, reason="for nothing")


@pytest.mark.parametrize("variance", [0.0, 1e-12, 1e6])
def test_takes_any_variance_from_zero_up(variance):
    pose, _, dynamic, stamp_s = WHOLE
    assert OdometryEstimate(pose, variance * np.eye(6), dynamic, stamp_s).ok


@pytest.mark.parametrize(
    "covariance", [np.full((6, 6), np.nan), -np.eye(6), np.triu(np.ones((6, 6))), np.eye(3)]
)
def test_refuses_what_is_no_covariance(covariance):
    pose, _, dynamic, stamp_s = WHOLE
    with pytest.raises(RecordError, match=r"OdometryEstimate\.covariance"):
        OdometryEstimate(pose, covariance, dynamic, stamp_s)
