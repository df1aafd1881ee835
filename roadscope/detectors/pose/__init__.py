"""Vehicle pose from a few returns: estimators on plain arrays."""

from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.matched_filter import fit_single
from roadscope.detectors.pose.multi_frame import fit_multi
from roadscope.detectors.pose.ransac import fit_ransac

__all__ = ["VehiclePose", "axis_difference", "fit_multi", "fit_ransac", "fit_single"]
