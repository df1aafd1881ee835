from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from roadscope.core import GROUND, LidarScan, Pose, RecordError
from roadscope.envs.raycast import Scene
from roadscope.envs.sensors import SPECS, LidarSpec, SweepTruth, lidar_columns, sweep
from roadscope.envs.world import Prisms

WALL = np.array([[0.0, -30], [1, -30], [1, 30], [0, 30]])


def spec(**changes: float) -> LidarSpec:
    """Return an HDL-32E without any noise, except as named."""
    silent = {"range_noise_m": 0.0, "range_resolution_m": 0.0, "dropout": 0.0, "detection_limit": 0}
    return replace(SPECS["hdl32e"], **{**silent, **changes})


def wall(distance_m: float, reflectivity: float = 0.5) -> Scene:
    prism = Prisms.of(
        WALL + np.array([distance_m, 0]), 0.0, 5.0, owner=-2, reflectivity=reflectivity
    )
    return Scene.still(prism, Prisms.empty(), np.empty((0, 3)))


def measure(scene: Scene, lidar: LidarSpec, seed: int = 0) -> tuple[LidarScan, SweepTruth]:
    poses = [Pose.planar(0, 0, 0, 1.9)] * len(scene.knots_s)
    return sweep(scene, lidar, poses, 0.0, rng=np.random.default_rng(seed))


def ahead(scan: LidarScan, truth: SweepTruth, half_angle: float = 0.3) -> np.ndarray:
    """Mask of scenery returns straight ahead."""
    bearing = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    return (np.abs(bearing) < half_angle) & (truth.owners == -2)


def test_points_lie_on_what_they_come_from() -> None:
    scan, truth = measure(wall(12.0), spec())
    ground = truth.owners == GROUND
    assert scan.points[ground, 2] == pytest.approx(-1.9, abs=1e-4)
    assert scan.points[ahead(scan, truth), 0] == pytest.approx(12.0, abs=1e-4)
    assert len(truth.owners) == len(scan)
    assert set(truth.owners) == {GROUND, -2}


def test_returns_come_in_firing_order() -> None:
    lidar = spec()
    scan, _ = measure(wall(12.0), lidar)
    assert (np.diff(scan.column) >= 0).all()
    expected = lidar.column_offsets_s()[scan.column] + lidar.firing_offsets_s[scan.ring]
    assert scan.time_offset_s == pytest.approx(expected, abs=1e-8)
    assert (np.diff(scan.time_offset_s.astype(float)) > -1e-8).all()
    elevation = np.arctan2(scan.points[:, 2], np.hypot(scan.points[:, 0], scan.points[:, 1]))
    assert elevation == pytest.approx(lidar.elevations[scan.ring], abs=1e-5)


def test_noise_is_gaussian_with_the_given_deviation() -> None:
    scene, sigma = wall(12.0), 0.05
    silent, _ = measure(scene, spec())
    noisy, _ = measure(scene, spec(range_noise_m=sigma))
    errors = np.linalg.norm(noisy.points, axis=1) - np.linalg.norm(silent.points, axis=1)
    count = len(errors)
    assert abs(errors.mean()) < 5 * sigma / np.sqrt(count)
    assert errors.std() == pytest.approx(sigma, rel=5 / np.sqrt(2 * count))
    assert (np.abs(errors) < sigma).mean() == pytest.approx(0.6827, abs=5 * 0.47 / np.sqrt(count))


def test_ranges_are_rounded() -> None:
    scan, _ = measure(wall(12.0), spec(range_resolution_m=0.5))
    ranges = np.linalg.norm(scan.points, axis=1)
    assert ranges == pytest.approx(np.round(ranges / 0.5) * 0.5, abs=1e-4)


def test_dropout_loses_its_share() -> None:
    every, _ = measure(wall(12.0), spec())
    remaining, _ = measure(wall(12.0), spec(dropout=0.2))
    assert len(remaining) / len(every) == pytest.approx(0.8, abs=5 * 0.4 / np.sqrt(len(every)))


def test_detection_limit_falls_with_range_squared() -> None:
    lidar = spec(detection_limit=0.4)
    # Energy at normal incidence: 0.5 at 100 m would suffice; 0.1 does only within 50 m.
    for reflectivity, distance, visible in ((0.5, 95, True), (0.1, 48, True), (0.1, 52, False)):
        scan, truth = measure(wall(distance, reflectivity), lidar)
        assert ahead(scan, truth, 0.02).any() == visible


def test_outside_the_ranges_nothing_returns() -> None:
    near, truth = measure(wall(12.0), spec(range_min_m=13.0))
    assert np.linalg.norm(near.points, axis=1).min() >= 13.0 - 1e-4
    far, _ = measure(wall(12.0), spec(range_max_m=11.0))
    assert np.linalg.norm(far.points, axis=1).max() <= 11.0 + 1e-4
    assert truth.owners.size < measure(wall(12.0), spec())[1].owners.size


