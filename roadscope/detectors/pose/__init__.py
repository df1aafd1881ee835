"""Vehicle pose from a few returns: estimators on plain arrays."""

from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.matched_filter import fit_single
from roadscope.detectors.pose.multi_frame import fit_multi

__all__ = ["VehiclePose", "axis_difference", "fit_multi", "fit_single"]
