"""What an agent observes of a scene, what it does, and files of agents."""

import tomllib
from dataclasses import replace
from hashlib import sha256
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
import toy_boxes
from hypothesis import given
from hypothesis import strategies as st
from safetensors.numpy import save_file

import roadscope
from roadscope.core import Category, DrivingCommand, DrivingScene, Pose, Tracks
from roadscope.driving import AgentDriver, command_of, load_agent, observed, save_agent

BRAKE, KEEP_SPEED, LEFT, RIGHT = 0, 3, 5, 6


def scene(tracks=None, path=None, **other):
    """A scene on the middle one of three lanes, at 20 m/s, by default along x."""
    free = DrivingCommand(0.7, 1)
    values = {
        "stamp_s": 0.0,
        # The rear axle, which is half a length behind the centre.
        "world_from_ego": Pose.planar(-2.25, 0.0, 0.0),
        "speed_m_s": 20.0,
        "size": np.array([4.5, 1.8, 1.5]),
        "tracks": Tracks.empty(0.0, "world") if tracks is None else tracks,
        "lanes": 3,
        "lane": 1,
        "target_lane": 1,
        "desired_speed_m_s": 27.0,
        "allowed_speed_m_s": 24.0,
        "gap_m": np.inf,
        "leader_speed_m_s": 0.0,
        "line_m": np.inf,
        "path": np.column_stack([np.arange(50) * 2.0, np.zeros(50)]) if path is None else path,
        "model": free,
        "following": free,
    }
    return DrivingScene(**{**values, **other})


def tracks(places, velocities, category=Category.CAR):
    places = np.reshape(places, (-1, 2))
    velocities = np.reshape(velocities, (-1, 2)).astype(float)
    boxes = {"sizes": [1.5, 1.5, 1.5], "categories": category}
    return toy_boxes.tracks(places, np.arange(len(places)), velocities=velocities, **boxes)


def users_in(observation):
    return observation[11:].reshape(-1, 6)


def test_the_values_of_the_ego_and_of_the_road() -> None:
    observation = observed(scene(gap_m=25.0, leader_speed_m_s=12.0, line_m=30.0))
    assert observation.dtype == np.float32
    assert observation[:11] == pytest.approx([20 / 30, 0.8, 0.9, 0.5, -0.8, 1, 0.6, 1, 1, 0, 0])
    at_line = observed(scene(gap_m=25.0, leader_speed_m_s=12.0, line_m=15.0))
    assert at_line[3:7] == pytest.approx([0.3, -2, 1, 0.3])
    outer = observed(scene(lane=0, target_lane=0, lanes=1))
    assert outer[:11] == pytest.approx([20 / 30, 0.8, 0.9, 2, 0, 0, 2, 0, 0, 0, 0])


def test_a_new_target_lane_moves_no_road_user() -> None:
    """The path is then on another lane, but the others are where they were, relative to the ego."""
    others = tracks([[30.0, 4.0], [-12.0, 0.0]], [[15.0, -1.0], [22.0, 0.0]])
    before = observed(scene(others))
    lane_on_the_left = np.column_stack([np.arange(50) * 2.0, np.full(50, 4.0)])
    after = observed(scene(others, lane_on_the_left, target_lane=0))
    assert users_in(after) == pytest.approx(users_in(before), abs=1e-6)
    assert after[9:11] == pytest.approx([1.0, -1.0])


def test_the_values_of_a_track_ahead_on_the_left() -> None:
    users = users_in(observed(scene(tracks([[30.0, 4.0]], [[15.0, -1.0]]))))
    assert users[0] == pytest.approx([1, 0.6, 1, -0.5, -0.1, 0])
    assert not users[1:].any()
    walking = users_in(observed(scene(tracks([[9.0, -4]], [[0, 1.0]], Category.PEDESTRIAN))))
    assert walking[0] == pytest.approx([1, 0.18, -1, -2, 0.1, 1])


def test_the_ten_nearest_are_observed_nearest_first_and_no_distant_one() -> None:
    ahead = np.column_stack([np.linspace(80, 5, 14), np.zeros(14)])
    far = [[-41.0, 0.0], [91.0, 0.0], [10.0, 30.5], [10.0, -30.5]]
    places = np.concatenate([far, ahead])
    users = users_in(observed(scene(tracks(places, np.zeros((18, 2))))))
    assert 50 * users[:, 1] == pytest.approx(np.sort(ahead[:, 0])[:10], rel=1e-6)
    assert not users_in(observed(scene(tracks(far, np.zeros((4, 2)))))).any()


