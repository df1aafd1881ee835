"""Vehicle pose from a few returns: estimators on plain arrays."""

from roadscope.detectors.pose.estimate import VehiclePose, axis_difference

__all__ = ["VehiclePose", "axis_difference"]
