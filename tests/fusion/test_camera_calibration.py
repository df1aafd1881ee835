import numpy as np
import pytest
from toy_camera import OPTICAL

from roadscope.core import Pose, Projection
from roadscope.fusion import CalibrationError, calibrate, decompose, distances_px, solve_linear

INTRINSICS = np.array([[1600.0, 0, 640], [0, 1600.0, 480], [0, 0, 1]])


def camera(rng: np.random.Generator) -> tuple[Projection, Pose]:
    turn = Pose.from_euler(
        0, 0, 0, yaw=rng.normal(0, 0.03), pitch=rng.normal(0, 0.03), roll=rng.normal(0, 0.03)
    ).rotation
    pose = Pose.from_parts(turn @ OPTICAL, np.array([2.0, 0.1, 1.4]))
    return Projection.of(INTRINSICS, pose, 1280, 960), pose


def board_points(rng: np.random.Generator, poses: int) -> np.ndarray:
    triangle = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.9]])
    placed = []
    for _ in range(poses):
        pose = Pose.from_euler(
            rng.uniform(6, 16),
            rng.uniform(-2, 2),
            rng.uniform(0.3, 1.5),
            yaw=rng.uniform(-0.7, 0.7),
        )
        placed.append(pose.apply(triangle))
    return np.concatenate(placed)


@pytest.mark.parametrize("seed", range(5))
def test_exact_points_give_the_exact_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, pose = camera(rng)
    points = board_points(rng, 4)
    pixels, _ = truth.project(points)
    assert np.allclose(solve_linear(points, pixels), truth.matrix, rtol=1e-5, atol=1e-4)
    result = calibrate(points, pixels, 1280, 960)
    assert np.allclose(result.projection.matrix, truth.matrix, rtol=1e-6, atol=1e-5)
    assert result.reprojection_px < 1e-4
    intrinsics, decomposed_pose = decompose(result.projection.matrix)
    assert np.allclose(intrinsics, INTRINSICS, rtol=1e-5, atol=1e-3)
    assert np.allclose(decomposed_pose.matrix, pose.matrix, atol=1e-5)


@pytest.mark.slow
def test_more_poses_give_a_better_matrix_and_outliers_are_left_out() -> None:
    errors = {}
    for poses in (6, 20):
        missed = []
        for seed in range(12):
            rng = np.random.default_rng(seed)
            truth, _ = camera(rng)
            points = board_points(rng, poses)
            pixels = truth.project(points)[0] + rng.normal(0, 0.5, (len(points), 2))
            noisy_points = points + rng.normal(0, 0.01, points.shape)
            wrong = rng.choice(len(points), len(points) // 9, replace=False)
            pixels[wrong] += rng.uniform(60, 200, (len(wrong), 2))
            result = calibrate(noisy_points, pixels, 1280, 960)
            assert not result.inliers[wrong].any()
            fresh = board_points(np.random.default_rng(99), 30)
            missed.append(
                np.sqrt(
                    (
                        distances_px(result.projection.matrix, fresh, truth.project(fresh)[0]) ** 2
                    ).mean()
                )
            )
        errors[poses] = float(np.median(missed))
    assert errors[20] < 0.7 * errors[6]
    assert errors[20] < 1.5


def test_what_determines_nothing_is_refused() -> None:
    rng = np.random.default_rng(0)
    truth, _ = camera(rng)
    flat = np.column_stack([np.full(9, 8.0), rng.uniform(0, 1, (9, 2))])
    with pytest.raises(CalibrationError, match="one plane"):
        calibrate(flat, truth.project(flat)[0], 1280, 960)
    with pytest.raises(CalibrationError, match="at least 6"):
        calibrate(flat[:4], truth.project(flat[:4])[0], 1280, 960)
    points = board_points(rng, 5)
    with pytest.raises(CalibrationError, match="finite"):
        calibrate(points, truth.project(points)[0] * np.nan, 1280, 960)
    with pytest.raises(CalibrationError, match="no camera explains"):
        calibrate(points, rng.uniform(0, 1000, (15, 2)), 1280, 960, gate_px=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_points_that_have_nothing_to_do_with_one_another_have_no_camera(seed: int) -> None:
    rng = np.random.default_rng(seed)
    with pytest.raises(CalibrationError, match="more than half of the 21 points"):
        calibrate(rng.uniform(2, 9, (21, 3)), rng.uniform(0, 600, (21, 2)), 640, 480)
