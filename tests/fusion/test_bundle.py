"""Camera and targets together: laws on targets that four rings of thin beams meet."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from roadscope.core import Pose
from roadscope.fusion import (
    BeamDirections,
    CalibrationError,
    ScannedTarget,
    State,
    TriangularTarget,
    calibrate,
    corners_in_scans,
    decompose,
    descend,
    distances_px,
    edge_errors,
    image_errors,
    range_errors,
    refine,
    scanned_target,
    stacked_measurements,
)

TARGET = TriangularTarget()
BEAMS = BeamDirections(np.radians(30 - 0.25 * np.arange(240)), np.radians([-1.2, -0.4, 0.4, 1.2]))
INNER = np.array([[1600.0, 0, 640], [0, 1600, 480], [0, 0, 1]])
CAMERA = INNER @ np.array([[0.0, -1, 0, 0.1], [0, 0, -1, 0.85], [1, 0, 0, 3]])
SCANS = 25


def poses(count: int, seed: int) -> list[Pose]:
    """Of the target's plane y-z, LiDAR frame."""
    rng = np.random.default_rng(seed)
    ahead = rng.uniform(3.5, 9.0, count)
    return [
        Pose.from_euler(x, 0.2 * x * a, z, yaw=yaw, pitch=pitch, roll=roll)
        for x, a, z, yaw, pitch, roll in zip(
            ahead,
            rng.uniform(-1, 1, count),
            rng.uniform(-0.45, -0.25, count),
            *rng.uniform(-1, 1, (3, count)) * [[0.5], [0.2], [0.1]],
            strict=True,
        )
    ]


def corners_at(pose: Pose) -> np.ndarray:
    flat = TARGET.corners
    return pose.apply(np.column_stack([np.zeros(3), -flat[:, 0], flat[:, 1]]))


