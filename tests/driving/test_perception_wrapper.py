"""Observations made of what is perceived."""

from __future__ import annotations

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import highway_env  # noqa: F401  (registers its ids)
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_boxes import tracks

from roadscope import SpecError, Tracks, load_suite
from roadscope.benchmarks.boards import DrivingSettings
from roadscope.driving import BelievedObservation, Perception, PerceptionWrapper
from roadscope.envs import env_ids, find_rig
from roadscope.envs.traffic import ForeignEnvError, to_world

pytestmark = pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")

PAGE = Path(__file__).parents[2] / "docs" / "environments.md"
STACK = "distance-l-shape + existence"
UNITS = np.array([200.0, 16.0, 80.0, 80.0])
"""Of x, y, vx, vy in an observation of `highway-v0`, metres and m/s."""
KINDS = {
    "Kinematics": {"type": "Kinematics", "vehicles_count": 8, "see_behind": True},
    "every feature": {
        "type": "Kinematics",
        "features": ["presence", "x", "y", "vx", "vy", "heading", "cos_h", "sin_h", "lat_off"],
        "absolute": True,
        "normalize": False,
    },
    "OccupancyGrid": {"type": "OccupancyGrid"},
    "TimeToCollision": {"type": "TimeToCollision", "horizon": 10},
}


def highway(kind: str = "Kinematics", **config: Any) -> gym.Env[Any, Any]:
    chosen = {"observation": KINDS[kind], "vehicles_count": 20, **config}
    return gym.make("highway-v0", config=chosen)


def true_tracks(env: Any) -> Tracks:
    """Return the true vehicles of an environment of highway-env as tracks."""
    others = [each for each in env.road.vehicles if each is not env.vehicle]
    n = len(others)
    positions, yaws, velocities = to_world(
        np.array([each.position for each in others]),
        np.array([each.heading for each in others]),
        np.array([each.velocity for each in others]),
    )
    sizes = np.reshape([(each.LENGTH, each.WIDTH, 1.5) for each in others], (-1, 3))
    return tracks(positions, np.arange(n), velocities=velocities, yaws=yaws, sizes=sizes)


def off_nearest(row: np.ndarray, others: np.ndarray) -> tuple[float, float]:
    """Return how far a vehicle is from the nearest of other rows, metres, and its velocity, m/s."""
    off = (others[1:, 1:] - row[1:]) * UNITS
    nearest = off[np.hypot(off[:, 0], off[:, 1]).argmin()]
    return float(np.hypot(*nearest[:2])), float(np.hypot(*nearest[2:]))


@pytest.mark.parametrize("perception", ["truth", STACK])
def test_an_intersection_does_not_change_the_traffic_of_other_environments(perception: str) -> None:
    def drive() -> list[np.ndarray]:
        env = PerceptionWrapper(highway(), perception)
        env.reset(seed=3)
        return [env.step(1)[0] for _ in range(3)]

    before = drive()
    crossing = gym.make("roadscope:roadscope/Intersection-v0", perception=perception)
    crossing.reset(seed=0)
    crossing.step(1)
    np.testing.assert_array_equal(drive(), before)


def test_the_traffic_is_the_same_whatever_is_observed() -> None:
    config = {"observation": {"type": "Kinematics", "order": "shuffled"}}

    def positions(perception: str) -> list[Any]:
        env = gym.make("roadscope:roadscope/Intersection-v0", perception=perception, config=config)
        env.reset(seed=3)
        for _ in range(3):
            env.step(1)
        traffic: Any = env.unwrapped
        return [each.position.tolist() for each in traffic._inner.unwrapped.road.vehicles]

    assert positions("truth") == positions("blind")


def test_the_observation_may_be_another_from_a_reset_on() -> None:
    env = PerceptionWrapper(highway(), "blind")
    settings = {"type": "Kinematics", "vehicles_count": 3}
    observed, _ = env.reset(seed=0, options={"config": {"observation": settings}})
    assert observed.shape == (3, 5)
    assert env.observation_space.shape == (3, 5)
    with pytest.raises(ForeignEnvError, match="cannot be made of tracks"):
        env.reset(
            options={
                "config": {"observation": {"type": "AttributesObservation", "attributes": ["road"]}}
            }
        )


@pytest.mark.parametrize("perception", ["truth", "blind", STACK])
@pytest.mark.parametrize(
    "setting", [{"observation": {"type": "OccupancyGrid"}}, {"action": {"type": "DiscreteAction"}}]
)
def test_an_id_keeps_its_spaces_at_a_reset(perception: str, setting: dict[str, Any]) -> None:
    env = gym.make("roadscope/Highway-v0", perception=perception, vehicles=3)
    with pytest.raises(ValueError, match=f"{next(iter(setting))} decides a space"):
        env.reset(seed=0, options={"config": setting})
    env.reset(seed=0, options={"config": {"lanes_count": 2}})


