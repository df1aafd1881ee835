"""Detectors by name."""

from roadscope.core import Registry
from roadscope.detectors.api import Detector

# The residual variants refuse outlines more ragged than 0.12 m: a face that only one layer of the
# LUX meets shows its whole range noise of 0.10 m. Chosen on seeds from 10000 up.
DETECTORS: Registry[Detector] = Registry(
    "detector",
    {
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
        "one-cluster": "roadscope.detectors.pipeline:ClusterDetector?clustering=one",
    },
    group="roadscope.detectors",
)

__all__ = ["DETECTORS", "Detector"]
