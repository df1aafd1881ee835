import copy
import pickle

import gymnasium as gym
import highway_env  # noqa: F401
import numpy as np
import pytest

from roadscope.core import Category
from roadscope.envs.traffic import (
    ForeignEnvError,
    RecordedRegulatedRoad,
    RecordedRoad,
    TrafficRecorder,
    rear_axles,
    restore_driver_constants,
)


def drive(env, steps, recorder=None, seed=3):
    restore_driver_constants()
    env.reset(seed=seed)
    if recorder is not None:
        recorder.attach(env)
    env.action_space.seed(1)
    states = []
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        states += [
            (*v.position, v.heading, v.speed, v.crashed) for v in env.unwrapped.road.vehicles
        ]
        if terminated or truncated:
            break
    return np.array(states)


def make(name):
    return gym.make(name, disable_env_checker=True)


@pytest.mark.parametrize(
    "name", ["highway-fast-v0", "intersection-v1", "parking-parked-v0", "u-turn-v1"]
)
@pytest.mark.filterwarnings("ignore:.*")
def test_recording_changes_no_bit_of_the_traffic(name):
    """All ids: `test_sensor_wrapper.py`."""
    env = make(name)
    without = drive(env, 4)
    recorder = TrafficRecorder(seed=5)
    assert drive(env, 4, recorder).tobytes() == without.tobytes()
    timeline = recorder.timeline()
    here = timeline.present[-1]
    assert here.sum() >= 1
    assert timeline.raw
    env.close()


@pytest.mark.filterwarnings("ignore:.*")
def test_timeline_holds_the_states_of_the_road():
    env = make("highway-v0")
    recorder = TrafficRecorder()
    drive(env, 2, recorder)
    timeline = recorder.timeline()
    assert timeline.start_s == 0.0
    assert timeline.end_s == pytest.approx(2.0, abs=1e-12)
    assert len(timeline.stamps_s) == 31
    vehicles = env.unwrapped.road.vehicles
    centres = np.array([v.position for v in vehicles]) * (1, -1)
    yaws = -np.array([v.heading for v in vehicles])
    ahead = np.stack([np.cos(yaws), np.sin(yaws)], axis=-1)
    order = [vehicle.actor_id for vehicle in vehicles]
    assert order[0] == 0
    np.testing.assert_allclose(timeline.axles[-1][order], centres - 2.5 * ahead, atol=1e-12)
    np.testing.assert_allclose(timeline.yaws[-1][order], yaws, atol=1e-12)


@pytest.mark.filterwarnings("ignore:.*")
def test_time_is_counted_from_physics_steps():
    env = gym.make(
        "highway-fast-v0",
        config={"simulation_frequency": 25, "policy_frequency": 2},
        disable_env_checker=True,
    )
    recorder = TrafficRecorder()
    drive(env, 3, recorder)
    assert env.unwrapped.time == 1.5
    assert recorder.stamp_s == pytest.approx(1.44, abs=1e-12)
    np.testing.assert_allclose(np.diff(recorder.timeline().stamps_s), 0.04)


@pytest.mark.filterwarnings("ignore:.*")
def test_copies_and_pickles_record_independently():
    for name, kind in (
        ("highway-fast-v0", RecordedRoad),
        ("intersection-v0", RecordedRegulatedRoad),
    ):
        env = make(name)
        recorder = TrafficRecorder()
        drive(env, 1, recorder)
        for twin in (copy.deepcopy(env.unwrapped), pickle.loads(pickle.dumps(env.unwrapped))):
            assert type(twin.road) is kind
            before = recorder.timeline()
            twin.step(1)
            assert recorder.timeline() == before
            assert twin.road.recorder.stamp_s == pytest.approx(2.0)
            assert twin.road.recorder.timeline().ids[0] == 0
        env.step(1)
        assert recorder.stamp_s == pytest.approx(2.0)