@given(
    yaw=st.floats(-3.1, 3.1),
    shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    bend=st.floats(-0.02, 0.02),
    seed=st.integers(0, 1000),
)
def test_an_observation_does_not_depend_on_where_the_road_is(yaw, shift, bend, seed) -> None:
    rng = np.random.default_rng(seed)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    headings = bend * np.arange(50) * 2.0
    path = np.cumsum(2.0 * np.column_stack([np.cos(headings), np.sin(headings)]), axis=0)
    places, velocities = rng.uniform((-30, -10), (80, 10), (6, 2)), rng.normal(0, 9, (6, 2))
    here = observed(scene(tracks(places, velocities), path))
    moved = Pose.planar(*(turn @ [-2.25, 0.0] + shift), yaw)
    moved_tracks = tracks(places @ turn.T + shift, velocities @ turn.T)
    there = observed(scene(moved_tracks, path @ turn.T + shift, world_from_ego=moved))
    assert there == pytest.approx(here, abs=1e-4)


@given(along=st.floats(-35, 85), left=st.floats(-11, 11))
def test_places_are_along_a_bend_and_beside_it(along, left) -> None:
    """On an arc of 200 m radius, and straight on before it."""
    radius = 200.0
    angles = np.arange(50) * 2.0 / radius
    path = radius * np.column_stack([np.sin(angles), 1 - np.cos(angles)])
    angle = max(along, 0.0) / radius
    ahead = np.array([np.cos(angle), np.sin(angle)])
    foot = radius * np.array([np.sin(angle), 1 - np.cos(angle)]) + min(along, 0.0) * ahead
    place = foot + left * np.array([-ahead[1], ahead[0]])
    user = users_in(observed(scene(tracks([place], [20.0 * ahead]), path)))[0]
    assert user[0] == 1
    # The path is a polygon with corners every 2 m, so its first direction is 0.005 rad off.
    assert 50 * user[1] == pytest.approx(along, abs=0.12)
    assert 4 * user[2] == pytest.approx(left, abs=0.05 + 0.005 * max(-along, 0.0))
    assert 10 * user[3:5] == pytest.approx([0, 0], abs=0.3)


def test_a_path_that_ends_at_once_is_taken_for_straight() -> None:
    northwards = {"path": np.zeros((50, 2)), "world_from_ego": Pose.planar(0.0, -2.25, np.pi / 2)}
    users = users_in(observed(scene(tracks([[-4.0, 30.0]], [[0.0, 15.0]]), **northwards)))
    assert users[0] == pytest.approx([1, 0.6, 1, -0.5, 0, 0])


def test_actions_accelerate_or_change_lanes() -> None:
    middle = scene()
    assert command_of(BRAKE, middle) == DrivingCommand(-8.0, 1)
    assert command_of(KEEP_SPEED, middle) == DrivingCommand(0.0, 1)
    assert command_of(LEFT, middle) == DrivingCommand(0.0, 0)
    assert command_of(RIGHT, middle) == DrivingCommand(0.0, 2)


def test_no_lane_change_to_nowhere_and_none_during_another() -> None:
    assert command_of(LEFT, scene(lane=0, target_lane=0)).target_lane == 0
    assert command_of(RIGHT, scene(lane=2, target_lane=2)).target_lane == 2
    assert command_of(RIGHT, scene(lane=0, target_lane=1)).target_lane == 1
    assert command_of(BRAKE, scene(lane=0, target_lane=1)).target_lane == 1


def random_layers(seed=0, sizes=(71, 64, 64, 7)):
    rng = np.random.default_rng(seed)
    return [
        (rng.normal(0, 0.3, (out, into)).astype(np.float32), rng.normal(0, 1, out).astype("f4"))
        for into, out in pairwise(sizes)
    ]


@given(seed=st.integers(0, 10_000))
def test_an_agent_does_what_its_network_in_torch_does(seed, tmp_path_factory) -> None:
    layers = random_layers(seed)
    path = tmp_path_factory.mktemp("agent") / "agent.safetensors"
    save_agent(path, layers)
    modules = []
    for weights, biases in layers:
        linear = torch.nn.Linear(weights.shape[1], weights.shape[0])
        linear.weight.data, linear.bias.data = torch.from_numpy(weights), torch.from_numpy(biases)
        modules += [linear, torch.nn.Tanh()]
    network = torch.nn.Sequential(*modules[:-1])
    rng = np.random.default_rng(seed)
    each = scene(tracks(rng.uniform((-30, -10), (80, 10), (6, 2)), rng.normal(0, 9, (6, 2))))
    with torch.no_grad():
        expected = int(network(torch.from_numpy(observed(each))).argmax())
    assert AgentDriver(weights=str(path)).drive(each) == command_of(expected, each)


