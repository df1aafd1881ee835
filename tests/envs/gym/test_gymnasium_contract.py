import copy
import hashlib
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import highway_env  # noqa: F401  (registers its ids)
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_checker import data_equivalence as equivalent

import roadscope  # noqa: F401  (registers ours)
from roadscope.envs import find_rig
from roadscope.envs.gym import IDS, ScenarioEnv, SensorWrapper
from roadscope.envs.sensors import sense
from roadscope.envs.traffic import record

AGENT_IDS = ("roadscope/Merge-v0", "roadscope/Intersection-v0", "roadscope/Racetrack-v0")
"""Discrete and continuous actions; other agents' environments are of the same class."""
FOREIGN = ("merge-v1", "parking-parked-v0", "racetrack-v1", "lane-keeping-v0")
"""One of each kind of actions and observations; `test_sensor_wrapper.py` wraps all ids."""
PLAYED = {"ego": "idm", "duration_s": 1.0}


def digest(observation: dict[str, np.ndarray]) -> str:
    parts = [key.encode() + observation[key].tobytes() for key in sorted(observation)]
    return hashlib.sha256(b"".join(parts)).hexdigest()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", IDS)
def test_check_env_passes_without_warnings(name: str) -> None:
    """Not more is recorded than is played here."""
    env = gym.make(f"roadscope/{name}", rig="lux", render_mode="rgb_array", duration_s=2.0)
    assert isinstance(env.unwrapped, ScenarioEnv)
    check_env(env.unwrapped)
    env.close()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", AGENT_IDS)
def test_check_env_passes_for_recorded_scenarios(name: str) -> None:
    env = gym.make(name, rig="lux", **PLAYED)
    check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, PLAYED])
def test_check_env_passes_with_weather(settings: dict[str, Any]) -> None:
    env = gym.make("roadscope/Merge-v0", rig="vlp16", weather="fog-4", **settings)
    check_env(env.unwrapped, skip_render_check=True)
    clear = gym.make("roadscope/Merge-v0", rig="vlp16", **settings)
    (fogged, _), (clear_observation, _) = env.reset(seed=3), clear.reset(seed=3)
    assert (fogged["lidar_range"] > 60).sum() < (clear_observation["lidar_range"] > 60).sum() / 10
    assert (fogged["lidar_range"] > 0).sum() > (clear_observation["lidar_range"] > 0).sum()
    assert np.array_equal(fogged["ego"], clear_observation["ego"])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
def test_check_env_warns_only_of_the_wrapper_of_foreign_environments(name: str) -> None:
    env = SensorWrapper(gym.make(name), "lux")
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("name", [*AGENT_IDS, "roadscope/Lu2018Occlusion-v0"])
def test_specs_survive_json(name: str) -> None:
    spec = gym.make(name, rig="lux").spec
    assert spec is not None
    again = gym.envs.registration.EnvSpec.from_json(spec.to_json())
    assert again == spec
    first, second = gym.make(spec), gym.make(again)
    one, _ = first.reset(seed=0)
    two, _ = second.reset(seed=0)
    assert digest(one) == digest(two)


def test_the_spec_of_a_wrapped_environment_remakes_the_wrapper() -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux", style="urban", weather="rain-2", records=False)
    assert env.spec is not None
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert isinstance(again, SensorWrapper)
    assert digest(env.reset(seed=2)[0]) == digest(again.reset(seed=2)[0])


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "options"), [("sync", {}), ("async", {"context": "spawn"})])
def test_vectors_give_what_single_environments_give(mode: str, options: dict[str, Any]) -> None:
    name, settings = "roadscope/Merge-v0", {"rig": "lux"}
    single = gym.make(name, **settings)
    expected = [single.reset(seed=4)[0]]
    *_, single_info = result = single.step(1)
    expected.append(result[0])
    vector = gym.make_vec(
        name, num_envs=2, vectorization_mode=mode, vector_kwargs=options, **settings
    )
    try:
        first, _ = vector.reset(seed=[4, 9])
        second, _, _, _, infos = vector.step(np.array([1, 1]))
    finally:
        vector.close()
    assert vector.observation_space.contains(second)
    for batch, observation in zip((first, second), expected, strict=True):
        assert digest({key: batch[key][0] for key in batch}) == digest(observation)
        assert digest({key: batch[key][1] for key in batch}) != digest(observation)
    assert infos["frames"][0] == single_info["frames"]
    assert infos["truth"][0] == single_info["truth"]


@pytest.mark.slow
def test_same_seed_same_bytes_in_every_process() -> None:
    code = (
        "import sys, hashlib, gymnasium as gym\n"
        "from tests.envs.gym.test_gymnasium_contract import digest, walk\n"
        "print(*walk())"
    )
    root = Path(__file__).parents[3]
    result = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": str(root)},
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert result.stdout.split() == walk()


def walk() -> list[str]:
    digests = []
    for name, settings in (
        ("roadscope:roadscope/Intersection-v0", {}),
        ("roadscope:roadscope/Merge-v0", PLAYED),
        ("roadscope:roadscope/Lu2018Occlusion-v0", {}),
    ):
        env = gym.make(name, **settings)
        observation, _ = env.reset(seed=11)
        digests.append(digest(observation))
        for _ in range(2):
            observation, *_ = env.step(0)
            digests.append(digest(observation))
    return digests


