"""A camera that detects nothing, without a scan, still says when its image was taken."""

import numpy as np
import pytest

from roadscope import FUSIONS, Projection
from roadscope.benchmarks.formats import EGO_FROM_CAMERA
from roadscope.core import ImageDetections, Pose

AHEAD = Pose.from_parts(EGO_FROM_CAMERA.rotation, np.array([0.0, 0.0, 1.5]))
INTRINSICS = np.array([[700.0, 0, 600], [0, 700, 180], [0, 0, 1]])
PROJECTION = Projection.of(INTRINSICS, AHEAD, 1200, 370)


@pytest.mark.parametrize("name", list(FUSIONS))
def test_targets_have_the_stamp_of_an_empty_image(name: str) -> None:
    fusion = FUSIONS.make(name)
    fusion.reset()
    fused = fusion.fuse(None, ImageDetections.empty(0.1), PROJECTION)
    assert len(fused) == 0
    assert fused.stamp_s == pytest.approx(0.1)
