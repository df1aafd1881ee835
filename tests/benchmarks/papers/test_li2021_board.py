import numpy as np
import pytest

from roadscope.benchmarks.papers.li2021_board import (
    board_prisms,
    calibrated,
    corners_of,
    true_corners,
)
from roadscope.core.projection import Projection
from roadscope.envs.sensors.rigs import rig
from roadscope.fusion.calibration_target import Board


def test_the_board_is_a_triangle_of_thin_slices() -> None:
    prisms = board_prisms(Board(base_m=1.5, height_m=1.2), 0.3)
    assert prisms.bottoms.min() == pytest.approx(0.3)
    assert prisms.tops.max() == pytest.approx(1.5)
    widths = np.ptp(prisms.footprints[..., 1], axis=1)
    assert (np.diff(widths) < 0).all()
    assert widths[len(widths) // 2] == pytest.approx(0.75, abs=0.01)


def test_a_tilted_board_reaches_from_corner_to_corner() -> None:
    tilt = (0.3, -0.15)
    corners = true_corners(Board(), np.array([0.0, 0.0, 0.4, 0.0, *tilt]))
    prisms = board_prisms(Board(), 0.4, *tilt)
    assert prisms.bottoms.min() == pytest.approx(corners[:, 2].min())
    assert prisms.tops.max() == pytest.approx(corners[:, 2].max())
    for axis in (0, 1):
        met = prisms.footprints[..., axis]
        assert met.min() == pytest.approx(corners[:, axis].min(), abs=0.02)
        assert met.max() == pytest.approx(corners[:, axis].max(), abs=0.02)


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.25, -0.12)])
def test_both_sensors_find_the_corners_where_they_are(tilt: tuple[float, float]) -> None:
    rng, carrier = np.random.default_rng(0), rig("wide")
    found, seen, true = corners_of(carrier, Board(), np.array([7.0, 0.4, 0.5, 0.2, *tilt]), rng)
    assert np.abs(found - true).max() < 0.03
    assert carrier.camera is not None
    pinhole = carrier.camera.spec.pinhole
    look = Projection.of(pinhole.intrinsics, carrier.camera.ego_from_camera, 640, 480)
    assert np.abs(seen - look.project(true)[0]).max() < 0.5


@pytest.mark.slow
def test_more_poses_calibrate_better() -> None:
    few, many = (
        np.median([calibrated(rig("wide"), n, seed)[1].held_out_px for seed in range(4)])
        for n in (6, 20)
    )
    assert many < few
    assert many < 1.0
