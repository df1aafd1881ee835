"""Detectors of road users in images, by name."""

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
        "colour-blobs": "Patches that stand out in colour: what needs no training reaches.",
    },
)

__all__ = ["CAMERA_DETECTORS"]
