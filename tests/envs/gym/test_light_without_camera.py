import gymnasium as gym
import pytest

import roadscope  # noqa: F401
from roadscope.core import RecordError
from roadscope.envs.gym import SensorWrapper
from roadscope.envs.imaging import Light


@pytest.mark.parametrize("light", ["night", "dusk", Light()])
@pytest.mark.parametrize("scenario", ["motorway", "street"])
def test_a_light_without_a_camera_is_refused(light: str | Light, scenario: str) -> None:
    with pytest.raises(RecordError, match=r"rig 'vlp16' has no camera.*wide"):
        gym.make("roadscope/Highway-v0", scenario=scenario, rig="vlp16", light=light)
    with pytest.raises(RecordError, match="rig 'lux' has no camera"):
        SensorWrapper(gym.make("merge-v1"), "lux", light=light)


@pytest.mark.parametrize(("rig", "light"), [("lux", None), ("lux", "day"), ("wide", "night")])
def test_other_lights_are_taken(rig: str, light: str | None) -> None:
    env = SensorWrapper(gym.make("merge-v1"), rig, light=light)
    assert env.reset(seed=1)[0]["lidar_range"].any()
