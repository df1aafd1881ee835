import numpy as np
import pytest
from toy_lidar import scan_of

from roadscope.core import LidarScan, Pose
from roadscope.envs import find_rig
from roadscope.envs.gym import (
    EGO_BOUNDS,
    LaneLocator,
    ego_state,
    goal_state,
    observation_space,
    range_image,
)
from roadscope.envs.traffic import RoadMap, Timeline
from tests.envs.worlds import timeline

EAST = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]])
WIDTHS = np.full(3, 4.0)


def road(*centre_lines: np.ndarray) -> RoadMap:
    return RoadMap.from_lanes([(line, WIDTHS) for line in centre_lines])


def drive(speed: float, yaw_rate: float) -> Timeline:
    stamps = np.linspace(0.0, 1.0, 21)
    yaws = yaw_rate * stamps
    steps = speed * 0.05 * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    axles = np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
    speeds = np.full((len(stamps), 1), speed)
    return timeline(stamps, axles[:, None], yaws[:, None], speeds, size=(5.0, 2.0, 1.5))


def scan(points: list[tuple[float, float, float]], ring: list[int], column: list[int]) -> LidarScan:
    return scan_of(points, ring, column, 0.0, "lidar", np.linspace(0.5, 1.0, len(points)))


@pytest.mark.parametrize("name", ["lux", "vlp16", "hdl32e", "hdl64e"])
def test_spaces_are_flat_finite_and_shaped_like_the_lidar(name: str) -> None:
    spec = find_rig(name).lidar.spec
    space = observation_space(find_rig(name), goal=True)
    assert list(space.keys()) == ["ego", "goal", "lidar_intensity", "lidar_range"]
    assert space["lidar_range"].shape == (spec.beams, spec.columns)
    for box in space.values():
        assert box.dtype == np.float32
        assert np.isfinite(box.low).all()
        assert np.isfinite(box.high).all()


def test_returns_lie_at_their_beam_and_column() -> None:
    spec = find_rig("lux").lidar.spec
    image = range_image(scan([(3.0, 4.0, 0.0), (0.0, 0.0, 7.0)], [0, 3], [5, 0]), spec)
    assert image["lidar_range"][0, 5] == 5.0
    assert image["lidar_range"][3, 0] == 7.0
    assert image["lidar_range"].sum() == 12.0
    assert image["lidar_intensity"][3, 0] == 1.0


def test_ranges_beyond_the_limit_are_clipped_into_the_space() -> None:
    spec = find_rig("lux").lidar.spec
    image = range_image(scan([(spec.range_max_m + 0.3, 0.0, 0.0)], [0], [0]), spec)
    assert image["lidar_range"] in observation_space(find_rig("lux"))["lidar_range"]


@pytest.mark.parametrize("empty", [None, scan([], [], [])])
def test_no_returns_are_zeros(empty: LidarScan | None) -> None:
    image = range_image(empty, find_rig("lux").lidar.spec)
    assert not image["lidar_range"].any()


def test_the_own_state_is_speed_yaw_rate_and_place_on_the_lane() -> None:
    driven = drive(10.0, 0.2)
    state = ego_state(driven, 1.0, LaneLocator(driven.road))
    _, y = driven.axles[-1, 0]
    assert state.dtype == np.float32
    np.testing.assert_allclose(state, [10.0, 0.2, y, 0.2], rtol=1e-2)


def test_the_own_state_at_the_start_and_beyond_its_bounds_stays_in_the_space() -> None:
    driven = drive(500.0, 40.0)
    lanes = LaneLocator(driven.road)
    assert ego_state(driven, 0.0, lanes)[1] == 0.0
    state = ego_state(driven, 1.0, lanes)
    assert (np.abs(state) <= EGO_BOUNDS).all()
    assert state[1] == EGO_BOUNDS[1]


@pytest.mark.parametrize(
    ("place", "yaw", "expected"),
    [
        ((5.0, 1.0), 0.1, (1.0, 0.1)),
        ((20.0, -1.5), -0.1, (-1.5, -0.1)),
        ((5.0, 3.0), np.pi, (1.0, 0.0)),
        ((5.0, 3.0), np.pi - 0.2, (1.0, -0.2)),
    ],
)
def test_the_lane_that_leads_in_the_own_direction_counts(
    place: tuple[float, float], yaw: float, expected: tuple[float, float]
) -> None:
    # The other lane leads west, so places north of it are on its right.
    west = EAST[::-1] + np.array([0.0, 4.0])
    lanes = LaneLocator(road(EAST, west))
    assert lanes.offset_and_heading(np.array(place), yaw) == pytest.approx(expected)


def test_without_lanes_there_is_no_offset() -> None:
    lanes = LaneLocator(RoadMap.from_lanes([]))
    assert lanes.offset_and_heading(np.zeros(2), 1.0) == (0.0, 0.0)


def test_a_goal_is_in_the_ego_frame() -> None:
    state = goal_state(Pose.planar(1.0, 1.0, np.pi / 2), Pose.planar(1.0, 4.0, np.pi))
    np.testing.assert_allclose(state, [3.0, 0.0, 0.0, 1.0], atol=1e-6)