@pytest.mark.parametrize("perception", ["blind", STACK])
@pytest.mark.parametrize(
    "change",
    [
        gym.wrappers.FlattenObservation,
        gym.wrappers.NormalizeObservation,
        lambda env: gym.wrappers.FrameStackObservation(env, 2),
    ],
)
def test_wrappers_of_observations_go_around_it(
    perception: str, change: Callable[[Any], gym.Env[Any, Any]]
) -> None:
    with pytest.raises(ForeignEnvError, match=r"Observation changes observations.*around it"):
        PerceptionWrapper(change(highway()), perception)
    env = change(PerceptionWrapper(highway(vehicles_count=3), perception))
    assert env.observation_space.contains(env.reset(seed=0)[0])


@pytest.mark.parametrize("perception", ["truth", "blind", STACK])
def test_the_clock_is_that_of_the_sensors(perception: str) -> None:
    """A seventh of 15 steps a second is no whole number: highway-env takes two in each step."""
    rates = {"simulation_frequency": 15, "policy_frequency": 7}
    settings: dict[str, Any] = {"config": rates, "vehicles": 3, "duration_s": 1.0}
    env = gym.make("roadscope/Highway-v0", perception=perception, **settings)
    env.reset(seed=0)
    times, truncated = [], False
    while not truncated:
        *_, truncated, info = env.step(1)
        times.append(info["time_s"])
    assert times == pytest.approx(np.arange(1, 9) * 2 / 15)


@pytest.mark.parametrize("perception", ["truth", "blind", STACK])
def test_actions_outside_the_space_are_refused(perception: str) -> None:
    env = PerceptionWrapper(highway(vehicles_count=3), perception)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="outside the action space"):
        env.step(9)


@pytest.mark.parametrize("settings", [{}, {"perception": "truth"}])
def test_an_environment_of_ours_is_not_wrapped(settings: dict[str, Any]) -> None:
    env = gym.make("roadscope/Highway-v0", **settings)
    with pytest.raises(ForeignEnvError, match=r"perception= of gym\.make"):
        PerceptionWrapper(env, "truth")


def test_goals_in_hindsight_have_the_reward_of_the_environment() -> None:
    plain = gym.make("parking-v0", config={"vehicles_count": 10}).unwrapped
    env: Any = gym.make("roadscope/ParkingLot-v0", perception="truth").unwrapped
    observed, info = env.reset(seed=0)
    goals = observed["achieved_goal"], observed["desired_goal"]
    assert env.compute_reward(*goals, info) == plain.compute_reward(*goals, info) < 0
    assert env.compute_reward(goals[1], goals[1], info) == 0
    assert not hasattr(gym.make("roadscope/ParkingLot-v0").unwrapped, "compute_reward")


@pytest.mark.parametrize("kind", KINDS)
def test_truth_is_the_own_observation_to_the_bit(kind: str) -> None:
    plain, wrapped = highway(kind), PerceptionWrapper(highway(kind), "truth")
    assert wrapped.observation_space == plain.observation_space
    expected, _ = plain.reset(seed=4)
    observed, _ = wrapped.reset(seed=4)
    assert np.array_equal(observed, expected)
    for action in (1, 0, 3, 2):
        expected, reward, *_ = plain.step(action)
        observed, own_reward, *_ = wrapped.step(action)
        assert np.array_equal(observed, expected)
        assert own_reward == reward


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=6)
@given(seed=st.integers(0, 10_000), steps=st.integers(0, 4))
def test_perfect_tracks_give_the_own_observation(kind: str, seed: int, steps: int) -> None:
    env = highway(kind)
    expected, _ = env.reset(seed=seed)
    for _ in range(steps):
        expected, *_ = env.step(1)
    inner = env.unwrapped
    believed = BelievedObservation(inner, seed=0).observe(true_tracks(inner))
    assert believed.dtype == expected.dtype
    np.testing.assert_allclose(believed, expected, atol=1e-6)


