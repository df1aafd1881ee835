"""Rigid motions, their logarithms, and what kernels make of them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from roadscope.odometry import (
    adjoint,
    deskewed,
    eigen3,
    exp_se3,
    exp_so3,
    inverse,
    log_se3,
    log_so3,
    orthonormal,
    placed,
    thinned,
)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6, 1e-10, 0.0])
def test_logarithm_undoes_exponential(rng, size):
    for _ in range(20):
        twist = size * rng.standard_normal(6)
        assert log_se3(exp_se3(twist)) == pytest.approx(twist, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 2.0, 3.1, np.pi - 1e-7, np.pi])
def test_turns_up_to_half_a_turn_are_scipys(rng, angle):
    for axis in [*np.eye(3), *rng.standard_normal((30, 3))]:
        turn = angle * axis / np.linalg.norm(axis)
        rotation_vector, known = (
            log_so3(exp_so3(turn)),
            Rotation.from_matrix(exp_so3(turn)).as_rotvec(),
        )
        # Half a turn either way is the same.
        either = rotation_vector if rotation_vector @ known >= 0 else -rotation_vector
        assert (either if angle > 3.14 else rotation_vector) == pytest.approx(known, abs=1e-8)


def test_inverse_adjoint_and_repair(rng):
    a, twist = exp_se3(rng.standard_normal(6)), rng.standard_normal(6)
    assert np.allclose(inverse(a) @ a, np.eye(4))
    assert np.allclose(exp_se3(adjoint(a) @ twist), a @ exp_se3(twist) @ inverse(a))
    askew = a.copy()
    askew[:3, :3] *= 1.001
    assert np.allclose(orthonormal(askew), a)


def test_deskewing_moves_points_along_the_motion_of_the_sweep(rng):
    twist = np.array([30.0, 1.0, -0.5, 0.3, -0.2, 1.5])
    points, times = rng.uniform(-80, 80, (50, 3)), rng.uniform(-0.06, 0.06, 50)
    slow = [(exp_se3(twist * t) @ np.append(p, 1))[:3] for p, t in zip(points, times, strict=True)]
    assert np.allclose(deskewed(points, times, twist), slow, atol=1e-7)
    whole = exp_se3(twist)
    assert np.allclose(placed(points, whole), points @ whole[:3, :3].T + whole[:3, 3])


def test_one_point_of_each_cube_remains(rng):
    points = rng.uniform(-5, 5, (500, 3)).astype(np.float32)
    points[7] = np.nan
    rows = thinned(points, 2.0, 1.0, 6.0)
    cells, slow = set(), []
    for n, point in enumerate(points.astype(float)):
        cell = tuple(np.floor(point / 2.0)) if np.isfinite(point).all() else None
        if cell and 1.0 <= np.linalg.norm(point) <= 6.0 and cell not in cells:
            cells.add(cell)
            slow.append(n)
    assert rows.tolist() == slow


def test_eigenvalues_of_small_matrices(rng):
    values, vectors = np.empty(3), np.empty((3, 3))
    flat = np.diag([2.0, 0.0, 2.0])
    for matrix in [flat, np.zeros((3, 3)), *(a @ a.T for a in rng.standard_normal((50, 3, 3)))]:
        eigen3(matrix.copy(), values, vectors)
        assert np.allclose(values, np.linalg.eigvalsh(matrix))
        assert np.allclose(vectors.T @ np.diag(values) @ vectors, matrix)
        assert np.allclose(vectors @ vectors.T, np.eye(3))
