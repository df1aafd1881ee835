"""The closed loop as a Gymnasium environment."""

from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from roadscope import Episode, Spec, SpecError
from roadscope.benchmarks import Job, RunOptions
from roadscope.benchmarks.boards import DrivingBoard
from roadscope.benchmarks.nodes import DriveNode, Stack
from roadscope.driving import (
    DRIVERS,
    AgentDriver,
    ClosedLoop,
    DriveEnv,
    Perception,
    command_of,
    observed,
)
from roadscope.envs import find_rig
from roadscope.envs.traffic import ScenarioError

BRAKE, KEEP_SPEED, FASTER = 0, 3, 4
ACTIONS = 7


def drive(env, action=KEEP_SPEED, **options):
    """Drive with one action; return rewards, how it ended, and the last info."""
    _, info = env.reset(options=options)
    rewards, terminated, truncated = [], False, False
    while not (terminated or truncated):
        _, reward, terminated, truncated, info = env.step(action)
        rewards.append(reward)
    return np.array(rewards), (terminated, truncated), info


@pytest.mark.parametrize("perception", ["truth", "distance + nearest"])
def test_gymnasium_accepts_it(perception) -> None:
    env = gym.make("roadscope/Drive-v0", scenario="merge", perception=perception, duration_s=2.0)
    check_env(env.unwrapped)


def pictured(perception: str) -> np.ndarray:
    """Return the picture of a drive after 2 s."""
    env = gym.make(
        "roadscope/Drive-v0",
        scenario="two-way",
        perception=perception,
        duration_s=4.0,
        render_mode="rgb_array",
    )
    env.reset(options={"seed": 1})
    for _ in range(10):
        env.step(KEEP_SPEED)
    picture = env.render()
    env.close()
    return picture


def test_it_draws_what_is_true_and_what_is_believed() -> None:
    pictures = {each: pictured(each) for each in ("truth", "blind", "distance + nearest")}
    for picture in pictures.values():
        assert (picture.shape, picture.dtype) == ((720, 1280, 3), np.uint8)
    views = {each: picture[:, :720].astype(int) for each, picture in pictures.items()}
    grey = {each: np.ptp(view, axis=2) < 30 for each, view in views.items()}
    # Road, returns and true road users are grey, tracks are in colours.
    coloured = {each: int((~is_grey).sum()) for each, is_grey in grey.items()}
    assert coloured["blind"] == 0
    assert coloured["truth"] > 300
    assert coloured["distance + nearest"] > 300
    white = {each: (view > 240).all(axis=2) for each, view in views.items()}
    assert (white["blind"] & (white["truth"] | ~grey["truth"])).sum() > 0.9 * white["blind"].sum()


def test_without_a_render_mode_nothing_is_drawn() -> None:
    env = DriveEnv("merge", duration_s=2.0)
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="without a render mode"):
        assert env.render() is None
    with pytest.raises(gym.error.ResetNeeded):
        DriveEnv("merge", render_mode="rgb_array").render()
    with pytest.raises(ValueError, match=r"render_mode: expected .* got 'human'"):
        DriveEnv("merge", render_mode="human")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Overwriting existing videos:UserWarning")
def test_a_video_of_a_drive_is_recorded(tmp_path) -> None:
    pytest.importorskip("moviepy", reason="needs the extra video")
    env = gym.make("roadscope/Drive-v0", scenario="merge", duration_s=2.0, render_mode="rgb_array")
    env = gym.wrappers.RecordVideo(env, str(tmp_path), episode_trigger=lambda episode: True)
    drive(env)
    env.close()
    (video,) = tmp_path.glob("*.mp4")
    assert video.stat().st_size > 1000


def test_the_true_scene_differs_by_what_is_perceived_alone() -> None:
    env = DriveEnv("motorway", perception="blind", duration_s=2.0)
    with pytest.raises(gym.error.ResetNeeded):
        _ = env.true_scene
    env.reset(options={"seed": 3})
    for _ in range(3):
        env.step(KEEP_SPEED)
    true = DriveEnv("motorway", duration_s=2.0)
    true.reset(options={"seed": 3})
    for _ in range(3):
        true.step(KEEP_SPEED)
    assert len(true.scene.tracks)
    np.testing.assert_array_equal(observed(env.true_scene), observed(true.scene))
    np.testing.assert_array_equal(observed(true.true_scene), observed(true.scene))
    assert not len(env.scene.tracks)


