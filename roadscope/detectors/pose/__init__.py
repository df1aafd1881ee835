"""Vehicle pose from a few returns: on plain arrays, and on whole scans with all their rays."""

from roadscope._lazy import lazy_names
from roadscope.detectors.pose.body_fit import BodyFit
from roadscope.detectors.pose.body_model import BodyModel, BodySection, SizePrior, saloon
from roadscope.detectors.pose.estimate import VehiclePose, axis_difference
from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
from roadscope.detectors.pose.ransac import fit_ransac
from roadscope.detectors.pose.smoother import Smoother

__all__ = [
    "BodyFit",
    "BodyModel",
    "BodySection",
    "SizePrior",
    "Smoother",
    "VehiclePose",
    "axis_difference",
    "fit_multi",
    "fit_ransac",
    "fit_single",
    "saloon",
]

_PARTS = {
    "body_fit": "TURN_SD likely_modes with_glass",
    "body_likelihood": "EXACTLY_DRAWN ROUGHLY_DRAWN ray_fits",
    "body_model": "GLASS MOTION RADIUS VALUES fill_outlines new_outlines part_of",
    "body_rays": "BodyRays EMPTY HIT PASSED body_scan",
    "body_search": "BodyProblem split_rays",
    "estimate": "pointing_away checked_origin checked_points",
    "filter_kernels": "peak",
    "ransac": "with_corner",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
