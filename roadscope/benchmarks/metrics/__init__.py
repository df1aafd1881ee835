"""Metrics: pure functions over records of arrays. `roadscope.metrics` offers the public ones.

Metrics that boards show are returned as a `Score`, by name: see `score_detections`,
`score_images`, `fusion_scores`, `score_tracks` and `score_odometry`.
"""

METRIC_VERSION = 4
"""Raised whenever the meaning of a score changes; results of different versions are never mixed."""
