"""Beams of points whose file tells none."""

import numpy as np
import pytest

from roadscope.benchmarks import Episode, RecordedImu, folder_estimates, imu_mounting
from roadscope.benchmarks.drive import drive
from roadscope.benchmarks.formats import MAX_BEAM_HEIGHT_RAD, rings_of
from roadscope.core import ImuSamples
from roadscope.formats import ScanFolder
from roadscope.odometry import ODOMETRIES

DRIVE = Episode("two-way", 17, "vlp16-imu", 2.5)


def cone(elevations_deg, rng, count=200, jitter_deg=0.0):
    """Points of beams, so many each, and the beam of each."""
    beam = np.repeat(np.arange(len(elevations_deg)), count)
    rise = np.deg2rad(np.asarray(elevations_deg)[beam] + rng.uniform(-1, 1, len(beam)) * jitter_deg)
    turn, reach = rng.uniform(-np.pi, np.pi, len(beam)), rng.uniform(3, 60, len(beam))
    flat = np.cos(rise)
    ways = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), np.sin(rise)])
    return reach[:, None] * ways, beam


@pytest.mark.parametrize(
    "elevations_deg", [np.arange(-15, 16, 2.0), np.arange(-24.8, 2.1, 0.33), [-3.0]]
)
def test_beams_are_told_apart_by_the_gaps_between_them(elevations_deg):
    points, beam = cone(elevations_deg, np.random.default_rng(0), jitter_deg=0.03)
    assert np.array_equal(rings_of(points), beam)


def test_where_there_are_no_gaps_bands_stand_for_beams():
    points, _ = cone(np.arange(-15, 16, 2.0), np.random.default_rng(0), jitter_deg=1.0)
    ring = rings_of(points)
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    assert all(
        np.ptp(elevation[ring == each]) <= MAX_BEAM_HEIGHT_RAD + 1e-9 for each in np.unique(ring)
    )
    assert len(np.unique(ring)) > 60


@pytest.mark.parametrize("from_top", [True, False])
@pytest.mark.parametrize("clockwise", [True, False])
def test_beams_one_after_the_other_need_no_gaps(from_top, clockwise):
    """HDL-64E: lasers start at different heights, so that near points are at other elevations."""
    rng = np.random.default_rng(1)
    elevations_deg = np.concatenate([np.linspace(-24.9, -8.9, 32), np.linspace(-8.5, 2, 32)])
    points, beam = cone(elevations_deg, rng, count=500)
    points[:, 2] += rng.uniform(-0.15, 0.15, 64)[beam]
    high = beam > 50
    kept = ~high | (np.abs(np.arctan2(points[:, 1], points[:, 0]) - 0.4) < 0.3)
    points, beam = points[kept], beam[kept]
    turn = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    order = np.lexsort((-turn if clockwise else turn, -beam if from_top else beam))
    ring = rings_of(points[order])
    assert len(np.unique(ring)) == 64
    assert np.mean(ring == beam[order]) > 0.999
    shuffled = rings_of(rng.permutation(points))
    assert len(np.unique(shuffled)) != 64


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A drive as `.npy` files without beams, the samples of its IMU, and the drive itself."""
    folder = tmp_path_factory.mktemp("scans")
    steps = list(drive(DRIVE))
    for k, step in enumerate(steps):
        scan = step.scan
        np.save(
            folder / f"{k}.npy", np.column_stack([scan.points, scan.intensity, scan.time_offset_s])
        )
    stamps = "".join(f"{step.scan.stamp_s:.6f}\n" for step in steps)
    (folder / "times.txt").write_text(stamps)
    blocks = [step.imu for step in steps if step.imu is not None]
    names = "stamps_s", "angular_velocity", "specific_force"
    joined = (np.concatenate([getattr(block, name) for block in blocks]) for name in names)
    samples = ImuSamples(*joined)
    return folder, RecordedImu(samples, folder, lidar_from_imu=imu_mounting(DRIVE)), steps


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name", ["lidar-inertial", "voxel-map", "zhang2022-guarded", "loam", "lego-loam"]
)
def test_a_folder_without_beams_is_followed_as_the_drive_is(recorded, name):
    """Azimuth steps are others, so that features are, and what scans tell least of, height."""
    folder, inertial, steps = recorded
    *_, last = folder_estimates(ScanFolder.find(folder), name, imu=inertial)
    odometry = ODOMETRIES.make(name)
    odometry.reset(imu_mounting(DRIVE))
    *_, told = (odometry.update(step.scan, step.imu) for step in steps)
    expected = told.start_from_lidar.translation[:2]
    assert expected[0] > 20
    assert last.start_from_lidar.translation[:2] == pytest.approx(expected, abs=0.3)
    assert last.reason == told.reason
