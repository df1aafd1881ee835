"""Traffic by kernels around an agent equals that of highway-env's objects."""

import copy
import pickle

import numpy as np
import pytest
from highway_env.envs.highway_env import HighwayEnv

import roadscope
from roadscope.envs.gym import MotorwayEnv

QUICK = {"vehicles_count": 20, "simulation_frequency": 10, "policy_frequency": 2, "duration": 90}
WHOLE = {"vehicles_count": 50, "policy_frequency": 5, "duration": 90}
STEERED = {"action": {"type": "ContinuousAction"}}
CONFIGS = [
    ({**QUICK}, 24, 0),
    pytest.param({**QUICK, **STEERED}, 24, 1, marks=pytest.mark.slow),
    pytest.param({**WHOLE}, 100, 2, marks=pytest.mark.slow),
    pytest.param({**WHOLE, "vehicles_density": 2.0}, 100, 3, marks=pytest.mark.slow),
    pytest.param({**WHOLE, **STEERED, "lanes_count": 2}, 100, 4, marks=pytest.mark.slow),
]


def states(env):
    return np.array([(*v.position, v.heading, v.speed) for v in env.road.vehicles])


def decisions(env):
    return [
        (v.lane_index, getattr(v, "target_lane_index", None), v.crashed) for v in env.road.vehicles
    ]


@pytest.mark.parametrize(("config", "steps", "seed"), CONFIGS)
def test_states_rewards_and_decisions_are_those_of_objects(config, steps, seed):
    ours, theirs = MotorwayEnv(config=config), HighwayEnv(config=config)
    ours.reset(seed=seed)
    theirs.reset(seed=seed)
    assert ours.action_space == theirs.action_space
    np.testing.assert_array_equal(states(ours), states(theirs))
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        discrete = ours.action_space.dtype == np.int64
        action = int(rng.integers(5)) if discrete else rng.uniform(-0.1, 0.1, 2).astype(np.float32)
        _, reward, *ends, info = ours.step(action)
        _, expected, *expected_ends, expected_info = theirs.step(action)
        assert reward == pytest.approx(expected, abs=1e-9)
        assert ends == expected_ends
        assert info["rewards"] == pytest.approx(expected_info["rewards"], abs=1e-9)
        np.testing.assert_allclose(states(ours), states(theirs), atol=1e-9, rtol=0)
        assert decisions(ours) == decisions(theirs)


@pytest.mark.parametrize("speed_range", [(15.0, 20.0), (0.0, 60.0)])
def test_the_agent_has_the_limits_of_speed_of_its_actions(speed_range):
    action = {"type": "ContinuousAction", "speed_range": list(speed_range)}
    config = {**QUICK, "vehicles_count": 0, "action": action}
    ours, theirs = MotorwayEnv(config=config), HighwayEnv(config=config)
    for env in (ours, theirs):
        env.reset(seed=0)
        for _ in range(16):
            env.step(np.array([1.0, 0.0], np.float32))
    assert theirs.vehicle.speed > 55.0 or theirs.vehicle.speed == pytest.approx(20.0, abs=0.01)
    np.testing.assert_allclose(states(ours), states(theirs), atol=1e-9, rtol=0)


def test_a_state_that_is_set_from_outside_has_an_effect():
    ours, theirs = MotorwayEnv(config=QUICK), HighwayEnv(config=QUICK)
    for env in (ours, theirs):
        env.reset(seed=1)
        env.step(1)
        env.vehicle.speed, env.vehicle.heading = 5.0, 0.1
        env.vehicle.position = env.vehicle.position + np.array([3.0, 0.5])
        env.step(1)
    np.testing.assert_allclose(states(ours), states(theirs), atol=1e-9, rtol=0)


def test_a_copy_drives_on_as_the_original():
    env = MotorwayEnv(config=QUICK)
    env.reset(seed=5)
    env.step(3)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    env.step(0)
    env.step(0)
    for each in copies:
        each.step(0)
        each.step(0)
        np.testing.assert_array_equal(states(each), states(env))


def test_other_drivers_are_stepped_as_objects():
    config = {**QUICK, "other_vehicles_type": "highway_env.vehicle.behavior.AggressiveVehicle"}
    ours, theirs = MotorwayEnv(config=config), HighwayEnv(config=config)
    for env in (ours, theirs):
        env.reset(seed=1)
        env.step(1)
    np.testing.assert_array_equal(states(ours), states(theirs))


def test_the_number_of_vehicles_can_be_chosen():
    env = roadscope.make("motorway", rig="lux", vehicles=120)
    _, info = env.reset(seed=0)
    assert len(info["truth"].ids) == 120
    _, _, _, _, info = env.step(1)
    assert len(info["truth"].ids) == 120


@pytest.mark.parametrize(
    "settings",
    [
        {"name": "merge", "vehicles": 10},
        {"name": "motorway", "vehicles": 10, "ego": "idm"},
        {"name": "motorway", "vehicles": 10, "config": {"vehicles_count": 3}},
        {"name": "motorway", "vehicles": -1},
        {"name": "motorway", "vehicles": 2.5},
    ],
)
def test_a_number_of_vehicles_that_means_nothing_is_refused(settings):
    with pytest.raises(ValueError, match="vehicles"):
        roadscope.make(**settings)
