"""Traffic in which the ego obeys commands and all others react."""

from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import Category, Detections, DrivingCommand, Tracks
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
def test_a_driver_without_tracks_collides_and_one_with_all_does_not(scenario) -> None:
    blind = [driven(scenario, seed, 12.0, on_nothing).collided_with for seed in range(4)]
    seeing = [driven(scenario, seed, 12.0, on_truth).collided_with for seed in range(4)]
    assert sum(other is not None for other in blind) >= 2
    assert seeing == [None] * 4


def test_a_lane_is_changed_on_command_and_only_where_there_is_one() -> None:
    traffic = DrivenTraffic("motorway", 0, 10.0)
    no_tracks = Tracks.empty(0.0, "world")
    before = traffic.outlook(no_tracks)
    assert before.lanes == 4
    for _ in range(160):
        traffic.step(DrivingCommand(0.0, before.lane + 1))
    assert traffic.outlook(no_tracks).lane == before.lane + 1
    traffic.step(DrivingCommand(0.0, 17))
    assert traffic.outlook(no_tracks).target_lane == before.lane + 1


def test_the_outlook_names_the_next_road_user_and_the_path() -> None:
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


@pytest.mark.parametrize(
    ("scenario", "why"),
    [("cut-ins", "cannot react"), ("hills", "uneven"), ("unseen-street", "unseen")],
)
def test_traffic_in_which_no_driver_can_drive_is_refused(scenario, why) -> None:
    with pytest.raises(ScenarioError, match=why):
        DrivenTraffic(scenario, 0, 10.0)


@pytest.mark.parametrize("backwards_m_s", [0.0, 1.5])
@pytest.mark.parametrize("category", [Category.CAR, Category.PEDESTRIAN])
def test_what_stands_ahead_is_not_taken_for_oncoming(category, backwards_m_s) -> None:
    traffic = DrivenTraffic("two-way", 0, 10.0)
    pose = traffic.world_from_ego
    centres = pose.apply(np.array([[25.0, 0.0, 0.8]]))
    boxes = Detections(
        centres, np.array([[0.6, 0.6, 1.7]]), [pose.yaw + np.pi], [category], [1.0], "world", 0.0
    )
    back = -backwards_m_s * np.array([[np.cos(pose.yaw), np.sin(pose.yaw)]])
    track = replace(Tracks.of(boxes, np.array([1])), velocities=back)
    outlook = traffic.outlook(track)
    assert outlook.gap_m == pytest.approx(25.0 - 0.3 - traffic.size[0], abs=0.31)
    assert outlook.leader_speed_m_s == pytest.approx(0.0, abs=1e-9)
    assert outlook.model.acceleration_m_s2 < -0.5


def test_the_traffic_of_others_does_not_depend_on_random_numbers_of_the_ego() -> None:
    """Those who arrive at the start of the road are the same however the ego drives."""
    slow = driven("stepping-out", 2, 3.0, lambda t: DrivingCommand(-8.0, 0)).timeline(3.0)
    fast = driven("stepping-out", 2, 3.0, lambda t: DrivingCommand(1.0, 0)).timeline(3.0)
    both = np.intersect1d(slow.ids, fast.ids)
    sizes = [
        dict(zip(line.ids.tolist(), line.sizes.tolist(), strict=True)) for line in (slow, fast)
    ]
    assert len(both) > 20
    assert [sizes[0][i] for i in both] == [sizes[1][i] for i in both]
