"""From points to pixels, and what is no camera."""

import numpy as np
import pytest

from roadscope.core import Pose, Projection, RecordError

INTRINSICS = np.array([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]])
EGO_FROM_CAMERA = Pose.from_parts(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.0, 1.5])
)
"""One metre ahead of the ego's origin, 1.5 m high, looking ahead."""


def test_points_by_hand() -> None:
    projection = Projection.of(INTRINSICS, EGO_FROM_CAMERA, 640, 480)
    pixels, depths = projection.project(np.array([[11.0, 2.0, 1.5], [5.0, 0.0, 0.0]]))
    np.testing.assert_allclose(pixels, [[320 - 80, 240], [320, 240 + 150]])
    np.testing.assert_allclose(depths, [10, 4])
    assert projection.height_m == pytest.approx(1.5)


@pytest.mark.parametrize(("width", "height"), [(0, 480), (640, 0), (-1, 480)])
def test_an_image_without_pixels_is_refused(width: int, height: int) -> None:
    with pytest.raises(RecordError, match="an image"):
        Projection.of(INTRINSICS, EGO_FROM_CAMERA, width, height)
