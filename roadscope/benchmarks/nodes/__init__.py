"""The nodes of a run: traffic, detections, image detections, fusions, poses and tracks."""

from roadscope._lazy import lazy_names

_PARTS = {
    "detections": "DetectionNode oracle_detections",
    "drives": "DriveNode EpisodeDrive Stack",
    "fusions": "FusedDetectionNode FusionNode targets_of",
    "images": "ImageNode lit_share",
    "poses": "PoseNode start_from_ego",
    "tuned": "TunedNode THRESHOLDS at_threshold is_tuned",
    "tracks": "ego_motions is_offline scores_tentative_tracks track",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
