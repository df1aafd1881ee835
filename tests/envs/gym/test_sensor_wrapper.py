import copy
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import highway_env  # noqa: F401  (registers its ids)
import numpy as np
import pytest
from highway_env.vehicle.behavior import IDMVehicle

import roadscope  # noqa: F401  (registers ours)
from roadscope.core import WEATHER, Pose, RecordError
from roadscope.envs import find_rig
from roadscope.envs.gym import SensorWrapper
from roadscope.envs.imaging import Light
from roadscope.envs.sensors import IMUS, BodySway, DeadReckoning, ImuMount, Sensing
from roadscope.envs.traffic import DRIVER_CONSTANTS, ForeignEnvError, restore_driver_constants

# highway-env keeps old versions of its ids for comparison; Gymnasium says so at every make.
pytestmark = pytest.mark.filterwarnings("ignore:.*is out of date:DeprecationWarning")

MULTI_AGENT = [
    "intersection-multi-agent-v0",
    "intersection-multi-agent-v1",
    "intersection-multi-agent-v2",
]
SINGLE_AGENT = sorted(
    name
    for name, spec in gym.registry.items()
    if str(spec.entry_point).startswith("highway_env.") and name not in MULTI_AGENT
)

LATEST = list({name.rpartition("-v")[0]: name for name in SINGLE_AGENT}.values())
"""Without earlier versions of the same roads."""


@pytest.fixture(autouse=True)
def _original_drivers() -> Any:
    restore_driver_constants()
    yield
    restore_driver_constants()


def actions(env: gym.Env[Any, Any], count: int) -> list[Any]:
    space = copy.deepcopy(env.action_space)
    space.seed(5)
    return [space.sample() for _ in range(count)]


def traffic(env: gym.Env[Any, Any]) -> list[tuple[Any, ...]]:
    road = env.unwrapped.road  # type: ignore[attr-defined]
    return [
        (*v.position.tolist(), float(v.heading), float(v.speed), bool(v.crashed))
        for v in road.vehicles
    ]


def play(env: gym.Env[Any, Any], steps: int = 2, seed: int = 3) -> list[Any]:
    env.reset(seed=seed)
    history: list[Any] = [traffic(env)]
    for action in actions(env, steps):
        _, reward, terminated, truncated, _ = env.step(action)
        history.append((traffic(env), float(reward), bool(terminated), bool(truncated)))
        if terminated or truncated:
            break
    history.append(env.unwrapped.np_random.bit_generator.state["state"])
    return history


