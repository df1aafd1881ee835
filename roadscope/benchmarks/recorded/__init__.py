"""Recorded data in place of simulated traffic: suites, episodes, rules and scores."""

from roadscope._lazy import lazy_names

_PARTS = {
    "combined": "COMBINED alpha_parts combined_band combined_hota combined_mota nees_band",
    "mot": "ImagePlane MOT MotRecording mot_suite",
    "recording": "recordings_of",
    "rules": "BOX_SIMILARITIES apply_kitti_rules apply_mot_rules",
    "kitti_drive": "KittiDrive",
    "object_rules": "DIFFICULTIES object_precisions",
    "scores": "kitti_scores sequence_scores",
    "suite": "KITTI",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