@pytest.mark.filterwarnings("ignore:.*")
def test_vehicles_come_and_go_with_new_ids():
    env = make("intersection-v0")
    recorder = TrafficRecorder()
    restore_driver_constants()
    env.reset(seed=1)
    recorder.attach(env)
    for _ in range(12):
        env.step(1)
    timeline = recorder.timeline()
    assert not timeline.present[0].all()
    assert not timeline.present[-1].all()
    edges = np.abs(np.diff(timeline.present.astype(int), axis=0)).sum(axis=0)
    assert (edges <= 2).all()
    assert (edges[timeline.present[0] & timeline.present[-1]] == 0).all()


@pytest.mark.filterwarnings("ignore:.*")
def test_a_window_is_the_end_of_the_whole():
    env = make("highway-v0")
    recorder = TrafficRecorder()
    drive(env, 3, recorder)
    whole, window = recorder.timeline(), recorder.timeline(0.5)
    assert window.end_s == whole.end_s
    assert whole.end_s - 0.5 - 1 / 15 - 1e-9 <= window.start_s <= whole.end_s - 0.5 + 1e-9
    at = np.linspace(window.start_s, window.end_s, 17)
    columns = np.searchsorted(whole.ids, window.ids)
    np.testing.assert_allclose(whole.at(at).axles[:, columns], window.at(at).axles, atol=1e-12)
    np.testing.assert_array_equal(whole.sizes[columns], window.sizes)


@pytest.mark.filterwarnings("ignore:.*")
def test_dressing_depends_on_its_seed_only_and_the_ego_is_a_car():
    env = make("highway-v0")
    first, again, other = TrafficRecorder(seed=1), TrafficRecorder(seed=1), TrafficRecorder(seed=2)
    for recorder in (first, again, other):
        drive(env, 1, recorder)
    assert first.timeline() == again.timeline()
    assert not np.array_equal(first.timeline().sizes, other.timeline().sizes)
    assert len(set(first.timeline().categories.tolist())) >= 3
    assert first.timeline().categories[0] == Category.CAR
    assert first.timeline().sizes[:, 0].max() < 12.5


@pytest.mark.filterwarnings("ignore:.*")
def test_obstacles_are_recorded_and_landmarks_are_not():
    env = make("merge-v0")
    recorder = TrafficRecorder()
    drive(env, 1, recorder)
    np.testing.assert_allclose(recorder.timeline().obstacles[:, 3:5], [[2.0, 2.0]])
    env = make("parking-v0")
    drive(env, 1, recorder)
    np.testing.assert_allclose(sorted(recorder.timeline().obstacles[:, 3]), [42, 42, 70, 70])


@pytest.mark.parametrize("name", ["intersection-multi-agent-v0", "CartPole-v1"])
@pytest.mark.filterwarnings("ignore:.*")
def test_an_error_for_an_unsuitable_environment_names_it(name):
    env = make(name)
    env.reset(seed=0)
    with pytest.raises(ForeignEnvError, match=name):
        TrafficRecorder().attach(env)


def test_rear_axles_move_along_their_heading():
    """The step that highway-env makes, done finely, moves the rear axle without slip."""
    steering, speed, half, dt = 0.3, 8.0, 2.5, 1e-5
    slip = np.arctan(np.tan(steering) / 2)
    headings = 0.4 + np.array([0.0, speed * np.sin(slip) / half * dt])
    step = speed * dt * np.array([np.cos(0.4 + slip), np.sin(0.4 + slip)])
    centres = np.array([1.0, 2.0]) + np.stack([np.zeros(2), step])
    states = np.stack([headings, [speed] * 2, [steering] * 2], axis=-1)
    axles, yaws, speeds = rear_axles(centres, states, np.array([half, half]))
    moved = (axles[1] - axles[0]) / dt
    np.testing.assert_allclose(
        moved, speeds[0] * np.array([np.cos(yaws[0]), np.sin(yaws[0])]), atol=1e-3
    )
