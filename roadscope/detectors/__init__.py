"""Detectors by name."""

from roadscope.core import Registry
from roadscope.detectors.api import Detector

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
        "zhang2017": "roadscope.detectors.long_range:LongRangeDetector?fit=single",
        "zhang2017-multi": "roadscope.detectors.long_range:LongRangeDetector?fit=multi&late=True",
        "zhang2017-multi-causal": "roadscope.detectors.long_range:LongRangeDetector?fit=multi",
        "zhang2017-ransac": "roadscope.detectors.long_range:LongRangeDetector?fit=ransac",
        "long-range": "roadscope.detectors.long_range:LongRangeDetector?fit=body",
    },
    group="roadscope.detectors",
)

__all__ = ["DETECTORS", "Detector"]