def test_a_missed_vehicle_and_a_ghost_are_observed_as_such() -> None:
    env = highway()
    env.reset(seed=0)
    inner = env.unwrapped
    observation = BelievedObservation(inner, seed=0)
    tracks = true_tracks(inner)
    assert observation.observe(tracks)[1:, 0].sum() == 7
    assert observation.observe(tracks.select(np.arange(2)))[1:, 0].sum() == 2
    x, y = inner.vehicle.position
    ghost = tracks.select(np.arange(1))
    ghost.centres[0, :2] = x + 20.0, -y
    row = observation.observe(ghost)[1]
    assert row[1] == pytest.approx(20.0 / 200.0, abs=1e-6)
    assert row[2] == pytest.approx(0.0, abs=1e-6)
    ghost.centres[0, 1] = 40.0
    assert not observation.observe(ghost)[1:].any(), "beside the road"


def test_a_blind_stack_observes_no_road_user() -> None:
    env = PerceptionWrapper(highway(), "blind")
    observation, _ = env.reset(seed=0)
    assert observation[1:].any() == 0
    assert not env.step(1)[0][1:].any()


def test_what_is_near_is_perceived_where_it_is() -> None:
    plain, wrapped = highway(), PerceptionWrapper(highway(), STACK, rig="hdl32e")
    plain.reset(seed=3)
    first, info = wrapped.reset(seed=3)
    assert not first[1:].any()
    assert len(info["tracks"]) == 0
    for _ in range(2):
        expected, reward, *_ = plain.step(1)
        observed, own_reward, _, _, info = wrapped.step(1)
        assert own_reward == reward
    assert observed.shape == expected.shape
    assert np.array_equal(observed[0], expected[0])
    assert len(info["tracks"]) >= 2
    assert info["tracks"].stamp_s == pytest.approx(2.0)
    for track in observed[1:3]:
        near_m, speed_m_s = off_nearest(track, expected)
        assert near_m < 1.0
        assert speed_m_s < 3.0


@pytest.mark.parametrize("suite", ["driving", "driving-camera", "driving-faults"])
def test_stacks_of_boards_serve_environments_too(suite: str) -> None:
    loaded = load_suite(suite)
    for text in loaded.settings("driving", DrivingSettings).stacks:
        assert Perception(text, find_rig(loaded.rig)).text == text


def test_a_delay_makes_tracks_as_old_as_it_says() -> None:
    stacks = (STACK, f"{STACK} + 200 ms")
    prompt, late = (PerceptionWrapper(highway(policy_frequency=5), s, rig="vlp16") for s in stacks)
    known = [env.reset(seed=3)[1]["tracks"] for env in (prompt, late)]
    for _ in range(8):
        before = known[0]
        known = [env.step(1)[4]["tracks"] for env in (prompt, late)]
        assert np.array_equal(known[1].ids, before.ids)
        assert known[1].stamp_s == known[0].stamp_s
        moved = before.centres[:, :2] + before.velocities * (known[1].stamp_s - before.stamp_s)
        assert np.allclose(known[1].centres[:, :2], moved, atol=1e-9)
    assert len(known[1]) >= 2
    assert not np.array_equal(known[0].velocities, known[1].velocities)
    assert len(late.reset(seed=3)[1]["tracks"]) == 0


def test_the_picture_shows_the_tracks() -> None:
    env = gym.make(
        "roadscope/Highway-v0", perception=STACK, rig="hdl32e", render_mode="rgb_array", vehicles=20
    )
    env.reset(seed=0)
    coloured = []
    for _ in range(4):
        above = env.render()[:, :720].astype(int)
        coloured.append(int((np.ptp(above, axis=2) > 60).sum()))
        *_, info = env.step(1)
    assert len(info["tracks"])
    # At the start nothing is tracked, and returns, road and road users are grey.
    assert coloured[0] == 0
    assert coloured[-1] > 200
    env.close()


@pytest.mark.parametrize("ego", ["none", "dead-reckoning"])
def test_tracks_stand_where_the_ego_sees_them_whatever_its_poses(ego: str) -> None:
    stack, rig = Perception(f"{STACK}?ego={ego}", find_rig("vlp16-imu")), "vlp16-imu"
    assert stack.text.endswith(ego)
    environments = [
        PerceptionWrapper(highway(), f"{STACK}{each}", rig=rig) for each in ("", f"?ego={ego}")
    ]
    rows = []
    for env in environments:
        env.reset(seed=3)
        for _ in range(2):
            observed, *_ = env.step(1)
        rows.append(observed)
    # Few beams see ghosts, which poses move; a true vehicle is tracked by both.
    off = np.array([off_nearest(track, rows[1]) for track in rows[0][1:4]])
    assert (off < [1.5, 4.0]).all(axis=1).any()


