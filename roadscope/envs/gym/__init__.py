"""Sensors as Gymnasium environments."""

from roadscope._lazy import lazy_names

_PARTS = {
    "highway": "MotorwayEnv ScenarioEnv TASKS",
    "registration": "IDS env_ids",
    "sensor_wrapper": "SensorWrapper",
    "vector": "PooledVectorEnv pooled",
    "spaces": "EGO_BOUNDS LaneLocator ego_state goal_state observation_space range_image",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