@pytest.mark.parametrize(("action", "collides"), [(KEEP_SPEED, False), (FASTER, True)])
def test_the_sum_of_rewards_is_the_reward_of_the_board(action, collides) -> None:
    """Of a driver that always does the same, scored as on the board."""
    spec, planned_s = Spec.parse(f"{Path(__file__)}:Steady?action={action}"), 12.0
    episode = Episode("motorway", 3, "vlp16", planned_s)
    driver = DRIVERS.resolve(spec)
    node, options = DriveNode(driver, Stack("truth"), episode), RunOptions(trust=True)
    board = DrivingBoard()
    expected = board.score(Job(board, "steady", episode, node), node.compute(options), options)
    env = DriveEnv("motorway", duration_s=planned_s)
    rewards, ends, info = drive(env, action, seed=3)
    assert ends == (collides, not collides)
    assert info["collided"] == bool(expected["collided"].value) == collides
    assert rewards.sum() / planned_s == pytest.approx(expected["reward"].value, abs=0.002)


class Steady:
    """A driver that always does the same."""

    kind = "driver"

    def __init__(self, *, action=0):
        self._action = action

    def reset(self):
        pass

    def drive(self, scene):
        return command_of(self._action, scene)


def test_gymnasiums_seed_decides_everything_and_options_overrule_it() -> None:
    env = DriveEnv(["merge", "motorway"], perception=["truth", "blind"], duration_s=1.0)
    drawn = [env.reset(seed=seed)[1] for seed in range(20)]
    assert drawn == [env.reset(seed=seed)[1] for seed in range(20)]
    assert {info["scenario"] for info in drawn} == {"merge", "motorway"}
    assert {info["perception"] for info in drawn} == {"truth", "blind"}
    assert all(info["seed"] < 10_000 for info in drawn)
    chosen = {"scenario": "roundabout", "perception": "blind", "seed": 77}
    assert env.reset(seed=0, options=chosen)[1] == chosen


@pytest.mark.parametrize(
    ("options", "error", "word"),
    [
        ({"seed": -1}, ValueError, "seed: expected a whole number from 0 up"),
        ({"seed": 1.5}, TypeError, "seed: expected a whole number"),
        ({"scenario": ["merge"]}, TypeError, r"options\['scenario'\]: expected one name"),
        ({"scenario": "tunnel"}, ScenarioError, "scripted"),
        ({"perception": "nothing"}, SpecError, "perception stack"),
    ],
)
def test_a_reset_that_fails_leaves_the_drive_as_it_is(options, error, word) -> None:
    env = DriveEnv("motorway", perception="blind", duration_s=1.0)
    _, before = env.reset(seed=3)
    with pytest.raises(error, match=word):
        env.reset(options=options)
    *_, info = env.step(KEEP_SPEED)
    assert {name: info[name] for name in before} == before


def test_an_option_that_is_none_is_drawn() -> None:
    env = DriveEnv("motorway", perception="blind", duration_s=1.0)
    assert env.reset(seed=3, options={"seed": None})[1] == env.reset(seed=3)[1]


def test_blind_agents_observe_no_road_user_and_others_those_around() -> None:
    env = DriveEnv("dense-motorway", duration_s=1.0)
    blind, _ = env.reset(options={"seed": 0, "perception": "blind"})
    seeing, _ = env.reset(options={"seed": 0, "perception": "truth"})
    assert not blind[11:].any()
    assert blind[3:6] == pytest.approx([2.0, 0.0, 0.0])
    assert seeing[11::6].sum() >= 5
    assert seeing[3] < 2.0
    assert seeing[5] == 1.0


def test_a_stack_that_drove_before_perceives_as_a_new_one() -> None:
    stack = "distance + nearest"
    env = DriveEnv(["merge", "motorway"], perception=stack, duration_s=2.0)
    drive(env, scenario="motorway", seed=1)
    observation, _ = env.reset(options={"scenario": "merge", "seed": 2})
    loop = ClosedLoop(
        "merge", 2, perception=Perception(stack, find_rig("vlp16")), rig="vlp16", duration_s=2.0
    )
    scene = loop.scene(loop.tracks())
    for _ in range(10):
        np.testing.assert_array_equal(observation, observed(scene))
        observation, *_ = env.step(KEEP_SPEED)
        for _ in range(2):
            loop.step(command_of(KEEP_SPEED, scene))
            scene = loop.scene(loop.tracks())
    assert observation[11::6].sum() >= 1


