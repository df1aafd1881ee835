import numpy as np
import pytest

from roadscope.detectors.shape import Segment


@pytest.mark.parametrize("angle", np.linspace(-3.1, 3.1, 13))
def test_line_of_any_direction(angle):
    direction = np.array([np.cos(angle), np.sin(angle)])
    offsets = np.array([0.1, -0.1, -0.1, 0.1])[:, None] * np.array([-direction[1], direction[0]])
    segment = Segment(np.arange(4.0)[:, None] * direction + offsets + [3.0, -2.0])
    assert np.allclose(segment.direction, direction)
    assert segment.length == pytest.approx(3.0)
    assert np.allclose(np.abs(segment.residuals), 0.1)
