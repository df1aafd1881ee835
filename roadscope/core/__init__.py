"""The records that all other packages share, poses, specs and registries.

It imports no other package of roadscope.
"""

from roadscope._lazy import lazy_names
from roadscope.core.category import Category, Family
from roadscope.core.checks import RecordError
from roadscope.core.detections import Detections, ImageDetections
from roadscope.core.driving import DrivingCommand, DrivingScene
from roadscope.core.frame import Calibration, Frame
from roadscope.core.image import CameraImage
from roadscope.core.imu import ImuSamples
from roadscope.core.loading import NotInstalledError, Requirement, SpecError
from roadscope.core.odometry import OdometryEstimate, OdometryStatus
from roadscope.core.pixel_truth import SKY, PixelTruth
from roadscope.core.pose import Pose, wrap_angle
from roadscope.core.registry import Registry
from roadscope.core.scan import LidarScan
from roadscope.core.spec import Spec
from roadscope.core.tracks import Tracks, TrackState
from roadscope.core.truth import GROUND, WEATHER, Truth
from roadscope.core.wheels import WheelSamples

__all__ = [
    "GROUND",
    "SKY",
    "WEATHER",
    "Calibration",
    "CameraImage",
    "Category",
    "Detections",
    "DrivingCommand",
    "DrivingScene",
    "Family",
    "Frame",
    "ImageDetections",
    "ImuSamples",
    "LidarScan",
    "NotInstalledError",
    "OdometryEstimate",
    "OdometryStatus",
    "PixelTruth",
    "Pose",
    "RecordError",
    "Registry",
    "Requirement",
    "Spec",
    "SpecError",
    "TrackState",
    "Tracks",
    "Truth",
    "WheelSamples",
    "wrap_angle",
]

_PARTS = {
    "answers": "AnswerError check_tracks",
    "bounds": "Bounds",
    "box_overlap": "box_overlaps box_overlaps_3d overlapping_pairs pair_overlaps",
    "fused": "FusedDetections",
    "constructing": "construct",
    "jit": "compiled sources_of",
    "loading": "load_class",
    "names": "unknown",
    "palette": "ASPHALT_COLOUR COLOUR_SCALE DETECTION_COLOURS GROUND_COLOUR HIDDEN_COLOUR "
    "LABEL_COLOUR ODOMETRY_COLOUR PAGE_DARK PAGE_LIGHT PANEL_COLOUR RETURN_COLOURS TRACK_COLOURS "
    "TRUTH_COLOUR hex_colour track_colour",
    "pixel_truth": "GROUND_CLASS SCENERY_CLASS SKY_CLASS",
    "projection": "Projection",
    "record": "same_value",
    "spec": "ORACLE",
    "wire": "WireError decode encode",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