@pytest.mark.parametrize(
    "conditions", [{"weather": "fog-3"}, {"faults": "dropped-scans:4"}, {"faults": ["fog:4"]}]
)
def test_sensors_have_weather_and_faults_as_on_the_board(conditions) -> None:
    stack = "distance + nearest"
    env = DriveEnv("dense-motorway", perception=stack, duration_s=1.0, **conditions)
    clear = DriveEnv("dense-motorway", perception=stack, duration_s=1.0)
    loop = ClosedLoop(
        "dense-motorway",
        2,
        perception=Perception(stack, find_rig("vlp16")),
        rig="vlp16",
        duration_s=1.0,
        **conditions,
    )
    observation, _ = env.reset(options={"seed": 2})
    clear.reset(options={"seed": 2})
    scene, differs = loop.scene(loop.tracks()), False
    for _ in range(5):
        np.testing.assert_array_equal(observation, observed(scene))
        observation, *_ = env.step(KEEP_SPEED)
        differs |= not np.array_equal(observation, clear.step(KEEP_SPEED)[0])
        for _ in range(2):
            loop.step(command_of(KEEP_SPEED, scene))
            scene = loop.scene(loop.tracks())
    assert differs


def test_images_have_the_light_that_is_chosen() -> None:
    stack = "fused?lidar=distance&camera=network&fusion=li2021 + nearest"
    drive_env = partial(DriveEnv, "motorway", perception=stack, rig="wide", duration_s=0.6)
    day, night = drive_env(light="day"), drive_env(light="night")
    for env in (day, night):
        drive(env, seed=2)
    assert not np.array_equal(day.scene.tracks.scores, night.scene.tracks.scores)


@pytest.mark.parametrize(
    ("conditions", "word"),
    [
        ({"weather": "hail"}, "hail"),
        ({"faults": "fog:9"}, "fog"),
        ({"light": "dawn", "rig": "wide"}, "dawn"),
        ({"light": "night"}, "camera"),
    ],
)
def test_wrong_conditions_are_refused_before_a_drive(conditions, word) -> None:
    with pytest.raises(ValueError, match=word):
        DriveEnv("motorway", **conditions)


def test_it_runs_as_a_vector() -> None:
    envs = gym.make_vec(
        "roadscope/Drive-v0", num_envs=2, vectorization_mode="sync", scenario="merge"
    )
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (2, 71)
    rewards = [envs.step(np.array([KEEP_SPEED, BRAKE]))[1] for _ in range(3)]
    assert rewards[2][1] < rewards[0][1] - 0.02
    assert rewards[2][0] == pytest.approx(rewards[0][0], abs=0.02)


def test_an_agent_drives_on_the_board_as_in_the_environment() -> None:
    """The driver decides at the same instants and on the same observations."""
    env, agent = DriveEnv("cutting-in", duration_s=6.0), AgentDriver()
    observation, _ = env.reset(options={"seed": 5})
    driven, over = [], False
    while not over:
        observation, reward, terminated, truncated, _ = env.step(agent.choose(observation))
        driven.append(reward)
        over = terminated or truncated
    loop = ClosedLoop("cutting-in", 5, perception="truth", rig="vlp16", duration_s=6.0)
    shares = []
    while not loop.over:
        command = agent.drive(loop.scene(loop.tracks()))
        shares.append(min(loop.traffic.speed_m_s / loop.traffic.desired_speed_m_s, 1.0))
        loop.step(command)
    assert 0.1 * np.reshape(shares, (-1, 2)).sum(axis=1) == pytest.approx(driven)
    assert np.ptp(driven) > 0.01


def test_wrong_names_are_refused_at_once() -> None:
    with pytest.raises(ScenarioError, match="motorvay"):
        DriveEnv("motorvay")
    with pytest.raises(ScenarioError, match="scripted"):
        DriveEnv(["merge", "cut-ins"])
    with pytest.raises(ValueError, match="perception stack"):
        DriveEnv(perception="nothing")
    with pytest.raises(ValueError, match="vlp61"):
        DriveEnv(rig="vlp61")
    with pytest.raises(ValueError, match="duration_s"):
        DriveEnv(duration_s=0.0)
    with pytest.raises(ValueError, match="scenario: expected at least one"):
        DriveEnv([])
    with pytest.raises(ValueError, match="seeds: expected at least one"):
        DriveEnv(seeds=range(0))
    with pytest.raises(ValueError, match="'sead'"):
        DriveEnv().reset(options={"sead": 5})
    with pytest.raises(gym.error.ResetNeeded):
        DriveEnv().step(0)


@pytest.mark.parametrize("action", [-1, ACTIONS, 1.5, "brake"])
def test_an_action_outside_the_space_is_refused(action) -> None:
    env = DriveEnv("motorway", perception="blind", duration_s=1.0)
    env.reset(options={"seed": 3})
    with pytest.raises(ValueError, match="action space"):
        env.step(action)
