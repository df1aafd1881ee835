"""Detectors of road users in images, by name."""

from roadscope._lazy import lazy_names
from roadscope.core import Registry
from roadscope.detectors.api import Detector

CAMERA_DETECTORS: Registry[Detector] = Registry(
    "camera detector",
    {
        "network": "roadscope.detectors.camera.detector:CameraDetector",
        "colour-blobs": "roadscope.detectors.camera.colour_blobs:ColourBlobs",
    },
    group="roadscope.camera_detectors",
    summaries={
        "network": "A centre heatmap network, trained on rendered traffic.",
        "colour-blobs": "Patches that stand out in colour; it needs no training.",
    },
)

__all__ = ["CAMERA_DETECTORS"]

_PARTS = {
    "calibration": "TERM_COUNT",
    "decoding": "AGREEING_IOU Answers Peaks SAME_IOU TRAITS UNIT_PX VOTING_IOU averaged decode "
    "distinct",
    "detector": "BlankImageWarning CameraDetector squared",
    "network": "ARCHITECTURE CentreNetwork Maps channels_last finer squares",
    "precision": "fastest",
    "weight_file": "BoxCalibration SHIPPED WeightsError load save",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
