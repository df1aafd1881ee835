"""Beams of points whose file tells none."""

import numpy as np
import pytest

from roadscope.benchmarks import Episode, RecordedImu, drive, folder_estimates, imu_mounting
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
def test_beams_are_separated_by_the_gaps_between_them(elevations_deg):
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
    in_view = ~high | (np.abs(np.arctan2(points[:, 1], points[:, 0]) - 0.4) < 0.3)
    points, beam = points[in_view], beam[in_view]
    turn = np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi)
    order = np.lexsort((-turn if clockwise else turn, -beam if from_top else beam))
    ring = rings_of(points[order])
    assert len(np.unique(ring)) == 64
    assert np.mean(ring == beam[order]) > 0.999
    shuffled = rings_of(rng.permutation(points))
    assert len(np.unique(shuffled)) != 64


VLP32_DEG = np.fromstring(
    "-25 -15.639 -11.31 -8.843 -7.254 -6.148 -5.333 -4.667 -4 -3.667 -3.333 -3 -2.667 -2.333 -2 "
    "-1.667 -1.333 -1 -0.667 -0.333 0 0.333 0.667 1 1.333 1.667 2.333 3.333 4.667 7 10.333 15",
    sep=" ",
)
"""Elevations of the beams of a VLP-32C, by its data sheet."""
UNITS_M = (-0.13, 0.13)
"""Heights of two units above the origin of their points."""


def two_units():
    """Points of a street between walls as two stacked units measure them, and their beams, 0 to 63.

    They are in the order of the units, then of beams, then of azimuths. Argoverse has such units.
    """
    azimuths, points, beams = np.deg2rad(np.arange(-180, 180, 0.4)), [], []
    for unit, height_m in enumerate(UNITS_M):
        for beam, rise in enumerate(np.deg2rad(VLP32_DEG)):
            ways = np.column_stack([np.cos(azimuths), np.sin(azimuths)]) * np.cos(rise)
            with np.errstate(divide="ignore"):
                walls_m = np.minimum(8 / np.abs(ways[:, 1]), 40 / np.abs(ways[:, 0]))
            ground_m = (1.7 + height_m) / -np.sin(rise) if rise < 0 else np.inf
            reach = np.minimum(walls_m, ground_m)
            points.append(np.column_stack([reach[:, None] * ways, reach * np.sin(rise) + height_m]))
            beams.append(np.full(len(reach), 32 * unit + beam))
    return np.concatenate(points), np.concatenate(beams)


def saved_cloud(folder, points, **fields):
    """A PLY file with the fields of Argoverse's, as a folder of scans."""
    names, columns = ["x", "y", "z", *fields], np.column_stack([points, *fields.values()])
    lines = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
    lines += [*(f"property float {name}" for name in names), "end_header"]
    folder.mkdir()
    rows = "\n".join(" ".join(f"{value:.6g}" for value in row) for row in columns.tolist())
    (folder / "0.ply").write_text("\n".join(lines) + f"\n{rows}\n")
    return ScanFolder.find(folder)


def test_beams_of_two_units_are_those_of_their_numbers(tmp_path):
    points, beams = two_units()
    order = np.random.default_rng(3).permutation(len(points))
    folder = saved_cloud(tmp_path / "two", points[order], laser_number=beams[order])
    (scan,) = folder
    assert len(np.unique(scan.ring)) == 64
    # Each ring is one beam, and lower ones have lower numbers.
    assert len(set(zip(scan.ring.tolist(), beams[order].tolist(), strict=True))) == 64
    elevations = np.arctan2(points[order, 2], np.hypot(*points[order, :2].T))
    means = [elevations[scan.ring == ring].mean() for ring in range(64)]
    assert np.all(np.diff(means) >= 0)
    (note,) = (note for note in folder.notes if "beam" in note)
    assert "laser_number as number of the beam" in note


def test_numbers_that_two_units_share_are_refused(tmp_path):
    points, beams = two_units()
    order = np.random.default_rng(3).permutation(len(points))
    folder = saved_cloud(tmp_path / "two", points[order], laser_number=beams[order] % 32)
    assert any("laser_number" in note and "several beams" in note for note in folder.notes)
    assert any("bands of elevation" in note for note in folder.notes)


def test_two_units_without_numbers_are_no_hundred_beams(tmp_path):
    points, _ = two_units()
    folder = saved_cloud(tmp_path / "mixed", np.random.default_rng(3).permutation(points))
    assert any("bands of elevation" in note for note in folder.notes)


def test_two_units_one_after_the_other_are_ranked_by_elevation():
    points, beams = two_units()
    ring = rings_of(points)
    assert len(set(zip(ring.tolist(), beams.tolist(), strict=True))) == 64
    elevations = np.arctan2(points[:, 2], np.hypot(*points[:, :2].T))
    assert np.all(np.diff([elevations[ring == each].mean() for each in range(64)]) >= 0)


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
def test_a_folder_without_beams_gives_the_estimates_of_the_drive(recorded, name):
    """Azimuth steps are others, so that features are, and what scans tell least of, height."""
    folder, inertial, steps = recorded
    *_, last = folder_estimates(ScanFolder.find(folder), name, imu=inertial)
    odometry = ODOMETRIES.make(name)
    odometry.reset(imu_mounting(DRIVE))
    *_, last_estimate = (odometry.update(step.scan, step.imu) for step in steps)
    expected = last_estimate.start_from_lidar.translation[:2]
    assert expected[0] > 20
    assert last.start_from_lidar.translation[:2] == pytest.approx(expected, abs=0.3)
    assert last.reason == last_estimate.reason
