"""Traffic in which the ego obeys commands and all others react."""

import numpy as np
import pytest

from roadscope.core import DrivingCommand, Tracks
from roadscope.envs.traffic import DrivenTraffic, ScenarioError, record

STEP_S = 0.05


def driven(scenario, seed, duration_s, choose):
    """Drive with the command of `choose(traffic)` at every step, until the ego collides."""
    traffic = DrivenTraffic(scenario, seed, duration_s)
    while traffic.now_s < duration_s - STEP_S / 2 and traffic.collided_with is None:
        traffic.step(choose(traffic))
    return traffic


def on_truth(traffic):
    return traffic.outlook(traffic.true_tracks()).model


def on_nothing(traffic):
    return traffic.outlook(Tracks.empty(traffic.now_s, "world")).model


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("scenario", ["motorway", "street", "two-way", "dense-motorway"])
def test_the_model_on_the_truth_drives_as_the_ego_of_the_recording(scenario, seed) -> None:
    duration_s = 12.0
    recorded = record(scenario, seed, duration_s)
    timeline = driven(scenario, seed, duration_s, on_truth).timeline(duration_s)
    np.testing.assert_allclose(timeline.axles[:, 0], recorded.axles[:, 0], atol=1e-6)
    np.testing.assert_allclose(timeline.yaws[:, 0], recorded.yaws[:, 0], atol=1e-9)


def test_others_brake_for_an_ego_that_stops() -> None:
    traffic = driven("two-way", 1, 12.0, lambda t: DrivingCommand(-4.0, 0))
    timeline = traffic.timeline(12.0)
    assert traffic.speed_m_s == 0.0
    assert traffic.collided_with is None
    offsets = timeline.axles[-1] - timeline.axles[-1, 0]
    behind = timeline.present[-1] & (abs(offsets[:, 1]) < 1.0) & (offsets[:, 0] < 0)
    nearest = np.argmax(np.where(behind, offsets[:, 0], -np.inf))
    assert -15.0 < offsets[nearest, 0] < -5.0
    assert timeline.speeds[-1, nearest] < 0.5 < timeline.speeds[0, nearest]


@pytest.mark.parametrize("scenario", ["cutting-in", "stepping-out"])
def test_who_sees_nobody_collides_and_who_sees_all_does_not(scenario) -> None:
    blind = [driven(scenario, seed, 12.0, on_nothing).collided_with for seed in range(4)]
    seeing = [driven(scenario, seed, 12.0, on_truth).collided_with for seed in range(4)]
    assert sum(other is not None for other in blind) >= 2
    assert seeing == [None] * 4


def test_a_lane_is_changed_on_command_and_only_where_there_is_one() -> None:
    traffic = DrivenTraffic("motorway", 0, 10.0)
    nobody = Tracks.empty(0.0, "world")
    before = traffic.outlook(nobody)
    assert before.lanes == 4
    for _ in range(160):
        traffic.step(DrivingCommand(0.0, before.lane + 1))
    assert traffic.outlook(nobody).lane == before.lane + 1
    traffic.step(DrivingCommand(0.0, 17))
    assert traffic.outlook(nobody).target_lane == before.lane + 1


def test_the_outlook_names_the_next_ahead_and_the_way() -> None:
    traffic = DrivenTraffic("two-way", 0, 10.0)
    truth = traffic.true_tracks()
    outlook = traffic.outlook(truth)
    pose = traffic.world_from_ego.inverse()
    moved = truth.moved(pose, "ego")
    ahead = moved.centres[(abs(moved.centres[:, 1]) < 1.0) & (moved.centres[:, 0] > 0)]
    nearest = moved.centres[:, 0] == ahead[:, 0].min()
    (length,) = moved.sizes[nearest, 0]
    front_m = traffic.size[0]  # The origin is the rear axle, at the rear end of the box.
    expected = ahead[:, 0].min() - length / 2 - front_m
    assert outlook.gap_m == pytest.approx(expected, abs=0.05)
    assert np.linalg.norm(np.diff(outlook.path, axis=0), axis=1) == pytest.approx(2.0, abs=0.01)
    assert traffic.outlook(Tracks.empty(0.0, "world")).gap_m == np.inf


def test_scripted_traffic_is_refused() -> None:
    with pytest.raises(ScenarioError, match="cannot react"):
        DrivenTraffic("cut-ins", 0, 10.0)