@pytest.mark.slow
def test_a_fusion_perceives_too() -> None:
    stack = "fused?lidar=distance-l-shape&camera=network&fusion=li2021 + existence"
    env = PerceptionWrapper(highway(), stack, rig="wide")
    env.reset(seed=3)
    for _ in range(2):
        observed, *_, info = env.step(1)
    assert len(info["tracks"])
    assert observed[1, 0] == 1


@pytest.mark.parametrize("perception", [STACK, "truth"])
def test_its_spec_makes_it_again(perception: str) -> None:
    env = PerceptionWrapper(highway(), perception, seed=2)
    again = gym.make(env.spec)
    assert isinstance(again, PerceptionWrapper)
    assert again.spec == env.spec
    for each in (env, again):
        each.reset(seed=3)
    assert np.array_equal(env.step(1)[0], again.step(1)[0])


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("perception", ["truth", "blind", STACK])
def test_a_copy_drives_on_as_the_original(perception: str, twin: Callable[[Any], Any]) -> None:
    env = PerceptionWrapper(highway(vehicles_count=5), perception)
    env.reset(seed=2)
    env.step(1)
    other = twin(env)
    for action in (3, 0):
        expected, reward, *_ = env.step(action)
        observed, own_reward, *_ = other.step(action)
        assert np.array_equal(observed, expected)
        assert own_reward == reward


# highway-env's own observations have infinite bounds, of which Gymnasium warns.
@pytest.mark.filterwarnings("ignore:.*Box observation space (min|max)imum value is")
@pytest.mark.filterwarnings("ignore:.*different from the unwrapped version")
@pytest.mark.parametrize("perception", [STACK, "truth"])
def test_gymnasium_accepts_it(perception: str) -> None:
    check_env(PerceptionWrapper(highway(), perception), skip_render_check=True)


def test_an_id_takes_a_stack() -> None:
    env = gym.make("roadscope/Highway-v0", perception=STACK, rig="vlp16", disable_env_checker=True)
    assert type(env.unwrapped).__module__.startswith("roadscope.")
    own = highway().unwrapped.observation_type.space()
    assert env.observation_space.shape[1:] == own.shape[1:]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.parametrize("perception", ["truth", "blind"])
def test_an_id_drives_without_sensors(perception: str) -> None:
    env = gym.make("roadscope/Highway-v0", perception=perception, duration_s=2.0)
    observed, _ = env.reset(seed=5)
    assert observed[1:].any() == (perception == "truth")
    assert not env.step(1)[3]
    observed, _, terminated, truncated, info = env.step(1)
    assert terminated or truncated
    assert info["time_s"] == pytest.approx(2.0)
    env.close()


def rows_of_ids() -> list[list[str]]:
    """Return the cells of the table of ids in the documentation."""
    lines = PAGE.read_text("utf-8").split("| our bounds |")[1].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip().replace("`", "") for cell in line.split("|")[1:-1]] for line in lines]


@pytest.mark.parametrize("cells", rows_of_ids(), ids=lambda cells: cells[0])
def test_truth_of_an_id_is_that_of_the_environment_that_the_page_names(cells: list[str]) -> None:
    own, (foreign, _, setting), name, *bounds = cells[0], cells[1].partition(", "), *cells[2:]
    key, _, value = setting.partition(" ")
    config = {key: float(value) if "." in value else int(value)} if setting else {}
    plain = gym.make(foreign, config=config, disable_env_checker=True)
    env = gym.make(own, perception="truth", disable_env_checker=True)
    assert type(plain.unwrapped).__name__ == name
    assert [bounds_of(each.observation_space) for each in (env, plain)] == bounds
    assert env.action_space == plain.action_space
    env.action_space.seed(6)
    expected, observed = plain.reset(seed=6)[0], env.reset(seed=6)[0]
    for _ in range(5):
        assert data_equivalence(observed, expected)
        action = env.action_space.sample()
        expected, *ended, _, _ = plain.step(action)
        observed, *own_ended, _, _ = env.step(action)
        assert own_ended == ended
        if ended[1]:
            break


def bounds_of(space: gym.Space[Any]) -> str:
    """Return the bounds of a space as the page writes them."""
    box = space["observation"] if isinstance(space, gym.spaces.Dict) else space
    low, high = np.unique(box.low), np.unique(box.high)
    if low == -high:
        return f"±{high[0]:.2g}".replace("e+", "e")
    return f"{low[0]:g} to {high[0]:g}"


