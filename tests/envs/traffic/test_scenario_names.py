import gymnasium as gym
import pytest

import roadscope  # noqa: F401
from roadscope.envs.gym import IDS
from roadscope.envs.traffic import SCENARIOS, ScenarioError, find, scenario_of_environment


@pytest.mark.parametrize("name", IDS)
def test_ids_of_ours_name_their_scenario(name: str) -> None:
    for spelling in (name, f"roadscope/{name}", f"roadscope:roadscope/{name}"):
        assert scenario_of_environment(spelling) == IDS[name]["scenario"]


@pytest.mark.parametrize(
    ("env_id", "scenario"),
    [
        ("highway", "motorway"),
        ("highway-v0", "motorway"),
        ("highway-fast-v0", "motorway"),
        ("merge-generic-v0", "merge"),
        ("racetrack-oval-v0", "racetrack"),
        ("two-way-v0", "two-way"),
        ("parking-parked-v0", "parking-lot"),
    ],
)
def test_ids_of_highway_env_name_a_scenario(env_id: str, scenario: str) -> None:
    assert scenario_of_environment(env_id) == scenario
    with pytest.raises(ScenarioError, match=f"no scenario '{env_id}'.*'{scenario}'.*known: "):
        find(env_id)


def test_most_ids_of_highway_env_are_known() -> None:
    gym.make("highway-v0").close()
    points = {name: str(spec.entry_point) for name, spec in gym.registry.items()}
    ids = [name for name, point in points.items() if point.startswith("highway_env")]
    known = [scenario_of_environment(name) for name in ids]
    assert sum(scenario in SCENARIOS for scenario in known) >= 10


@pytest.mark.parametrize("name", ["motorwy", "CartPole-v1", "", "highwayy", "highway-to-hell"])
def test_other_names_are_no_environments(name: str) -> None:
    assert scenario_of_environment(name) is None
    with pytest.raises(ScenarioError, match=f"no scenario '{name}'"):
        find(name)
