"""Sensors as Gymnasium environments."""

from roadscope._lazy import lazy_names

_PARTS = {
    "canvas": "Canvas polygon_depth text_px",
    "highway": "ScenarioEnv TASKS",
    "registration": "IDS env_ids",
    "render": "ASPHALT BirdsEyeView DETECTION EGO FAMILIES GROUND_RETURN LABEL LabelPlacer "
    "WEATHER_RETURN birds_eye box_corners draw_legend track_colour write_distances write_ids",
    "sensor_wrapper": "SensorWrapper",
    "spaces": "EGO_BOUNDS LaneLocator ego_state goal_state observation_space range_image",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