@pytest.mark.parametrize("perception", ["truth", pytest.param(STACK, marks=pytest.mark.slow)])
def test_stable_baselines3_accepts_flat_observations(perception: str) -> None:
    check = pytest.importorskip("stable_baselines3.common.env_checker").check_env
    env = gym.make("roadscope/Highway-v0", perception=perception, disable_env_checker=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(gym.wrappers.FlattenObservation(env))
    env.close()


def test_all_other_ids_are_refused() -> None:
    """They have no agent, so the page leaves none out."""
    for name in set(env_ids()) - {cells[0] for cells in rows_of_ids()}:
        with pytest.raises(ValueError, match="only played"):
            gym.make(name, perception="truth")


def test_a_played_ego_needs_no_perception() -> None:
    with pytest.raises(ValueError, match="ego"):
        gym.make("roadscope/Highway-v0", perception="truth", ego="idm")


@pytest.mark.parametrize(("name", "value"), [("pixel_truth", True), ("records", False)])
@pytest.mark.parametrize("perception", [STACK, "truth", "blind"])
def test_settings_without_effect_are_refused_by_name(
    perception: str, name: str, value: bool
) -> None:
    with pytest.raises(ValueError, match=f"^{name}.*perception"):
        gym.make("roadscope/Highway-v0", perception=perception, **{name: value})
    usual = {name: not value}
    gym.make("roadscope/Highway-v0", perception=perception, disable_env_checker=True, **usual)


@pytest.mark.slow
def test_environments_run_side_by_side() -> None:
    envs = gym.make_vec(
        "roadscope/Highway-v0", num_envs=2, vectorization_mode="sync", perception=STACK, rig="vlp16"
    )
    envs.reset(seed=1)
    observed, *_ = envs.step(np.ones(2, np.int64))
    alone = gym.make("roadscope/Highway-v0", perception=STACK, rig="vlp16")
    alone.reset(seed=1)
    assert np.array_equal(observed[0], alone.step(1)[0])
    envs.close()


@pytest.mark.parametrize(
    ("text", "rig", "word"),
    [
        ("existence", "vlp16", "DETECTOR"),
        ("no-such + existence", "vlp16", "no-such"),
        ("distance-l-shape + no-such", "vlp16", "no-such"),
        ("distance-l-shape + existence-offline", "vlp16", "whole episode"),
        ("fused?lidar=distance-l-shape&camera=network&fusion=li2021 + gnn", "vlp16", "camera"),
        ("fused?lidar=distance-l-shape + gnn", "wide", "camera="),
        ("network + existence", "wide", r"camera detector.*without distance.*'fused\?lidar="),
        ("distance-l-shape+existence", "vlp16", "did you mean 'distance-l-shape \\+ existence'"),
        ("Truth", "vlp16", "did you mean 'truth'"),
        ("bilnd", "vlp16", "did you mean 'blind'"),
        ("existence", "vlp16", "'truth' or 'blind'"),
        ("existence + 200 ms", "vlp16", "'truth' or 'blind'"),
        ("distance-l-shape + existence + 200", "vlp16", "'200' is no delay"),
        ("distance-l-shape + existence + 0.2 s", "vlp16", "'0.2 s' is no delay"),
        ("distance-l-shape + existence + 200 ms\n", "vlp16", "is no delay"),
        ("truth + 200 ms", "vlp16", "no perception stack: .* no delay"),
        ("distance+gnn+200 ms", "vlp16", "did you mean 'distance \\+ gnn'"),
    ],
)
def test_what_is_no_stack_is_refused(text: str, rig: str, word: str) -> None:
    with pytest.raises(SpecError, match=word):
        PerceptionWrapper(highway(), text, rig=rig)


def test_a_perception_is_a_text() -> None:
    with pytest.raises(TypeError, match=r"perception: expected a text.* got None"):
        PerceptionWrapper(highway(), None)  # type: ignore[arg-type]


@pytest.mark.parametrize("perception", [STACK, "truth", "blind"])
@pytest.mark.parametrize(
    ("foreign", "word"), [("CartPole-v1", "no road"), ("intersection-multi-agent-v0", "agents")]
)
def test_environments_without_one_vehicle_that_drives_are_refused(
    perception: str, foreign: str, word: str
) -> None:
    with pytest.raises(ForeignEnvError, match=f"'{foreign}'.*{word}"):
        PerceptionWrapper(gym.make(foreign), perception)


def test_other_observations_are_refused() -> None:
    env = gym.make("parking-v0")
    for perception in (STACK, "blind"):
        with pytest.raises(ForeignEnvError, match="KinematicsGoal"):
            PerceptionWrapper(env, perception)
    own = gym.make("roadscope/ParkingLot-v0", perception="truth", disable_env_checker=True)
    assert own.observation_space == env.observation_space
