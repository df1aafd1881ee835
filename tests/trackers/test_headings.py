"""Headings of tracks: boxes show an axis, travel shows which of its ends is ahead."""

import numpy as np
import pytest
from tracked_scenes import T, boxes, run

from roadscope.core import Pose
from roadscope.trackers import TRACKERS

SPEED_M_S, TICKS, BRAKES = 8.0, 60, 35
POSES = [Pose.identity()] * TICKS


def drive(course, *, axis=None, ahead=0.5):
    """A car that drives, then stands; the front of its box is right by this chance."""
    rng, axis = np.random.default_rng(3), course if axis is None else axis
    travelled_m = SPEED_M_S * T * np.minimum(np.arange(TICKS), BRAKES)
    reversed_ = rng.random(TICKS) > ahead
    return [
        boxes([[10 + s * np.cos(course), 5 + s * np.sin(course)]], tick, yaws=axis + np.pi * wrong)
        for tick, (s, wrong) in enumerate(zip(travelled_m, reversed_, strict=True))
    ]


def turned(tracks, course):
    """Cosines of the angles between headings and the course."""
    assert all(len(each.sure) == 1 for each in tracks)
    return np.cos([each.sure.yaws[0] - course for each in tracks])


def answers(name, episode, poses):
    tracker = TRACKERS.make(name)
    tracks = run(tracker, episode, poses)
    return tracker.rescored(tracks) if name.endswith("offline") else tracks


@pytest.mark.parametrize("course", [0.4, -2.8])
@pytest.mark.parametrize(
    "name", ["nearest-q", "gnn", "ab3dmot", "imm", "jpda", "existence", "existence-offline"]
)
def test_the_heading_of_a_moving_track_follows_its_velocity(name, course):
    tracks = answers(name, drive(course), POSES)
    assert turned(tracks[15:BRAKES], course).min() > 0.99


@pytest.mark.parametrize("name", ["existence", "existence-offline"])
def test_a_car_that_stops_still_points_where_it_drove(name):
    tracks = answers(name, drive(0.4), POSES)
    assert turned(tracks[8:], 0.4).min() > 0.99


def test_a_slow_reverse_is_no_turn():
    """At 0.5 m/s backwards, of a detector that knows front from rear."""
    places = [[10 - 0.5 * T * tick, 0.0] for tick in range(TICKS)]
    episode = [boxes([place], tick) for tick, place in enumerate(places)]
    assert turned(run(TRACKERS.make("existence"), episode, POSES)[3:], 0.0).min() > 0.99


def test_only_ends_are_swapped():
    """Whatever the front of a box, the axis of the track, its place and its speed are the same."""
    right, wrong = (
        run(TRACKERS.make("existence"), drive(0.4, ahead=ahead), POSES) for ahead in (1.0, 0.0)
    )
    for one, other in zip(right[20:], wrong[20:], strict=True):
        assert one.yaws == pytest.approx(other.yaws)
        assert one.centres == pytest.approx(other.centres, abs=1e-3)
        assert one.velocities == pytest.approx(other.velocities, abs=1e-2)


def test_without_poses_velocities_are_relative_and_turn_nothing():
    """The ego overtakes: what moves back in its frame drives ahead all the same."""
    episode = drive(np.pi, axis=0.0, ahead=1.0)
    for name in ("gnn", "existence"):
        assert turned(run(TRACKERS.make(name), episode, [None] * TICKS)[8:], 0.0).min() > 0.99