def test_a_played_scenario_is_the_recorded_one_and_ends_with_it() -> None:
    env = gym.make("roadscope/Roundabout-v0", rig="lux", **PLAYED)
    env.reset(seed=5)
    frames, truths, truncated, steps = [], [], False, 0
    while not truncated:
        _, reward, terminated, truncated, info = env.step(0)
        frames += info["frames"]
        truths += info["truths"]
        steps += 1
        assert (reward, terminated) == (0.0, False)
    timeline = record("roundabout", 5, 1.0)
    recorded = list(sense(timeline, find_rig("lux"), 5))
    assert info["time_s"] == pytest.approx(1.0)
    assert steps == 13
    assert frames == [frame for frame, _ in recorded]
    assert truths == [truth for _, truth in recorded]


def test_frames_of_a_script_fall_on_its_numbers() -> None:
    env = gym.make("roadscope/Lu2018TwoVehicles-v0")
    env.reset(seed=0)
    stamps = []
    for _ in range(4):
        *_, info = env.step(0)
        stamps += [frame.stamp_s for frame in info["frames"]]
    assert stamps == pytest.approx([0.08, 0.16, 0.24])


def test_an_agents_episode_ends_at_its_limit() -> None:
    env = gym.make("roadscope/TwoWay-v0", rig="lux", records=False, duration_s=3.0)
    env.reset(seed=0)
    ends = [env.step(1)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


@pytest.mark.slow
def test_a_crash_ends_an_agents_episode() -> None:
    env = gym.make("roadscope/HighwayDense-v0", rig="lux", records=False)
    env.reset(seed=1)
    for _ in range(40):
        *_, terminated, truncated, info = env.step(3)
        if terminated or truncated:
            break
    assert terminated == info["crashed"]
    assert terminated or truncated


@pytest.mark.parametrize("name", [*AGENT_IDS, "roadscope/Lu2018Occlusion-v0"])
def test_actions_outside_the_space_are_refused(name: str) -> None:
    env = gym.make(name, rig="lux", disable_env_checker=True)
    env.reset(seed=0)
    wrong = 99 if isinstance(env.action_space, gym.spaces.Discrete) else [7.0]
    with pytest.raises(ValueError, match="lies outside the action space"):
        env.step(wrong)


@pytest.mark.slow
@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("settings", [{}, PLAYED])
def test_copies_are_independent(twin: Any, settings: dict[str, Any]) -> None:
    env = gym.make("roadscope/Intersection-v0", rig="lux", **settings)
    env.reset(seed=0)
    env.step(0)
    other = twin(env)
    expected = [digest(env.step(0)[0]) for _ in range(2)]
    assert [digest(other.step(0)[0]) for _ in range(2)] == expected


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"scenario": "moon"}, "no scenario 'moon'.*known: motorway"),
        ({"scenario": "merge", "ego": "me"}, "no ego 'me'; known: agent, idm"),
        ({"scenario": "lu2018-occlusion", "ego": "agent"}, "is only played"),
        ({"scenario": "merge", "rig": "radar"}, "no rig 'radar'"),
        ({"scenario": "merge", "style": "moon"}, "no roadside style 'moon'"),
        ({"scenario": "street", "rig": "vlp16", "light": "dusk"}, "rig 'vlp16' has no camera"),
        ({"scenario": "merge", "weather": "hail"}, "no weather 'hail'"),
        ({"scenario": "merge", "ego": "idm", "weather": "hail"}, "no weather 'hail'"),
        ({"scenario": "merge", "step_s": 0.1}, "step_s: only with ego='idm'"),
        ({"scenario": "merge", "ego": "idm", "step_s": 0.0}, "step_s: expected a positive"),
        ({"scenario": "merge", "ego": "idm", "config": {}}, "config: only with ego='agent'"),
        ({"scenario": "merge", "render_mode": "foo"}, "no render mode 'foo'; known: 'rgb_array'"),
        (
            {"scenario": "lu2018-occlusion", "render_mode": "foo"},
            "no render mode 'foo'; known: 'rgb_array'",
        ),
        ({"scenario": "merge", "duration_s": float("nan")}, "duration_s: expected a positive"),
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ScenarioEnv(**settings)


def test_infos_after_a_reset_have_no_action() -> None:
    env = gym.make("roadscope/Merge-v0", rig="lux")
    infos = [env.reset(seed=3)[1] for _ in range(2)]
    assert equivalent(infos[0], infos[1], exact=True)


@pytest.mark.parametrize("name", ["roadscope/Highway-v0", "roadscope/Lu2018Occlusion-v0"])
def test_pictures_come_as_a_list_and_closing_twice_is_fine(name: str) -> None:
    env = gym.make(name, render_mode="rgb_array_list", rig="lux")
    env.reset(seed=0)
    env.step(0)
    pictures = env.render()
    assert [picture.dtype for picture in pictures] == [np.uint8, np.uint8]
    env.close()
    env.close()


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("roadscope/Highway-v0", {}),
        ("roadscope/Highway-v0", {"perception": "truth"}),
        ("roadscope/Highway-v0", {"perception": "blind"}),
        ("roadscope/Lu2018Occlusion-v0", {}),
    ],
)
def test_without_a_render_mode_it_warns_and_renders_nothing(
    name: str, settings: dict[str, Any]
) -> None:
    env = gym.make(name, rig="lux", **settings).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None
    env.close()


@pytest.mark.slow
def test_videos_can_be_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make("roadscope/Lu2018Occlusion-v0", render_mode="rgb_array", duration_s=0.4)
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "videos"))
    env.reset(seed=0)
    while not env.step(0)[3]:
        pass
    env.close()
    assert [path.suffix for path in (tmp_path / "videos").iterdir()] == [".mp4"]
