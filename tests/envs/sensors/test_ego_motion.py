import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from roadscope.envs.sensors import (
    RAW_S,
    STANDARD_GRAVITY_M_S2,
    STATES_AHEAD,
    BodySway,
    EgoMotion,
    settled_s,
)
from roadscope.envs.traffic import Timeline, TrafficRecorder, record
from tests.envs.sensors.inertial_drives import STEP_S, at_rest, steady, stop_and_go
from tests.envs.sensors.test_sensing import shortened

POINT = np.array([1.3, 0.4, 0.6])
SWAYS = pytest.mark.parametrize("sway", [None, BodySway()], ids=["level", "swaying"])


def raw(name: str, seed: int) -> Timeline:
    """Record a foreign environment whose ego is driven at random until it crashes or ends."""
    import gymnasium as gym
    import highway_env  # noqa: F401  (registers its ids)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        env: Any = gym.make(name)
        env.reset(seed=seed)
    env.action_space.seed(seed)
    recorder = TrafficRecorder(seed=seed)
    recorder.attach(env.unwrapped)
    for _ in range(12):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            break
    return recorder.timeline()


def fine(timeline: Timeline) -> np.ndarray:
    return np.arange(timeline.start_s, timeline.end_s, 1 / 400)


@SWAYS
def test_velocities_and_accelerations_are_derivatives(sway: BodySway | None) -> None:
    motion, h = EgoMotion(stop_and_go(), sway), 1e-5
    stamps = np.random.default_rng(0).uniform(0.1, 20.0, 200)
    before, here, after = (motion.at(stamps + d, POINT) for d in (-h, 0.0, h))
    np.testing.assert_allclose(
        here.velocities, (after.positions - before.positions) / (2 * h), atol=2e-6
    )
    # Across a knot the acceleration bends.
    np.testing.assert_allclose(
        here.accelerations, (after.velocities - before.velocities) / (2 * h), atol=2e-3
    )
    skew = np.swapaxes(here.rotations, 1, 2) @ (after.rotations - before.rotations) / (2 * h)
    turning = np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]])
    np.testing.assert_allclose(here.angular_velocities, turning, atol=2e-6)


def test_the_path_is_within_two_millimetres_of_the_recorded_one() -> None:
    timeline = record("roundabout", 10_003, 5.0)
    stamps = fine(timeline)
    here, recorded = EgoMotion(timeline).at(stamps), timeline.at(stamps)
    away = np.linalg.norm(here.positions[:, :2] - recorded.axles[:, 0], axis=1)
    assert 1e-5 < away.max() < 0.002
    yaws = np.unwrap(np.arctan2(here.rotations[:, 1, 0], here.rotations[:, 0, 0]))
    assert np.abs(yaws - recorded.yaws[:, 0] + recorded.yaws[0, 0] - yaws[0]).max() < 0.003


FELT_M_S2, FELT_M_S3, FELT_RAD_S = 16.0, 100.0, 1.5
"""Bound for crashes and lane changes at 1.6 g; raw recorded states jump by 68 m/s^2."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["highway-v0", "roundabout-v1", "racetrack-v1", "merge-v0"])
@pytest.mark.parametrize("seed", range(2))
def test_raw_recordings_and_crashes_leave_no_spikes(name: str, seed: int) -> None:
    timeline = raw(name, seed)
    assert timeline.raw
    stamps = fine(timeline)
    here = EgoMotion(timeline).at(stamps[stamps < settled_s(timeline)])
    assert np.linalg.norm(here.accelerations, axis=1).max() < FELT_M_S2
    assert np.abs(here.angular_velocities[:, 2]).max() < FELT_RAD_S
    jerks = np.linalg.norm(np.diff(here.accelerations, axis=0), axis=1) * 400
    assert jerks.max() < FELT_M_S3
    recorded = timeline.at(stamps[stamps < settled_s(timeline)])
    away = np.linalg.norm(here.positions[:, :2] - recorded.axles[:, 0], axis=1)
    assert away.max() < 0.3


def test_raw_recordings_do_jump() -> None:
    """The reason of the bound above."""
    timeline = raw("roundabout-v1", 1)
    steps = np.diff(timeline.stamps_s)[:, None]
    jumps = np.diff(np.diff(timeline.axles[:, 0], axis=0) / steps, axis=0) / steps[1:]
    assert np.linalg.norm(jumps, axis=1).max() > 4 * FELT_M_S2


@SWAYS
@pytest.mark.parametrize("raw", [False, True], ids=["smooth", "raw"])
def test_what_is_settled_stays_as_it_is(sway: BodySway | None, raw: bool) -> None:
    whole = replace(stop_and_go(), raw=raw)
    part = shortened(whole, 7.0)
    assert settled_s(part) == pytest.approx(7.0 - STATES_AHEAD * STEP_S - raw * RAW_S)
    stamps = np.arange(0.0, settled_s(part), 0.001)
    early, late = (EgoMotion(t, sway).at(stamps, POINT) for t in (part, whole))
    assert early == late
    beyond = np.array([7.0])
    assert EgoMotion(part, sway).at(beyond) != EgoMotion(whole, sway).at(beyond)


def test_a_vehicle_at_rest_rests() -> None:
    here = EgoMotion(at_rest(), BodySway()).at(np.arange(0.0, 3.0, 0.01), POINT)
    for array in (here.velocities, here.accelerations, here.angular_velocities):
        assert np.abs(array).max() < 1e-10
    np.testing.assert_allclose(here.positions - [50.0, 2.0, 0.0], np.tile(POINT, (300, 1)))


def test_the_nose_rises_when_speeding_up_and_the_body_leans_out_of_curves() -> None:
    sway = BodySway()
    gradient = np.radians([sway.pitch_deg_per_g, sway.roll_deg_per_g]) / STANDARD_GRAVITY_M_S2
    limit = sway.limit_m_s2
    ahead = EgoMotion(steady(2.0, 0.0, 5.0), sway).at(np.array([4.0])).rotations[0]
    expected = -gradient[0] * limit * np.tanh(2.0 / limit)
    assert -np.arcsin(ahead[2, 0]) == pytest.approx(expected, rel=0.02)
    left = EgoMotion(steady(0.0, 0.02, 10.0), sway).at(np.array([4.0])).rotations[0]
    expected = gradient[1] * limit * np.tanh(2.0 / limit)
    assert np.arctan2(left[2, 1], left[2, 2]) == pytest.approx(expected, rel=0.02)
    # The right side goes down.
    assert (left @ [0.0, -1.0, 0.0])[2] < 0


def test_a_body_swings_and_comes_to_rest_again() -> None:
    rotations = EgoMotion(stop_and_go(), BodySway()).at(np.arange(6.0, 11.0, 0.01)).rotations
    pitch = -np.arcsin(rotations[:, 2, 0])
    assert pitch.max() > 1.15 * np.radians(1.5) * 3.0 / 9.81 * 0.95
    assert np.abs(pitch[-20:]).max() < 0.05 * pitch.max()


@pytest.mark.parametrize(
    "field", [{"damping": 1.0}, {"damping": 0.0}, {"frequency_hz": 0.0}, {"roll_deg_per_g": -1.0}]
)
def test_impossible_bodies_are_refused(field: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=f"BodySway.{next(iter(field))}: expected"):
        BodySway(**field)
