"""Metrics: pure functions over records of arrays. `roadscope.metrics` offers the public ones.

Metrics that boards show are returned as a `Score`, by name: see `score_detections`,
`score_images`, `fusion_scores`, `score_tracks` and `score_odometry`.
"""

from roadscope._lazy import lazy_names

METRIC_VERSION = 5
"""Raised whenever the meaning of a score changes; results of different versions are never mixed."""

_PARTS = {
    "breakdown": "BANDS EXCESS part_name split_name",
    "calibration": "calibration_error excess pooled_calibration score_bins",
    "detection": "axis_error_deg box_errors box_overlaps_from_above score_detections "
    "score_detections_by_band",
    "driving": "ScoredDrive phantom_braking score_drive times_to_collision",
    "fusion": "FusionTargets fusion_rates fusion_scores match_targets threshold_at",
    "image_detection": "LabelledImage image_precision score_images",
    "image_labels": "Labels PARKED ParkedBoxes labels_of",
    "matching": "Match Pairing assign centre_distances image_overlaps match",
    "odometry": "AT_REST_M_S DISTANCE LEAST_REST_S MARKS_M by_distance rests score_moving "
    "score_odometry score_standing",
    "ranked_precision": "FALSE_ALARM IGNORED average_precision match_greedily overlap_precision "
    "precision_by_group rank_by_distance",
    "score": "Score mean ratio rms",
    "trajectory_errors": "KITTI_M Trajectories absolute_errors drift relative_errors "
    "truth_from_estimate",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
