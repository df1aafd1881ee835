import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import Pose, wrap_angle

lengths = st.floats(-100, 100)
angles = st.floats(-3, 3)
poses = st.builds(
    lambda x, y, z, yaw, pitch, roll: Pose.from_euler(x, y, z, yaw=yaw, pitch=pitch, roll=roll),
    lengths,
    lengths,
    lengths,
    angles,
    st.floats(-1.5, 1.5),
    angles,
)


@given(poses, poses, poses)
def test_poses_are_a_group(a: Pose, b: Pose, c: Pose) -> None:
    np.testing.assert_allclose(((a @ b) @ c).matrix, (a @ (b @ c)).matrix, atol=1e-9)
    np.testing.assert_allclose((a @ a.inverse()).matrix, np.eye(4), atol=1e-9)
    point = np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose((a @ b).apply(point), a.apply(b.apply(point)), atol=1e-9)


@given(poses, poses, st.floats(0, 1))
def test_interpolation_meets_both_ends_and_splits_the_turn(a: Pose, b: Pose, u: float) -> None:
    np.testing.assert_allclose(a.interpolate(b, 0).matrix, a.matrix, atol=1e-9)
    np.testing.assert_allclose(a.interpolate(b, 1).matrix, b.matrix, atol=1e-6)
    between = a.interpolate(b, u)
    whole, part = turn(a, b), turn(a, between)
    assert part == pytest.approx(u * whole, abs=1e-5)


def turn(a: Pose, b: Pose) -> float:
    """Angle between two attitudes, by the trace of the relative rotation."""
    relative = a.rotation.T @ b.rotation
    sine = np.linalg.norm(relative - relative.T) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(relative) - 1) / 2))


def test_angles_left_out_are_zero() -> None:
    np.testing.assert_array_equal(Pose.from_euler(1, 2, 3).rotation, np.eye(3))


def test_yaw_turns_left_pitch_dips_the_nose_and_roll_drops_the_right() -> None:
    np.testing.assert_allclose(Pose.planar(1, 2, np.pi / 2).apply([1, 0, 0]), [1, 3, 0], atol=1e-12)
    assert Pose.from_euler(0, 0, 0, pitch=0.1).apply([1, 0, 0])[2] < 0
    assert Pose.from_euler(0, 0, 0, roll=0.1).apply([0, -1, 0])[2] < 0


@given(st.floats(-50, 50))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle(angle))
    assert -np.pi <= wrapped <= np.pi
    assert np.cos(wrapped - angle) == pytest.approx(1)
