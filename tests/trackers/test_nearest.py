import numpy as np
import pytest

from roadscope.core import Detections, Pose, TrackState
from roadscope.trackers.nearest import NearestTracker

T = 0.08


def seen(tick, *places, frame="ego"):
    n = len(places)
    if not n:
        return Detections.empty(tick * T, frame)
    centres = np.column_stack([np.array(places, float), np.full(n, 0.75)])
    return Detections(
        centres, np.tile([4.6, 1.85, 1.5], (n, 1)), np.zeros(n), np.zeros(n, int), np.ones(n),
        frame, tick * T,
    )  # fmt: skip


def test_identity_survives_13_missed_frames():
    tracker = NearestTracker(coast_frames=13)
    for k in range(20):
        before = tracker.update(seen(k, (20 + 0.1 * k, 3)), None)
    for k in range(20, 33):
        between = tracker.update(seen(k), None)
        assert between.states.tolist() == [TrackState.COASTING]
    assert between.centres[0, 0] == pytest.approx(20 + 0.1 * 32, abs=0.01)
    after = tracker.update(seen(33, (20 + 0.1 * 33, 3)), None)
    assert after.ids.tolist() == before.ids.tolist()
    assert after.states.tolist() == [TrackState.CONFIRMED]


def test_filter_is_dropped_after_13_missed_frames_and_its_id_is_gone():
    tracker = NearestTracker(coast_frames=13)
    first = tracker.update(seen(0, (20, 3)), None)
    counts = [len(tracker.update(seen(k), None)) for k in range(1, 16)]
    assert counts == [1] * 13 + [0, 0]
    again = tracker.update(seen(16, (20, 3)), None)
    assert again.ids[0] != first.ids[0]


def test_tentative_until_seen_often_enough():
    tracker = NearestTracker(confirm_hits=3)
    states = [
        tracker.update(seen(k, *places), None).states[0]
        for k, places in enumerate([[(20, 3)], [(20, 3)], [], [(20, 3)], []])
    ]
    assert states == [0, 0, 0, TrackState.CONFIRMED, TrackState.COASTING]


def test_far_target_opens_a_filter():
    tracker = NearestTracker(gate_m=2.0)
    tracker.update(seen(0, (20, 0)), None)
    tracks = tracker.update(seen(1, (20, 1.9), (30, 0)), None)
    assert tracks.ids.tolist() == [0, 1]
    tracks = tracker.update(seen(2, (20, 5)), None)
    assert len(tracks) == 3


def test_constant_velocity_and_its_frame():
    tracker = NearestTracker()
    for k in range(30):
        tracks = tracker.update(seen(k, (20 + 0.4 * k, 3 - 0.08 * k)), None)
    assert tracks.frame == "ego"
    assert tracks.velocities[0] == pytest.approx((5.0, -1.0), abs=0.01)


def turning(k):
    """The ego's pose on a circle of 30 m at 10 m/s."""
    angle = 10 / 30 * k * T
    return Pose.planar(30 * np.sin(angle), 30 - 30 * np.cos(angle), angle)


def test_turning_ego_is_followed_in_the_world():
    standing = np.array([40.0, 5.0, 0.0])
    world, ego = NearestTracker(), NearestTracker(frame="ego")
    for k in range(40):
        x, y, _ = turning(k).inverse().apply(standing)
        found = world.update(seen(k, (x, y)), turning(k))
        lost = ego.update(seen(k, (x, y)), turning(k))
    assert found.frame == "world"
    assert found.ids.tolist() == [0]
    assert found.centres[0, :2] == pytest.approx((40, 5), abs=0.05)
    assert found.velocities[0] == pytest.approx((0, 0), abs=0.3)
    assert lost.frame == "ego"
    assert np.hypot(*(lost.centres[0, :2] - (x, y))) > 0.3


def test_first_velocity_is_the_egos():
    """At 40 m/s a target moves 3.2 m a tick in the world, more than the gate."""
    tracker = NearestTracker(gate_m=2.0)
    for k in range(5):
        places = [(20.0, 3.0)] if k < 2 else [(20.0, 3.0), (40.0, -3.0)]
        tracks = tracker.update(seen(k, *places), Pose.planar(3.2 * k, 0, 0))
    assert tracks.ids.tolist() == [0, 1]
    assert np.allclose(tracks.velocities, [[40, 0], [40, 0]], atol=0.5)


def test_detections_in_the_world_frame_are_taken_as_they_are():
    tracks = NearestTracker().update(seen(0, (20, 3), frame="world"), Pose.planar(5, 5, 1))
    assert tracks.centres[0, :2].tolist() == [20, 3]
    assert tracks.frame == "world"


def test_stamps_must_increase():
    tracker = NearestTracker()
    tracker.update(seen(3), None)
    with pytest.raises(ValueError, match="stamps must increase"):
        tracker.update(seen(3), None)


def test_pose_must_not_come_and_go():
    tracker = NearestTracker()
    tracker.update(seen(0), Pose.identity())
    with pytest.raises(ValueError, match="ego pose must be given at every update or at none"):
        tracker.update(seen(1), None)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gate_m": 0.0}, "gate_m must be positive"),
        ({"sigma_m_m": -0.2}, "sigma_m_m must be positive"),
        ({"coast_frames": -1}, "coast_frames and acceleration_m_s2 must be 0 or more"),
        ({"acceleration_m_s2": float("nan")}, "acceleration_m_s2 must be 0 or more"),
        ({"confirm_hits": 0}, "confirm_hits must be 1 or more, got 0"),
        ({"frame": "lidar"}, "no frame 'lidar'; possible: world, ego"),
    ],
)
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ValueError, match=message):
        NearestTracker(**arguments)
