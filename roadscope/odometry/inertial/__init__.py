"""A Kalman filter of scans and inertial samples, and how it begins."""

from roadscope._lazy import lazy_names

_PARTS = {
    "filter": "FORCE GRAVITY GYRO InertialNoise POSE POSITION SIZE SPEED TURN WHEELS diffusion "
    "integrated propagate resume started transition update_linear update_pose",
    "speed_check": "BELIEVED_S FAR_M_S SCANS SpeedCheck",
    "speed_search": "BeamTable Ends Speed count_separate gathered joined marked_fixtures slim "
    "speed_of standing_speed_of",
    "standstill": "DOUBT_M IntegratedSpeed LEAST_M_S NEAR_M RestHistory measured_rest",
    "start": "InertialStart",
    "track": "ImuInterval InertialTrack SLOW_M_S matched_with_prediction",
    "wheel_buffer": "WheelBuffer",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
