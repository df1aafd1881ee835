"""How long the parts of the package take on this machine."""

from roadscope._lazy import lazy_names

_PARTS = {
    "camera": "measure_camera",
    "casting": "TILTS casting_steps parked_scene sensor_poses",
    "detectors": "FRAMES LEAD SCENES detector_steps driven_frames measure_detectors timed_frames",
    "environments": "RIGS measure_environment",
    "measure": "PARTS measure_speed run_steps write_speed",
    "odometry": "LEAD_SCANS RIG measure_odometries own_odometries timed_scans",
    "rows": "SpeedRow SpeedStep",
    "trackers": "COUNTS CROWD LEAD_UPDATES UPDATES detected_crowd detected_traffic "
    "measure_trackers own_trackers timed_pass timed_updates",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
