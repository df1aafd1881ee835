"""LeGO-LOAM's steps: range image, ground, two-step match, map of keyframes, loops."""

from roadscope._lazy import lazy_names

_PARTS = {
    "loop_closing": "DRIVEN_M Link LoopClosing best_motion icp_motion misfits nearest_candidate "
    "optimised_poses overlap relocalised",
    "mapping": "LegoMapping",
    "point_map": "CUBE_M Keyframe NEAREST PointMap nearest_points",
    "segments": "GROUND LEVEL NONE OBJECT_ANGLE_RAD features_of ground_and_objects ground_of "
    "objects_of range_image",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
