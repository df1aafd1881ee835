"""Traffic, world, ray caster, imaging, sensors, Gymnasium: imports run from right to left."""

from typing import TYPE_CHECKING

from roadscope._lazy import lazy_names

if TYPE_CHECKING:
    from roadscope.envs.gym.highway import ScenarioEnv
    from roadscope.envs.gym.registration import env_ids, make, register
    from roadscope.envs.gym.sensor_wrapper import SensorWrapper
    from roadscope.envs.gym.vector import PooledVectorEnv
    from roadscope.envs.imaging.pinhole import Pinhole
    from roadscope.envs.imaging.pinhole import mounted as camera_pose
    from roadscope.envs.sensors.camera_spec import CameraSpec
    from roadscope.envs.sensors.lidar_spec import LidarSpec
    from roadscope.envs.sensors.rig import CameraMount, ImuMount, LidarMount, Rig
    from roadscope.envs.sensors.rigs import rig as find_rig
    from roadscope.envs.sensors.sensing import Sensing
    from roadscope.envs.traffic.scenarios import record as record_traffic
    from roadscope.envs.traffic.timeline import Timeline

_PLACES = {
    "SensorWrapper": "roadscope.envs.gym.sensor_wrapper:SensorWrapper",
    "PooledVectorEnv": "roadscope.envs.gym.vector:PooledVectorEnv",
    "ScenarioEnv": "roadscope.envs.gym.highway:ScenarioEnv",
    "env_ids": "roadscope.envs.gym.registration:env_ids",
    "make": "roadscope.envs.gym.registration:make",
    "register": "roadscope.envs.gym.registration:register",
    "CameraMount": "roadscope.envs.sensors.rig:CameraMount",
    "CameraSpec": "roadscope.envs.sensors.camera_spec:CameraSpec",
    "ImuMount": "roadscope.envs.sensors.rig:ImuMount",
    "LidarMount": "roadscope.envs.sensors.rig:LidarMount",
    "LidarSpec": "roadscope.envs.sensors.lidar_spec:LidarSpec",
    "Pinhole": "roadscope.envs.imaging.pinhole:Pinhole",
    "Rig": "roadscope.envs.sensors.rig:Rig",
    "Sensing": "roadscope.envs.sensors.sensing:Sensing",
    "Timeline": "roadscope.envs.traffic.timeline:Timeline",
    "camera_pose": "roadscope.envs.imaging.pinhole:mounted",
    "find_rig": "roadscope.envs.sensors.rigs:rig",
    "record_traffic": "roadscope.envs.traffic.scenarios:record",
}
"""Public name -> `module:attribute`, loaded when first used."""

__all__ = [
    "CameraMount",
    "CameraSpec",
    "ImuMount",
    "LidarMount",
    "LidarSpec",
    "Pinhole",
    "PooledVectorEnv",
    "Rig",
    "ScenarioEnv",
    "Sensing",
    "SensorWrapper",
    "Timeline",
    "camera_pose",
    "env_ids",
    "find_rig",
    "make",
    "record_traffic",
    "register",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, _PLACES)