def returns(pose: Pose, noise_m: float, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Points, ring and column of a triangle that beams hit exactly inside its edges."""
    ring, column = (x.ravel() for x in np.meshgrid(np.arange(4), np.arange(240), indexing="ij"))
    rays = BEAMS.rays(ring, column)
    normal = pose.rotation[:, 0]
    ranges = (normal @ pose.translation) / (rays @ normal)
    _, y, z = pose.inverse().apply(rays * ranges[:, None]).T
    half = TARGET.base_m / 2 * (1 - z / TARGET.height_m)
    on = np.flatnonzero((ranges > 0) & (z > 0) & (np.abs(y) < half))
    on = np.repeat(on, SCANS)
    far = ranges[on] + noise_m * rng.standard_normal(len(on))
    return rays[on] * far[:, None], ring[on], column[on]


def project(points: np.ndarray) -> np.ndarray:
    homogeneous = points @ CAMERA[:, :3].T + CAMERA[:, 3]
    return homogeneous[:, :2] / homogeneous[:, 2:]


def measured_targets(
    count: int, seed: int, noise_px: float = 0.1, noise_m: float = 0.1
) -> tuple[np.ndarray, np.ndarray, list[ScannedTarget]]:
    """Corners in scans, pixels and scanned."""
    rng = np.random.default_rng([seed, 1])
    corners, pixels, scanned = [], [], []
    for pose in poses(count, seed):
        got = returns(pose, noise_m, rng)
        corners.append(corners_in_scans(*got, TARGET, BEAMS.step_rad))
        pixels.append(project(corners_at(pose)) + noise_px * rng.standard_normal((3, 2)))
        scanned.append(scanned_target(*got, BEAMS, SCANS))
    return np.stack(corners), np.stack(pixels), scanned


def linear(corners: np.ndarray, pixels: np.ndarray, known: bool = False) -> np.ndarray:
    calibration = calibrate(
        corners.reshape(-1, 3),
        pixels.reshape(-1, 2),
        1280,
        960,
        gate_px=25.0,
        intrinsics=INNER if known else None,
    )
    return calibration.projection.matrix


def off_px(matrix: np.ndarray) -> float:
    """Of targets that were not used."""
    fresh = np.concatenate([corners_at(pose) for pose in poses(30, 99)])
    return float(np.sqrt((distances_px(matrix, fresh, project(fresh)) ** 2).mean()))


@pytest.mark.parametrize("known", [False, True])
def test_it_beats_corners_alone(known: bool) -> None:
    shares = []
    for seed in range(5):
        corners, pixels, scanned = measured_targets(8, seed)
        start = linear(corners, pixels, known)
        refined = refine(start, corners, pixels, scanned, TARGET, free_intrinsics=not known)
        shares.append(off_px(refined.matrix) / off_px(start))
    assert np.median(shares) < 0.7


def test_many_targets_leave_less_than_a_pixel() -> None:
    corners, pixels, scanned = measured_targets(20, 7)
    refined = refine(linear(corners, pixels), corners, pixels, scanned, TARGET)
    assert off_px(refined.matrix) < 1.0
    true = np.stack([corners_at(pose) for pose in poses(20, 7)])
    middle = [np.median(np.linalg.norm(c - true, axis=2)) for c in (refined.corners, corners)]
    assert middle[0] < middle[1]


def test_a_refined_target_has_the_sides_of_the_target() -> None:
    corners, pixels, scanned = measured_targets(5, 3)
    refined = refine(linear(corners, pixels), corners, pixels, scanned, TARGET)
    flat = TARGET.corners
    for k in range(3):
        sides = np.linalg.norm(refined.corners[:, k] - refined.corners[:, k - 1], axis=1)
        assert sides == pytest.approx(np.linalg.norm(flat[k] - flat[k - 1]), abs=1e-9)


def test_known_intrinsics_are_kept() -> None:
    corners, pixels, scanned = measured_targets(5, 3)
    start = linear(corners, pixels, known=True)
    refined = refine(start, corners, pixels, scanned, TARGET, free_intrinsics=False)
    assert decompose(refined.matrix)[0] == pytest.approx(INNER, abs=1e-6)


def test_the_order_of_targets_is_irrelevant() -> None:
    corners, pixels, scanned = measured_targets(6, 4)
    start = linear(corners, pixels)
    refined = refine(start, corners, pixels, scanned, TARGET)
    turned = refine(start, corners[::-1], pixels[::-1], scanned[::-1], TARGET)
    # Both stop within the same thousandths of a pixel, not at the same bit.
    assert abs(off_px(refined.matrix) - off_px(turned.matrix)) < 0.05


def test_a_beam_that_hits_another_object_changes_little() -> None:
    corners, pixels, scanned = measured_targets(12, 5)
    start = linear(corners, pixels)
    wrong = []
    for each in scanned:
        hit_share = each.hit_share.copy()
        hit_share[0] = 1 - hit_share[0]
        wrong.append(replace(each, hit_share=hit_share))
    refined = refine(start, corners, pixels, wrong, TARGET)
    assert off_px(refined.matrix) < off_px(start)


def test_the_plane_is_as_sure_as_it_says() -> None:
    rng, pose = np.random.default_rng(2), poses(1, 8)[0]
    normal = pose.rotation[:, 0]
    true = normal / (normal @ pose.translation)
    squares = []
    for _ in range(60):
        each = scanned_target(*returns(pose, 0.1, rng), BEAMS, SCANS)
        squares.append(float(((each.plane_root @ (true - each.plane)) ** 2).sum()))
    # Mean of 60 chi squares of three degrees of freedom: 3 with a standard deviation of 0.32.
    assert 2.0 < np.mean(squares) < 4.3


def test_stray_ranges_do_not_move_the_plane() -> None:
    rng, pose = np.random.default_rng(2), poses(1, 8)[0]
    points, ring, column = returns(pose, 0.02, rng)
    clean = scanned_target(points, ring, column, BEAMS, SCANS)
    stray = rng.random(len(points)) < 0.05
    points = points * np.where(stray, 1.3, 1.0)[:, None]
    mixed = scanned_target(points, ring, column, BEAMS, SCANS)
    assert np.linalg.norm(clean.plane_root @ (mixed.plane - clean.plane)) < 1.0


def test_beams_on_both_sides_of_every_end_are_kept() -> None:
    _, _, scanned = measured_targets(4, 6)
    for each in scanned:
        assert min((each.hit_share > 0.5).sum(), (each.hit_share < 0.5).sum()) >= 8


def test_the_descent_ends_where_a_dense_one_does() -> None:
    """The slow, obvious way: one dense problem of all unknowns."""
    corners, pixels, scanned = measured_targets(4, 9)
    camera = decompose(linear(corners, pixels, known=True))[1].inverse().matrix[:3]
    targets = np.stack([pose.matrix[:3] for pose in poses(4, 9)])[:, :, [1, 2, 0, 3]]
    targets = targets * [-1.0, 1.0, -1.0, 1.0]  # right, up, towards the sensor
    state, data = (
        State(np.array([1600.0, 1600, 640, 480]), camera, targets),
        stacked_measurements(pixels, scanned),
    )

    def image(at: State) -> np.ndarray:
        return image_errors(at.intrinsics, at.camera, at.targets, data, TARGET)

    def alone(at: State) -> np.ndarray:
        edges = edge_errors(at.targets, data, TARGET, 0.5)
        return np.concatenate([range_errors(at.targets, data), edges], axis=1)

    def errors(at: State) -> np.ndarray:
        return np.concatenate([image(at), alone(at)], axis=1)

    def dense(x: np.ndarray) -> np.ndarray:
        return errors(state.moved(x[:6], x[6:].reshape(-1, 6))).ravel()

    final_state = descend(image, alone, state, 6)
    slow = least_squares(dense, np.zeros(30), xtol=1e-10, ftol=1e-10, gtol=1e-10)
    assert (errors(final_state) ** 2).sum() == pytest.approx(2 * slow.cost, rel=1e-3)
    assert (errors(state) ** 2).sum() > 4 * slow.cost


def test_unequal_numbers_are_refused() -> None:
    corners, pixels, scanned = measured_targets(4, 1)
    with pytest.raises(CalibrationError, match="got 4, 4 and 3"):
        refine(CAMERA, corners, pixels, scanned[:3], TARGET)
    with pytest.raises(CalibrationError, match="at least 6 returns, got 2"):
        scanned_target(np.ones((2, 3)), np.zeros(2, int), np.zeros(2, int), BEAMS, 1)