def same(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> bool:
    return a.keys() == b.keys() and all(a[key].tobytes() == b[key].tobytes() for key in a)


def test_there_are_28_single_agent_ids() -> None:
    assert len(SINGLE_AGENT) == 28


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", LATEST)
def test_traffic_is_the_same_to_the_bit_and_observations_fit(name: str) -> None:
    foreign = gym.make(name)
    bare = play(foreign)
    own = foreign.step(actions(foreign, 1)[0])[4].keys()
    restore_driver_constants()
    env = SensorWrapper(gym.make(name), "lux")
    assert play(env) == bare
    observation, info = env.reset(seed=3)
    assert observation in env.observation_space
    assert (observation["lidar_range"] > 0).any()
    observation, _, _, _, info = env.step(actions(env, 1)[0])
    assert observation in env.observation_space
    assert info["frames"]
    assert len(info["frames"]) == len(info["truths"])
    assert own <= info.keys()


@pytest.mark.parametrize("name", MULTI_AGENT)
def test_multi_agent_environments_are_refused_by_name(name: str) -> None:
    with pytest.raises(ForeignEnvError, match=f"{name}.*such as 'intersection-v2'"):
        SensorWrapper(gym.make(name, disable_env_checker=True))


def test_other_environments_are_refused_by_name() -> None:
    with pytest.raises(ForeignEnvError, match="CartPole-v1"):
        SensorWrapper(gym.make("CartPole-v1"))


@pytest.mark.parametrize("name", ["roadscope/Merge-v0", "roadscope/Lu2018Occlusion-v0"])
def test_an_error_for_a_second_sensor_wrapper_names_the_first(name: str) -> None:
    with pytest.raises(ForeignEnvError, match=f"'{name}' already has sensors; .* gym.make"):
        SensorWrapper(gym.make(name, rig="lux"))


def test_wrapping_twice_is_refused_even_below_other_wrappers() -> None:
    once = SensorWrapper(gym.make("merge-v1"), "lux")
    for env in (once, gym.wrappers.FlattenObservation(once)):
        with pytest.raises(ForeignEnvError, match=r"'merge-v1' already has .* of SensorWrapper"):
            SensorWrapper(env, "lux")


@pytest.mark.parametrize("rig", [5, None, Path("mine.toml")])
def test_an_error_for_a_wrong_rig_names_what_is_accepted(rig: Any) -> None:
    with pytest.raises(TypeError, match=f"rig: expected the name .* got {type(rig).__name__}"):
        SensorWrapper(gym.make("merge-v1"), rig)


@pytest.mark.parametrize(
    ("seed", "error", "message"),
    [
        (-1, ValueError, "seed: expected a whole number from 0 up, got -1"),
        ("a", TypeError, "seed: expected a whole number or None, got 'a'"),
        (1.5, TypeError, "seed: expected a whole number or None, got 1.5"),
        (True, TypeError, "seed: expected a whole number or None, got True"),
    ],
)
def test_seeds_are_checked_before_an_episode(
    seed: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        SensorWrapper(gym.make("merge-v1"), "lux", seed=seed)


def test_seeds_may_be_integers_of_numpy() -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux", seed=np.uint64(7))  # type: ignore[arg-type]
    assert env.reset()[0] in env.observation_space


def test_unknown_rigs_styles_and_weathers_are_answered_with_what_is_possible() -> None:
    env = gym.make("merge-v1")
    with pytest.raises(RecordError, match="no rig 'radar'; known: lux"):
        SensorWrapper(env, "radar")
    with pytest.raises(RecordError, match="no roadside style 'moon'; known: motorway"):
        SensorWrapper(env, style="moon")
    with pytest.raises(ValueError, match=r"no weather 'fgo' \(did you mean 'fog'"):
        SensorWrapper(env, weather="fgo")
    with pytest.raises(TypeError, match="weather: expected a name or a Weather, got 3"):
        SensorWrapper(env, weather=3)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no light 'noon'; known: day"):
        SensorWrapper(env, light="noon")
    for light in ("night", Light()):
        with pytest.raises(RecordError, match="rig 'lux' has no camera"):
            SensorWrapper(env, "lux", light=light)
    SensorWrapper(env, "lux", light="day")
    with pytest.raises(ValueError, match="light 'dusk' and fault 'night:2' both say"):
        SensorWrapper(env, light="dusk", faults="night:2")


def test_a_position_that_is_not_finite_raises_an_error() -> None:
    env = SensorWrapper(gym.make("lane-keeping-v0").unwrapped, "lux")
    env.reset(seed=0)
    env.unwrapped.vehicle.position[0] = np.nan  # type: ignore[attr-defined]
    with pytest.raises(RecordError, match=r"Timeline.axles: must be finite, got nan"):
        env.step(np.zeros(1))


def test_a_slow_policy_gets_every_sweep_of_a_fast_lidar() -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux")
    _, info = env.reset(seed=0)
    assert info["frames"] == ()
    stamps = []
    for _ in range(4):
        *_, info = env.step(1)
        assert len(info["frames"]) in (12, 13)
        assert info["truth"] == info["truths"][-1]
        stamps += [frame.stamp_s for frame in info["frames"]]
        assert [truth.stamp_s for truth in info["truths"]] == stamps[-len(info["frames"]) :]
        assert stamps[-1] <= info["time_s"] < stamps[-1] + 0.2
    mount = find_rig("lux").lidar
    assert stamps == [mount.stamp_s(index) for index in range(len(stamps))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "weather"), [("highway-fast-v0", "clear"), ("intersection-v2", "fog-4")]
)
def test_live_frames_equal_those_of_the_whole_recording(name: str, weather: str) -> None:
    env = SensorWrapper(gym.make(name), "lux", style="urban", weather=weather)
    env.reset(seed=4)
    frames, truths = [], []
    for action in actions(env, 3):
        *_, info = env.step(action)
        frames += info["frames"]
        truths += info["truths"]
    whole = env.recording()
    sensing = Sensing(find_rig("lux"), 4, "urban", weather=weather)
    again = sensing.advance(whole, whole.end_s)
    assert any((truth.sources == WEATHER).any() for truth in truths) == (weather != "clear")
    assert len(again) == len(frames) > 10
    for (frame, truth), live, live_truth in zip(again, frames, truths, strict=True):
        assert frame == live
        assert truth == live_truth


def test_live_frames_equal_those_of_the_recording_when_a_reset_changed_the_rate() -> None:
    config = {"vehicles_count": 3, "simulation_frequency": 30}
    env = SensorWrapper(gym.make("highway-v0", config=config), "vlp16-imu", style="urban")
    env.reset(seed=4, options={"config": {"simulation_frequency": 3}})
    frames = [frame for action in (1, 3, 1, 4, 1) for frame in env.step(action)[-1]["frames"]]
    whole = env.recording()
    again = Sensing(find_rig("vlp16-imu"), 4, "urban").advance(whole, whole.end_s)
    assert len(frames) > 10
    assert frames == [frame for frame, _ in again]


def test_an_episode_that_begins_below_the_sensors_is_an_error() -> None:
    inner = gym.make("highway-v0", config={"vehicles_count": 3, "duration": 1})
    env = SensorWrapper(gym.wrappers.Autoreset(inner), "lux")
    env.reset(seed=0)
    assert env.step(1)[3]
    with pytest.raises(ForeignEnvError, match="Autoreset around SensorWrapper"):
        env.step(1)
    env.reset(seed=0)
    env.unwrapped.reset(seed=1)
    with pytest.raises(ForeignEnvError, match="reset"):
        env.step(1)


@pytest.mark.slow
def test_live_frames_with_inertial_sensors_equal_those_of_the_recording() -> None:
    """Longer than the wrapper's history, in an environment whose motion jumps."""
    unit = ImuMount("imu", IMUS["adis16448"], Pose.planar(0.0, 0.0, 0.0, 0.5))
    carrier = replace(
        find_rig("lux"), imu=unit, sway=BodySway(), dead_reckoning=DeadReckoning(0.0, 0.0, 0.0, 0.0)
    )
    env = SensorWrapper(gym.make("highway-v0"), carrier, style="urban")
    env.reset(seed=4)
    frames, truths = [], []
    for action in (4, 4, 0, 2, 1, 0, 2):
        *_, info = env.step(action)
        frames += info["frames"]
        truths += info["truths"]
    assert frames[-1].stamp_s > env._history_s + 1.0
    whole = env.recording()
    again = Sensing(carrier, 4, "urban").advance(whole, whole.end_s)
    assert len(again) == len(frames)
    for (frame, truth), live, live_truth in zip(again, frames, truths, strict=True):
        assert frame == live
        assert truth == live_truth
    for before, (frame, truth) in zip(truths, again[1:], strict=False):
        step = before.world_from_ego.inverse() @ truth.world_from_ego
        motion = frame.previous_from_ego
        assert motion.translation[:2] == pytest.approx(step.translation[:2], abs=0.02)
        assert motion.yaw == pytest.approx(step.yaw, abs=0.002)


def test_the_observation_is_the_latest_scan_in_fresh_arrays() -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux")
    first, _ = env.reset(seed=0)
    second, _, _, _, info = env.step(1)
    scan = info["frames"][-1].lidar
    filled = np.zeros_like(second["lidar_range"])
    filled[scan.ring, scan.column] = np.linalg.norm(scan.points, axis=1)
    np.testing.assert_allclose(second["lidar_range"], filled, rtol=1e-6)
    assert all(not np.shares_memory(first[key], second[key]) for key in first)
    second["lidar_range"][:] = -1
    third, *_ = env.step(1)
    assert (third["lidar_range"] >= 0).all()


@pytest.mark.slow
def test_same_seed_same_bytes_and_resets_without_seed_go_on_from_it() -> None:
    def run(env: SensorWrapper, seed: int) -> list[dict[str, np.ndarray]]:
        observations = [env.reset(seed=seed)[0], env.step(1)[0], env.reset()[0], env.step(1)[0]]
        return observations

    one, two = (SensorWrapper(gym.make("merge-v1"), "lux") for _ in range(2))
    first, again, other = run(one, 8), run(two, 8), run(two, 9)
    assert all(map(same, first, again))
    assert all(map(same, first, run(one, 8)))
    assert not any(map(same, first, other))
    assert not same(first[1], first[3])


def test_the_constructors_seed_counts_until_reset_brings_one() -> None:
    def noise(seed: int, reset: int | None) -> np.ndarray:
        env = SensorWrapper(gym.make("lane-keeping-v0"), "lux", seed=seed)
        if reset is None:
            # The traffic alone, so that only the sensors differ.
            env.env.unwrapped.reset(seed=0)
        return env.reset(seed=reset)[0]["lidar_range"]

    np.testing.assert_array_equal(noise(1, None), noise(1, None))
    assert not np.array_equal(noise(1, None), noise(2, None))
    np.testing.assert_array_equal(noise(1, 7), noise(2, 7))


def test_driver_constants_stay_with_their_environment() -> None:
    crossing = SensorWrapper(gym.make("intersection-v2"), "lux")
    restore_driver_constants()
    alone = play(crossing)
    assert all(getattr(IDMVehicle, name) == value for name, value in DRIVER_CONSTANTS.items())

    IDMVehicle.DISTANCE_WANTED = 33.0
    crossing.reset(seed=3)
    history = [traffic(crossing)]
    for action in actions(crossing, 2):
        IDMVehicle.COMFORT_ACC_MAX = 0.1
        _, reward, terminated, truncated, _ = crossing.step(action)
        history.append((traffic(crossing), float(reward), terminated, truncated))
        assert IDMVehicle.COMFORT_ACC_MAX == 0.1
    assert IDMVehicle.DISTANCE_WANTED == 33.0
    assert history == alone[:-1]


@pytest.mark.parametrize("twin", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_are_independent(twin: Any) -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux")
    env.reset(seed=0)
    env.step(1)
    other = twin(env)
    expected = [env.step(action)[0] for action in (0, 1)]
    observations = [other.step(action)[0] for action in (0, 1)]
    assert all(map(same, expected, observations))


@pytest.mark.parametrize(
    ("name", "action"),
    [
        ("merge-v1", 5),
        ("merge-v1", -1),
        ("merge-v1", 1.5),
        ("merge-v1", "left"),
        ("racetrack-v1", [2.0]),
        ("racetrack-v1", [np.nan]),
        ("racetrack-v1", [0.0, 0.0]),
        ("racetrack-v1", None),
    ],
)
def test_actions_outside_the_space_are_refused_before_anything_moves(
    name: str, action: Any
) -> None:
    env = SensorWrapper(gym.make(name), "lux")
    env.reset(seed=0)
    before = traffic(env)
    with pytest.raises(ValueError, match=r"action .* lies outside the action space"):
        env.step(action)
    assert traffic(env) == before


def test_actions_of_any_float_type_are_taken() -> None:
    env = SensorWrapper(gym.make("racetrack-v1"), "lux")
    env.reset(seed=0)
    action = np.array([0.1])
    *_, info = env.step(action)
    assert not np.shares_memory(info["action"], action)
    env.step([0.1])


def test_stepping_drawing_or_recording_before_a_reset_is_refused() -> None:
    env = SensorWrapper(gym.make("merge-v1", render_mode="rgb_array").unwrapped, "lux")
    with pytest.raises(gym.error.ResetNeeded):
        env.step(1)
    with pytest.raises(gym.error.ResetNeeded):
        env.render()
    with pytest.raises(gym.error.ResetNeeded, match=r"recording\(\) before reset\(\)"):
        env.recording()


def test_infos_without_records() -> None:
    env = SensorWrapper(gym.make("merge-v1"), "lux", records=False)
    env.reset(seed=0)
    *_, info = env.step(1)
    assert "frames" not in info
    assert "truths" not in info
    assert info["truth"].lidar_returns.sum() >= 0


@pytest.mark.parametrize("faults", ["clear", "dropped-scans:5"])
def test_observations_without_records_are_the_same(faults: str) -> None:
    with_records, without = (
        SensorWrapper(gym.make("merge-v1"), "lux", faults=faults, records=records)
        for records in (True, False)
    )
    observed, _ = with_records.reset(seed=3)
    np.testing.assert_equal(without.reset(seed=3)[0], observed)
    for _ in range(4):
        observed, *_, info = with_records.step(1)
        same, *_, short_info = without.step(1)
        np.testing.assert_equal(same, observed)
        np.testing.assert_array_equal(
            short_info["truth"].lidar_returns, info["truth"].lidar_returns
        )


def test_the_own_speed_and_lane_are_observed() -> None:
    env = SensorWrapper(gym.make("racetrack-v1"), "lux")
    env.reset(seed=0)
    for _ in range(2):
        observation, *_ = env.step(np.array([0.3], np.float32))
    vehicle = env.unwrapped.vehicle  # type: ignore[attr-defined]
    slip = np.arctan(np.tan(vehicle.action["steering"]) / 2)
    assert observation["ego"][0] == pytest.approx(vehicle.speed * np.cos(slip), rel=1e-3)
    assert np.sign(observation["ego"][1]) == -np.sign(vehicle.action["steering"])


def test_the_goal_is_observed_in_the_ego_frame() -> None:
    env = SensorWrapper(gym.make("parking-v0"), "lux")
    observation, _ = env.reset(seed=0)
    vehicle = env.unwrapped.vehicle  # type: ignore[attr-defined]
    away = vehicle.goal.position - vehicle.position
    cos, sin = np.cos(vehicle.heading), np.sin(vehicle.heading)
    ahead, right = away @ (cos, sin), away @ (-sin, cos)
    x, y, *_ = observation["goal"]
    assert (x - vehicle.LENGTH / 2, y) == pytest.approx((ahead, -right), abs=1e-3)


def test_the_picture_shows_the_scan_and_works_without_a_screen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    env = SensorWrapper(gym.make("merge-v1", render_mode="rgb_array"), "lux")
    env.reset(seed=0)
    first = env.render()
    env.step(1)
    second = env.render()
    assert first.dtype == np.uint8
    assert first.ndim == 3
    assert first.shape[2] == 3
    assert first.shape == second.shape
    assert (first != second).any()
    assert env.metadata["render_fps"] == 1


def test_closing_twice_closes_what_is_wrapped(monkeypatch: pytest.MonkeyPatch) -> None:
    env = SensorWrapper(gym.make("merge-v1"))
    closed, inner = [], env.unwrapped.close
    monkeypatch.setattr(env.unwrapped, "close", lambda: (closed.append(True), inner()))
    env.reset(seed=0)
    env.close()
    env.close()
    assert closed == [True, True]
