"""Readers and writers of files; `roadscope.formats` offers them to users."""

from roadscope._lazy import lazy_names

_PARTS = {
    "beams": "MAX_BEAM_HEIGHT_RAD azimuth_steps rings_of why_no_beams",
    "kitti_frames": "CAMERA_FROM_EGO EGO_FROM_CAMERA NOT_COUNTED bottoms_from_centres "
    "box_corners centres_from_bottoms clipped_image_boxes detections_from_rows image_boxes "
    "observation_angles rotations_from_yaws yaws_from_rotations",
    "kitti_labels": "CLASS_IDS DETECTED_TYPES DETECTION_COLUMNS LABEL_COLUMNS TYPE_NAMES "
    "read_kitti_object_labels read_kitti_object_results",
    "kitti_scans": "IMAGES SCANS find_kitti_frames",
    "motchallenge": "CLASS_COLUMNS COLUMNS WORLD_COLUMNS",
    "lzf": "decompress_lzf",
    "point_layout": "parse_columns",
    "image_folder": "ImageFolder read_image",
    "kitti_cameras": "KittiCameras",
    "samples": "find_imu find_wheels parse_mounting read_bag_imu rising_rows",
    "scan_stamps": "in_order",
    "tracking_rows": "logistic",
    "trajectories": "trajectory_text",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
