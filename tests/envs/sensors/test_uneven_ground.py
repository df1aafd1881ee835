"""What sensors measure on hills, leaning roads and bumps."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from io import BytesIO
from itertools import islice

import numpy as np
import pytest

from roadscope.core import GROUND, Category, Pose, RecordError
from roadscope.envs import find_rig
from roadscope.envs.sensors import STANDARD_GRAVITY_M_S2, BodySway, EgoMotion, scaled_noise, sense
from roadscope.envs.traffic import Terrain, Timeline, record
from tests.envs.worlds import platoon

NAMES = ("hills", "camber", "bumps")
recorded = cache(lambda name: record(name, 10_000, 1.5))


def slope(turn: float = 0.0, share: float = 0.1) -> Terrain:
    """A plane that rises by that share in that direction."""
    return Terrain(
        np.array([[2.0, 0, 0, turn, share, -1e4, 1e4]]), np.array([-250.0, -250, 550, 250])
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_ground_is_uneven_and_no_steeper_than_roads_are(name: str) -> None:
    line = recorded(name)
    assert line.terrain is not None
    states = line.at(np.arange(0.0, 1.5, 0.1))
    heights, rises, leans = np.moveaxis(line.stances(states), -1, 0)
    here = line.present.all(axis=0)
    assert np.ptp(heights[:, here]) > 0.1
    assert max(np.abs(rises).max(), np.abs(leans).max()) < 0.2
    # Wheels stand on the ground: near the middle of a car it is as high as they are.
    cars = here & (line.sizes[:, 0] < 6) & (line.categories != Category.PEDESTRIAN)
    under = line.terrain.heights(line.centres(states))
    assert np.abs(heights - under)[:, cars].max() < 0.12


@pytest.mark.parametrize("name", NAMES)
def test_returns_lie_on_the_ground_and_on_bodies(name: str) -> None:
    line = recorded(name)
    assert line.terrain is not None
    quiet = scaled_noise(find_rig("hdl64e"), 0.0)
    for frame, truth in list(sense(line, quiet, 0))[2:4]:
        assert frame.lidar is not None
        world = truth.world_from_ego.apply(
            frame.calibration.pose("lidar").apply(frame.lidar.points)
        )
        ground = world[truth.sources == GROUND]
        assert len(ground) > 10_000
        # The ego drives through at most 1.3 m in half a sweep, over slopes below 0.2.
        off = ground[:, 2] - line.terrain.heights(ground[:, :2])
        assert np.quantile(np.abs(off), 0.99) < 0.15
        rows = np.flatnonzero(truth.lidar_returns > 50)
        assert len(rows) > 2
        for row in rows:
            box = Pose.planar(*truth.centres[row, :2], truth.yaws[row], truth.centres[row, 2])
            local = box.inverse().apply(world[truth.sources == truth.ids[row]])
            half = truth.sizes[row] / 2
            assert (np.abs(local[:, :2]) <= half[:2] + 2.5).all()
            # A pitched body of 16 m reaches 0.8 m over the ends of its box.
            assert np.abs(local[:, 2]).max() <= half[2] + 0.15 * half[0] + 0.5


def test_a_plane_looks_flat_to_those_who_stand_on_it() -> None:
    flat = replace(platoon(3, style="bare"), categories=np.zeros(3, np.int8))
    quiet = scaled_noise(find_rig("vlp16"), 0.0)
    for turn in (0.0, np.pi / 2):
        tilted = replace(flat, terrain=slope(turn))
        pairs = zip(sense(flat, quiet, 0), sense(tilted, quiet, 0), strict=True)
        for (level, _), (frame, truth) in islice(pairs, 3):
            assert level.lidar is not None
            assert frame.lidar is not None
            cars = truth.sources != GROUND
            assert cars.sum() > 100
            ego = frame.calibration.pose("lidar").apply(frame.lidar.points)
            assert np.abs(ego[~cars, 2]).max() < 0.005
            # What stands on the plane is cast as on the level one; distances along it are longer.
            assert len(frame.lidar) == pytest.approx(len(level.lidar), rel=0.02)


def test_an_ego_at_rest_on_a_slope_measures_gravity_along_it() -> None:
    still = platoon(1)
    still = replace(
        still, axles=np.full_like(still.axles, 60.0), speeds=np.zeros_like(still.speeds)
    )
    motion = EgoMotion(replace(still, terrain=slope()), BodySway())
    here = motion.at(np.array([5.0]))
    up = here.rotations[0].T @ (0.0, 0.0, STANDARD_GRAVITY_M_S2)
    expected = STANDARD_GRAVITY_M_S2 * np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01)
    np.testing.assert_allclose(up, expected, atol=1e-6)
    np.testing.assert_allclose(here.positions[0], (60.0, 60.0, 6.0), atol=1e-6)


def test_wheels_roll_along_the_slope() -> None:
    motion = EgoMotion(replace(platoon(1), terrain=slope()))
    np.testing.assert_allclose(motion.speeds(np.array([5.0])), 10.0 * np.sqrt(1.01), rtol=1e-6)


def test_the_motion_stays_near_the_recorded_one() -> None:
    line = recorded("bumps")
    motion = EgoMotion(line)
    for stamp_s in (0.4, 0.73, 1.0):
        error = (line.world_from_ego(stamp_s).inverse() @ motion.world_from_ego(stamp_s)).matrix
        assert np.abs(error - np.eye(4)).max() < 0.02


def test_images_of_uneven_ground_are_refused() -> None:
    with pytest.raises(RecordError, match="uneven"):
        next(iter(sense(recorded("hills"), find_rig("wide"), 0)))


def test_a_file_keeps_the_ground() -> None:
    file = BytesIO()
    recorded("camber").save(file)
    file.seek(0)
    assert Timeline.load(file) == recorded("camber")
