"""Vehicle pose from a few returns: on plain arrays, and on whole scans with all their rays."""

from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_model import BodyModel, BodySection, saloon
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.pose.smoother import Smoother

__all__ = [
    "BodyFit",
    "BodyModel",
    "BodySection",
    "Smoother",
    "VehiclePose",
    "axis_difference",
    "fit_multi",
    "fit_ransac",
    "fit_single",
    "saloon",
]
