import numpy as np
import pytest

from roadscope.benchmarks import (
    TargetPose,
    calibrate_from_corners,
    held_out_error_px,
    projection_of,
    target_prisms,
    target_view,
    target_views,
    true_corners,
)
from roadscope.envs import find_rig
from roadscope.fusion import TriangularTarget


def test_the_target_is_a_triangle_of_thin_slices() -> None:
    target = TriangularTarget(base_m=1.5, height_m=1.2)
    prisms = target_prisms(target, TargetPose(7.0, 1.0, 0.3, 0.2))
    assert prisms.bottoms.min() == pytest.approx(0.3)
    assert prisms.tops.max() == pytest.approx(1.5)
    widths = np.ptp(prisms.footprints[..., 1], axis=1)
    assert (np.diff(widths) < 0).all()
    assert widths[len(widths) // 2] == pytest.approx(0.75, abs=0.01)


def test_a_tilted_target_reaches_from_corner_to_corner() -> None:
    pose = TargetPose(0.0, 0.0, 0.4, 0.0, pitch_rad=0.3, roll_rad=-0.15)
    corners = true_corners(TriangularTarget(), pose)
    prisms = target_prisms(TriangularTarget(), pose)
    assert prisms.bottoms.min() == pytest.approx(corners[:, 2].min())
    assert prisms.tops.max() == pytest.approx(corners[:, 2].max())
    for axis in (0, 1):
        outline = prisms.footprints[..., axis]
        assert outline.min() == pytest.approx(corners[:, axis].min(), abs=0.02)
        assert outline.max() == pytest.approx(corners[:, axis].max(), abs=0.02)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.25, -0.12)])
def test_both_sensors_detect_the_corners_where_they_are(tilt: tuple[float, float]) -> None:
    carrier, target = find_rig("wide"), TriangularTarget()
    pose = TargetPose(7.0, 0.4, 0.5, 0.2, *tilt)
    view = target_view(carrier, target, pose, np.random.default_rng(0))
    true = true_corners(target, pose)
    assert np.abs(view.points - true).max() < 0.03
    assert np.abs(view.pixels - projection_of(carrier).project(true)[0]).max() < 0.5


@pytest.mark.slow
def test_more_poses_calibrate_better() -> None:
    carrier = find_rig("wide")

    def error_px(poses: int, seed: int) -> float:
        views = target_views(carrier, poses, np.random.default_rng([seed, poses]))
        return held_out_error_px(carrier, calibrate_from_corners(carrier, views, seed).projection)

    few, many = (np.median([error_px(n, seed) for seed in range(3)]) for n in (6, 20))
    assert many < few
    assert many < 1.0
