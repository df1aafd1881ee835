"""Traffic: recordings of highway-env, and our own scenarios."""

from roadscope._lazy import lazy_names

_PARTS = {
    "conversion": "DRIVER_CONSTANTS ForeignEnvError LANE_STEP_M restore_driver_constants road_map "
    "to_world",
    "course": "Bend Course SHARPEST_M winding",
    "driven": "DrivenTraffic",
    "lu2018": "Event FRAME_S LEFT_EDGE SCRIPTS SENSOR_AHEAD_M Script play_script",
    "mix": "MIXES UNSEEN",
    "recorder": "RecordedRegulatedRoad RecordedRoad TrafficRecorder",
    "recording": "rear_axles",
    "road_maps": "RoadMap",
    "roads": "greatest_curvature",
    "scenarios": "SCENARIOS ScenarioError accept accepted_traffic find record "
    "scenario_of_environment",
    "script": "Change ScriptedMotion",
    "scripts": "convoy_pull_away",
    "terrain": "Terrain",
    "timeline": "Timeline",
    "walkers": "rounded_path",
}
"""Names by the file that defines them, loaded when first used: the face of this folder."""

__getattr__, __dir__ = lazy_names(__name__, parts=_PARTS)
