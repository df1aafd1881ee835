"""Fusions by name."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.fusion.api import Fusion

if TYPE_CHECKING:
    from roadscope.fusion.calibration import CalibrationResult, calibrate
    from roadscope.fusion.cluster_boxes import ClusterBoxes
    from roadscope.fusion.pairing import nearest_images

FUSIONS: Registry[Fusion] = Registry(
    "fusion",
    {
        "li2021": "roadscope.fusion.li2021:Li2021Fusion",
        "li2021-without-evidence": "roadscope.fusion.li2021:Li2021Fusion?evidence=False",
        "union": "roadscope.fusion.baselines:UnionFusion",
        "image-first": "roadscope.fusion.baselines:ImageFirstFusion",
        "lidar-first": "roadscope.fusion.baselines:LidarFirstFusion",
        "bayes": "roadscope.fusion.baselines:BayesFusion",
        "weighted-boxes": "roadscope.fusion.weighted_boxes:WeightedBoxFusion",
        "icp-boxes": "roadscope.fusion.icp_boxes:IcpBoxFusion",
        "consistent": "roadscope.fusion.consistent:ConsistentFusion",
    },
    group="roadscope.fusion",
    summaries={
        "li2021": "Overlap in the image, Dempster-Shafer (Li 2021).",
        "li2021-without-evidence": "li2021 with the class and score of the camera alone.",
        "union": "All targets of both, one to one, the better score.",
        "image-first": "The camera's targets with LiDAR's distance.",
        "lidar-first": "LiDAR's targets with the camera's class.",
        "bayes": "All targets of both, log-odds of scores added.",
        "weighted-boxes": "Boxes averaged by score (Solovyev 2021).",
        "icp-boxes": "Box centres matched by ICP, as in Lu 2017: a stand-in.",
        "consistent": "Bearing, size, depth agree; learned scores: ours.",
    },
)

_PLACES = {
    "CalibrationResult": "roadscope.fusion.calibration:CalibrationResult",
    "ClusterBoxes": "roadscope.fusion.cluster_boxes:ClusterBoxes",
    "calibrate": "roadscope.fusion.calibration:calibrate",
    "nearest_images": "roadscope.fusion.pairing:nearest_images",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = ["FUSIONS", "CalibrationResult", "ClusterBoxes", "Fusion", "calibrate", "nearest_images"]

_PARTS = {
    "baselines": "UnionFusion",
    "bundle": "State descend refine",
    "calibration": "CalibrationError decompose distances_px read_calibration solve_linear "
    "write_calibration",
    "calibration_target": "BeamDirections ScannedTarget TriangularTarget corners_in_image "
    "corners_in_scans edge_errors image_errors range_errors scanned_target "
    "stacked_measurements",
    "candidates": "depths_of places_at",
    "evidence": "FullConflictError MOST UNDECIDED camera_masses combine combine_or_keep "
    "conflict decide lidar_masses masses_of",
    "icp_boxes": "IcpBoxFusion",
    "li2021": "Li2021Fusion",
    "overlap": "ious projected_boxes",
    "pairing": "ALONE ClocksApartError LIMIT_S moved_projection",
    "weighted_boxes": "WeightedBoxFusion",
    "weights": "OddsModel SecondOrderModel second_order table",
}
"""What else the tests of this repository use, by the file that defines it. It is not public."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES, _PARTS)
