import numpy as np
import pytest
from toy_boxes import detections, truth

from roadscope.benchmarks.metrics.overlap import overlaps


def test_of_records() -> None:
    shares = overlaps(detections([[0, 0], [50, 0]]), truth([[0, 0.9], [4.5, 0], [50, 0]]))
    assert shares == pytest.approx(np.array([[1 / 3, 0, 0], [0, 0, 1]]))
    assert overlaps(detections([]), truth([[0, 0]])).shape == (0, 1)