def test_intensity_grows_with_reflectivity_and_cosine_and_falls_with_range() -> None:
    def brightness(scene: Scene, half_angle: float = 0.01) -> float:
        scan, truth = measure(scene, spec())
        return float(scan.intensity[ahead(scan, truth, half_angle)].max())

    assert brightness(wall(20, 0.8)) > brightness(wall(20, 0.4)) > brightness(wall(40, 0.4))
    scan, truth = measure(wall(20, 0.5), spec())
    level = ahead(scan, truth, 1.0) & (scan.ring == 22)
    bearing = np.abs(np.arctan2(scan.points[level, 1], scan.points[level, 0]))
    assert (np.diff(scan.intensity[level][np.argsort(bearing)]) <= 1e-6).all()
    assert 0 <= scan.intensity.min() <= scan.intensity.max() <= 1


def test_same_rng_same_bytes() -> None:
    lidar = SPECS["vlp16"]
    (one, _), (two, _), (other, _) = (measure(wall(12.0), lidar, seed) for seed in (1, 1, 2))
    assert one == two
    assert one != other


def test_noise_of_a_ray_does_not_depend_on_the_scene() -> None:
    lidar = spec(range_noise_m=0.02)
    bare = Scene.still(Prisms.empty(), Prisms.empty(), np.empty((0, 3)))
    alone, _ = measure(bare, lidar)
    beside, truth = measure(wall(12.0), lidar)
    keys = {(c, r): i for i, (c, r) in enumerate(zip(alone.column, alone.ring, strict=True))}
    ground = np.flatnonzero(truth.owners == GROUND)
    index = [keys[beside.column[i], beside.ring[i]] for i in ground]
    assert np.array_equal(alone.points[index], beside.points[ground])


def moving_scene(speed_m_s: float, distance_m: float = 20.0) -> Scene:
    body = Prisms.of(WALL - np.array([0.5, 0]), 0.0, 4.0, owner=0)
    knots = np.linspace(-0.05, 0.05, 3)
    poses = np.zeros((3, 1, 3))
    poses[:, 0, 0] = distance_m + speed_m_s * knots
    return Scene(Prisms.empty(), body, knots, poses, np.ones(1, bool))


def test_rolling_shutter_shears_what_moves() -> None:
    speed = 25.0
    scan, truth = measure(moving_scene(speed), spec())
    body = truth.owners == 0
    column_time = spec().column_offsets_s()[scan.column[body]]
    assert np.ptp(column_time) > 0.02
    assert scan.points[body, 0] == pytest.approx(19.5 + speed * column_time, abs=1e-4)


def test_rolling_shutter_of_the_sensor_is_the_same_seen_from_the_other_side() -> None:
    still = moving_scene(0.0)
    poses = [Pose.planar(-25.0 * t, 0, 0, 1.9) for t in still.knots_s]
    driving, truth = sweep(still, spec(), poses, 0.0, rng=np.random.default_rng(0))
    other, other_truth = measure(moving_scene(25.0), spec())
    assert driving.points[truth.owners == 0] == pytest.approx(
        other.points[other_truth.owners == 0], abs=1e-4
    )


def test_a_turning_sensor_measures_at_each_columns_own_heading() -> None:
    scene = moving_scene(0.0)
    rate = 0.8
    poses = [Pose.planar(1, 2, rate * t, 1.9) for t in scene.knots_s]
    scan, truth = sweep(scene, spec(), poses, 0.0, rng=np.random.default_rng(0))
    columns = lidar_columns(scene, spec(), poses, 0.0)
    turned = [Pose.planar(1, 2, rate * t, 1.9).matrix for t in columns.stamps_s]

    def path(stamps_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        assert np.array_equal(stamps_s, columns.stamps_s)
        return np.stack(turned)[:, :3, :3], np.stack(turned)[:, :3, 3]

    same, _ = sweep(scene, spec(), path, 0.0, rng=np.random.default_rng(0))
    assert same.points == pytest.approx(scan.points, abs=1e-5)
    world = np.einsum("nij,nj->ni", np.stack(turned)[scan.column, :3, :3], scan.points)
    body = truth.owners == 0
    assert world[body, 0] + 1 == pytest.approx(19.5, abs=1e-4)


def test_occluded_fraction_and_returns() -> None:
    footprint = np.array([[-2.0, -1], [2, -1], [2, 1], [-2, 1]])
    bodies = Prisms.join([Prisms.of(footprint, 0.0, 1.5, owner=row) for row in range(4)])
    poses = np.array([[[10.0, 0, 0], [20, 0, 0], [0, 15, 0], [-10, 0, 0]]])
    present = np.array([True, True, True, False])
    scene = Scene(Prisms.empty(), bodies, np.zeros(1), poses, present)
    _, truth = measure(scene, spec())
    assert truth.occluded_fraction[0] == 0
    assert 0.3 < truth.occluded_fraction[1] <= 1
    assert truth.occluded_fraction[2:].tolist() == [0, 1]
    assert truth.returns.tolist() == [int((truth.owners == row).sum()) for row in range(4)]
    assert truth.returns[0] > 100
    assert truth.returns[3] == 0


def test_poses_must_match_the_knots() -> None:
    with pytest.raises(RecordError, match="3 knots, 1 poses"):
        sweep(moving_scene(1.0), spec(), [Pose.identity()], 0.0, rng=np.random.default_rng(0))
