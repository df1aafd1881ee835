import numpy as np
import pytest
from highway_env.road.lane import CircularLane, SineLane, StraightLane
from highway_env.road.road import RoadNetwork

from research.object_traffic import coordinates
from roadscope.envs.traffic import LANE_STEP_M, greatest_curvature, road_map, to_world

LANES = [
    StraightLane([3.0, 1.0], [50.0, -20.0], width=3.5),
    SineLane([0.0, 5.0], [85.0, 5.0], 5.0, 2 * np.pi / 85, 0.3),
    CircularLane([2.0, -1.0], 20.0, np.deg2rad(90), np.deg2rad(-60), clockwise=False),
    CircularLane([2.0, -1.0], 15.0, np.deg2rad(0), np.deg2rad(136), clockwise=True),
]


def test_the_frame_is_mirrored_and_back():
    rng = np.random.default_rng(0)
    positions, headings, velocities = (
        rng.normal(size=(5, 2)),
        rng.normal(size=5),
        rng.normal(size=(5, 2)),
    )
    world, yaws, moved = to_world(positions, headings, velocities)
    np.testing.assert_array_equal(world, positions * (1, -1))
    back = to_world(world, yaws, moved)
    for original, returned in zip((positions, headings, velocities), back, strict=True):
        np.testing.assert_array_equal(original, returned)
    # A velocity along the heading is a velocity along the yaw.
    along = np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    _, yaws, moved = to_world(positions, headings, along)
    np.testing.assert_allclose(moved, np.stack([np.cos(yaws), np.sin(yaws)], axis=-1))
    assert to_world(positions, headings)[2] is None


@pytest.mark.parametrize("lane", LANES)
def test_lanes_are_sampled_densely_to_their_true_ends(lane):
    network = RoadNetwork()
    network.add_lane("a", "b", lane)
    ((points, widths),) = road_map(network).lanes()
    ends = np.array([lane.position(0, 0), lane.position(lane.length, 0)]) * (1, -1)
    np.testing.assert_allclose(points[[0, -1]], ends, atol=1e-9)
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) <= LANE_STEP_M * 1.1).all()
    assert (widths == lane.width).all()


def test_a_whole_network_is_sampled_lane_by_lane():
    network = RoadNetwork()
    for lane in LANES:
        network.add_lane("a", "b", lane)
    assert len(road_map(network).lanes()) == len(LANES)


@pytest.mark.parametrize("lane", LANES)
def test_lane_coordinates_equal_those_of_highway_env(lane):
    points = np.random.default_rng(1).uniform(-30, 60, (50, 2))
    along, across = coordinates(lane, points)
    expected = np.array([lane.local_coordinates(point) for point in points])
    np.testing.assert_allclose(along, expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(across, expected[:, 1], atol=1e-9)


@pytest.mark.parametrize("lane", LANES)
def test_curvature_is_the_steepest_turn_of_heading(lane):
    along = np.linspace(0, lane.length, 4000)
    points = np.array([lane.position(s, 0.0) for s in along])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turns = np.abs(np.diff([lane.heading_at(s) for s in along])) / steps
    assert greatest_curvature(lane) == pytest.approx(turns.max(), rel=0.02, abs=1e-9)
