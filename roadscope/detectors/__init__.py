"""Detectors by name."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.detectors.api import Detector

if TYPE_CHECKING:
    from roadscope.detectors.camera import CAMERA_DETECTORS
    from roadscope.detectors.pose.body_fit import BodyFit
    from roadscope.detectors.pose.body_model import BodyModel, BodySection, SizePrior, saloon
    from roadscope.detectors.pose.estimate import VehiclePose
    from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
    from roadscope.detectors.pose.ransac import fit_ransac
    from roadscope.detectors.pose.smoother import Smoother

# The residual variants leave out outlines that depart from their lines by more than 0.12 m. A face
# that only one layer of the LUX meets shows its whole range noise of 0.10 m. The limit was chosen
# on seeds from 10000 up.
# Those with `min_score` keep detections that are more probably right than wrong. `faint` leaves out
# returns fainter than those of black rubber at 11 degrees.
DETECTORS: Registry[Detector] = Registry(
    "detector",
    {
        "cluster": "roadscope.detectors.pipeline:ClusterDetector",
        "pag": "roadscope.detectors.pipeline:ClusterDetector?clustering=pag",
        "pag-range": "roadscope.detectors.pipeline:ClusterDetector?clustering=pag-range",
        "distance": "roadscope.detectors.pipeline:ClusterDetector?clustering=distance",
        "breakpoint": "roadscope.detectors.pipeline:ClusterDetector?clustering=breakpoint",
        "pag-residual": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=pag&residual_m=0.12",
        "pag-range-residual": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=pag-range&residual_m=0.12",
        "distance-residual": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&residual_m=0.12",
        "distance-lines": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&min_score=0.5&exclusive=True&faint=0.01",
        "distance-rectangle": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&shape=rectangle&min_score=0.5&exclusive=True&faint=0.01",
        "distance-l-shape": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&shape=l-shape&min_score=0.5&exclusive=True&faint=0.01",
        "distance-filter": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&shape=matched-filter&min_score=0.5&exclusive=True&faint=0.01",
        "distance-body": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=distance&shape=body&min_score=0.5&exclusive=True&faint=0.01",
        "dbscan-l-shape": "roadscope.detectors.pipeline:ClusterDetector?ground=polar"
        "&clustering=dbscan&shape=l-shape&min_score=0.5&exclusive=True&faint=0.01",
        "range-angle-filter": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=range-angle&shape=matched-filter&min_score=0.5&exclusive=True&faint=0.01",
        "cluster-boxes": "roadscope.fusion.cluster_boxes:ClusterBoxes",
        "one-cluster": "roadscope.detectors.pipeline:ClusterDetector"
        "?clustering=one&shape=rectangle",
        "zhang2017": "roadscope.detectors.long_range:LongRangeDetector?fit=single&faint=0.01",
        "zhang2017-multi": "roadscope.detectors.long_range:LongRangeDetector"
        "?fit=multi&late=True&faint=0.01",
        "zhang2017-multi-causal": "roadscope.detectors.long_range:LongRangeDetector"
        "?fit=multi&faint=0.01",
        "zhang2017-ransac": "roadscope.detectors.long_range:LongRangeDetector"
        "?fit=ransac&faint=0.01",
        "long-range": "roadscope.detectors.long_range:LongRangeDetector?fit=body&faint=0.01",
    },
    group="roadscope.detectors",
    composition="cluster?ground=G&clustering=C&shape=S, see roadscope list stages",
    summaries={
        "cluster": "Any ground, clustering and shape; by default pag's.",
        "pag": "PAG clusters and lines of their outlines (Lu 2018).",
        "pag-range": "pag with returns weighted by range; ours.",
        "distance": "Clusters by a fixed distance, and lines.",
        "breakpoint": "Clusters by a distance that grows with range, and lines.",
        "pag-residual": "pag; residuals of lines up to 0.12 m.",
        "pag-range-residual": "pag-range; residuals of lines up to 0.12 m.",
        "distance-residual": "distance; residuals of lines up to 0.12 m.",
        "distance-lines": "distance; only probable detections that do not overlap.",
        "distance-rectangle": "distance-lines with minimum-area rectangles.",
        "distance-l-shape": "distance-lines with searched L-shapes: recommended.",
        "distance-filter": "distance-lines with Zhang 2017's matched filter.",
        "distance-body": "distance-lines with rounded bodies; ours.",
        "dbscan-l-shape": "distance-l-shape with polar ground removal and DBSCAN.",
        "range-angle-filter": "distance-filter with Zhang 2022's clustering.",
        "cluster-boxes": "A box for every cluster, people too (Li 2021).",
        "one-cluster": "One box around all that stands; the lower mark.",
        "zhang2017": "Moving vehicles; the paper's fit to one frame.",
        "zhang2017-multi": "Moving vehicles; fit to three frames, one frame late.",
        "zhang2017-multi-causal": "zhang2017-multi for the newest frame, no delay; ours.",
        "zhang2017-ransac": "Moving vehicles; RANSAC, with which the paper compares.",
        "long-range": "Moving vehicles, also far; a body fitted to rays; ours.",
    },
)

_PLACES = {
    "CAMERA_DETECTORS": "roadscope.detectors.camera:CAMERA_DETECTORS",
    "BodyFit": "roadscope.detectors.pose.body_fit:BodyFit",
    "BodyModel": "roadscope.detectors.pose.body_model:BodyModel",
    "BodySection": "roadscope.detectors.pose.body_model:BodySection",
    "SizePrior": "roadscope.detectors.pose.body_model:SizePrior",
    "Smoother": "roadscope.detectors.pose.smoother:Smoother",
    "VehiclePose": "roadscope.detectors.pose.estimate:VehiclePose",
    "fit_multi": "roadscope.detectors.pose.matched_filter:fit_multi",
    "fit_ransac": "roadscope.detectors.pose.ransac:fit_ransac",
    "fit_single": "roadscope.detectors.pose.matched_filter:fit_single",
    "saloon": "roadscope.detectors.pose.body_model:saloon",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "CAMERA_DETECTORS",
    "DETECTORS",
    "BodyFit",
    "BodyModel",
    "BodySection",
    "Detector",
    "SizePrior",
    "Smoother",
    "VehiclePose",
    "fit_multi",
    "fit_ransac",
    "fit_single",
    "saloon",
]

_PARTS = {
    "cloud": "Cloud",
    "drops": "DROPS_M without_faint",
    "evidence": "COUNTS FEATURES count_returns features shares_of_rays sort_to_cells",
    "horizon": "Horizon",
    "long_range": "AnsweredScan HEADING_RAD KnownCourse LongRangeDetector course_of likely_pose",
    "long_range_scores": "MOVING_FEATURES moving_features moving_score_model unsteadiness",
    "pipeline": "ClusterDetector exclusive_rows",
    "scoring": "ScoreModel scores shipped_model",
    "sorting": "median_of order_by order_within starts_of",
    "stages": "STAGES options_of",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
