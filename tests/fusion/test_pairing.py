import numpy as np
import pytest

from roadscope.core import Pose, Projection, RecordError
from roadscope.fusion import ALONE, ClocksApartError, moved_projection, nearest_images


def test_each_scan_takes_the_image_nearest_in_time() -> None:
    scans, images = 0.04 + np.arange(20) / 12.5, 0.02 + np.arange(30) / 16
    rows = nearest_images(scans, images)
    slow = [min(range(30), key=lambda k: abs(images[k] - s)) for s in scans]
    assert rows.tolist() == slow
    assert np.abs(images[rows] - scans).max() <= 1 / 32 + 1e-9


def test_a_scan_in_a_gap_between_images_stays_alone() -> None:
    rows = nearest_images(np.array([0.0, 0.5, 1.0]), np.array([0.99, 0.01]))
    assert rows.tolist() == [1, ALONE, 0]
    assert nearest_images(np.array([0.0]), np.empty(0)).tolist() == [ALONE]


def test_clocks_that_disagree_are_named() -> None:
    with pytest.raises(ClocksApartError, match="3600 s apart"):
        nearest_images(np.array([0.0, 0.1]), np.array([3600.1, 3600.2]))
    with pytest.raises(RecordError, match="finite"):
        nearest_images(np.array([np.nan]), np.array([0.0]))


def test_what_stands_still_is_projected_where_a_later_image_shows_it() -> None:
    projection = Projection(
        np.array([[320.0, -500, 0, 0], [240, 0, -500, 700], [1, 0, 0, 0]]), 640, 480
    )
    # 20 m/s ahead for 0.08 s between scans; the image comes 0.03 s after the scan.
    previous_from_ego = Pose.planar(1.6, 0.0, 0.0)
    moved = moved_projection(projection, previous_from_ego, 0.08, 0.03)
    pixels, depth = moved.project(np.array([20.0, 2.0, 1.0]))
    expected, nearer = projection.project(np.array([20.0 - 0.6, 2.0, 1.0]))
    assert np.allclose(pixels, expected)
    assert depth == pytest.approx(nearer)
    assert moved_projection(projection, None, 0.08, 0.03) is projection
