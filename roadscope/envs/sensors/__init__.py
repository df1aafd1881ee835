"""Measurements of a rig, with their truth."""

from roadscope._lazy import lazy_names

_PARTS = {
    "camera": "expose image_truth motion_during",
    "camera_spec": "CAMERAS CameraSpec",
    "disturbance": "Gaps",
    "ego_motion": "BodySway EgoMotion RAW_S STATES_AHEAD settled_s",
    "exposure": "CameraMotion exposed",
    "faults": "FAULTS Fault SEVERITIES condition_name faults_of summary_of",
    "imu": "ImuNoise PAGE measure samples_of",
    "imu_spec": "IMUS STANDARD_GRAVITY_M_S2",
    "lidar": "APERTURE_M DIVERGENCE_RAD SweepTruth echo_rate echoes lidar_columns overlap sweep",
    "lidar_spec": "LidarSpec SPECS",
    "rig": "ImuMount Rig",
    "rigs": "RIGS load_rig scaled_noise",
    "sensing": "Sensing sense",
    "weathers": "CLEAR WEATHERS Weather fog rain weather",
    "wheels": "DeadReckoning WheelSpec",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
