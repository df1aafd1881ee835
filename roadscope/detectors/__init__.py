"""Detectors by name."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.detectors.api import Detector

if TYPE_CHECKING:
    from roadscope.detectors.camera import CAMERA_DETECTORS
    from roadscope.detectors.pose.body_fit import BodyFit
    from roadscope.detectors.pose.body_model import BodyModel, saloon
    from roadscope.detectors.pose.estimate import VehiclePose
    from roadscope.detectors.pose.matched_filter import fit_multi, fit_single
    from roadscope.detectors.pose.ransac import fit_ransac
    from roadscope.detectors.pose.smoother import Smoother

# The residual variants refuse outlines more ragged than 0.12 m: a face that only one layer of the
# LUX meets shows its whole range noise of 0.10 m. Chosen on seeds from 10000 up.
# The scored ones keep what is more probably right than wrong, and leave out what is fainter than
# black rubber at 11 degrees; `distance-l-shape` is the one to take without a wish of one's own.
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
        "cluster": "Any ground x clustering x shape; pag unless told.",
        "pag": "PAG to the letter, lines of the outline (Lu 2018).",
        "pag-range": "PAG with returns weighed by range: ours.",
        "distance": "Links up to a fixed distance, lines.",
        "breakpoint": "Links up to a distance that grows with range, lines.",
        "pag-residual": "pag without outlines more ragged than 0.12 m.",
        "pag-range-residual": "pag-range, likewise.",
        "distance-residual": "distance, likewise.",
        "distance-lines": "distance without improbable, overlapping or faint ones.",
        "distance-rectangle": "Likewise, minimum-area rectangles.",
        "distance-l-shape": "Likewise, search-based L-shapes: the one to take.",
        "distance-filter": "Likewise, Zhang 2017's matched filter.",
        "distance-body": "Likewise, bodies with rounded corners: ours.",
        "dbscan-l-shape": "Likewise, polar ground, DBSCAN, L-shapes.",
        "range-angle-filter": "Likewise, Zhang 2022's growth, matched filter.",
        "zhang2017": "What moves; the paper's fit of one frame.",
        "zhang2017-multi": "What moves; the paper's of three, one frame late.",
        "zhang2017-multi-causal": "What moves; the same for the newest frame: ours.",
        "zhang2017-ransac": "What moves; RANSAC, which the paper compares with.",
        "long-range": "What moves, also far off; a body fitted to rays: ours.",
    },
)

_PLACES = {
    "CAMERA_DETECTORS": "roadscope.detectors.camera:CAMERA_DETECTORS",
    "BodyFit": "roadscope.detectors.pose.body_fit:BodyFit",
    "BodyModel": "roadscope.detectors.pose.body_model:BodyModel",
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
    "Detector",
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
    "evidence": "COUNTS count_returns shares_of_rays sort_to_cells",
    "horizon": "Horizon",
    "long_range": "LongRangeDetector",
    "long_range_body": "AnsweredScan HEADING_RAD KnownCourse course_of likely_pose",
    "long_range_scores": "FEATURES features shipped_model unsteadiness",
    "pipeline": "ClusterDetector exclusive_rows",
    "scoring": "ScoreModel scores",
    "sorting": "median_of order_by order_within starts_of",
    "stages": "STAGES options_of",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