def test_an_agent_decides_at_every_second_call(tmp_path) -> None:
    # It brakes below 15 m/s and keeps its speed above: the sign goes through both hidden layers.
    layers = [(np.zeros_like(weights), np.zeros_like(b)) for weights, b in random_layers()]
    (first, threshold), (second, _), (last, biases) = layers
    first[0, 0], threshold[0], second[0, 0], last[KEEP_SPEED, 0] = 30.0, -15.0, 1.0, 1.0
    biases[:] = -100.0
    biases[BRAKE] = biases[KEEP_SPEED] = 0.0
    path = tmp_path / "agent.safetensors"
    save_agent(path, layers)
    driver = AgentDriver(weights=str(path))
    speeds = (20.0, 10.0, 10.0, 20.0, 20.0)
    done = [driver.drive(scene(speed_m_s=speed)).acceleration_m_s2 for speed in speeds]
    assert done == [0.0, 0.0, -8.0, -8.0, 0.0]
    driver.reset()
    assert driver.drive(scene(speed_m_s=10.0)).acceleration_m_s2 == -8.0


def test_wrong_files_are_named_with_what_is_wrong(tmp_path) -> None:
    about = {"roadscope": '{"architecture": "driver-1"}'}
    layers = random_layers()
    tensors = {f"weights.{k}": weights for k, (weights, _) in enumerate(layers)}
    tensors |= {f"biases.{k}": biases for k, (_, biases) in enumerate(layers)}
    not_finite = {**tensors, "biases.1": np.full(64, np.nan, np.float32)}
    narrow = {**tensors, "weights.0": np.zeros((64, 70), np.float32)}
    flat = {**tensors, "biases.0": np.array(1.0, np.float32)}
    renamed = {**{k: v for k, v in tensors.items() if k != "biases.0"}, "other": np.zeros(1)}
    cases = {
        "not finite": (not_finite, about, "finite"),
        "narrow": (narrow, about, r"\(64, 71\)"),
        "flat": (flat, about, r"\(64,\), got \(\)"),
        "renamed": (renamed, about, "biases.0"),
        "foreign": (tensors, None, "architecture"),
        "empty": ({}, about, "weights.0"),
    }
    for name, (content, metadata, message) in cases.items():
        path = tmp_path / f"{name}.safetensors"
        save_file(content, path, metadata)
        with pytest.raises(ValueError, match=message):
            load_agent(path)
    (tmp_path / "text.safetensors").write_text("no tensors")
    with pytest.raises(ValueError, match=r"text.safetensors"):
        load_agent(tmp_path / "text.safetensors")
    with pytest.raises(ValueError, match=r"cannot read .*missing.safetensors"):
        load_agent(tmp_path / "missing.safetensors")
    with pytest.raises(ValueError, match="no agent 'nobody': expected perceived, truth or"):
        AgentDriver(weights="nobody")
    with pytest.raises(ValueError, match="'Bring your own' prints one for Stable-Baselines3"):
        AgentDriver(weights="ppo.zip")


@pytest.mark.parametrize("name", ["truth", "perceived"])
def test_a_shipped_agent_is_the_one_of_its_record(name) -> None:
    folder = Path(roadscope.driving.__file__).parent / "agents"
    record = tomllib.loads((folder / f"{name}.toml").read_text("utf-8"))
    content = (folder / f"{name}.safetensors").read_bytes()
    assert record["weights"] == sha256(content).hexdigest()
    assert record["scores"]["truth"]["drives"] >= 30
    agent = AgentDriver(weights=name)
    assert agent.drive(scene(lanes=1, lane=0, target_lane=0)).acceleration_m_s2 >= 0
    agent.reset()
    ahead = {"gap_m": 20.0, "tracks": tracks([(20.0 + 2.25, 0.0)], [(0.0, 0.0)])}
    assert agent.drive(scene(lanes=1, lane=0, target_lane=0, **ahead)).acceleration_m_s2 <= -4


def test_a_written_agent_is_read_as_it_was(tmp_path) -> None:
    layers = random_layers()
    save_agent(tmp_path / "agent.safetensors", layers)
    for written, read in zip(layers, load_agent(tmp_path / "agent.safetensors"), strict=True):
        np.testing.assert_array_equal(written[0], read[0])
        np.testing.assert_array_equal(written[1], read[1])


def test_values_are_limited() -> None:
    fast = scene(tracks([[5.0, 0.0]], [[-300.0, 300.0]]), speed_m_s=500.0)
    assert abs(observed(fast)).max() == 4.0
    assert observed(replace(fast, desired_speed_m_s=1e6)).max() == 4.0
