"""What a body's unknowns make of its outline."""

import numpy as np
from slow_footprints import support

from roadscope.detectors.pose.body_kernels import FRONT, REAR
from roadscope.detectors.pose.body_model import UNKNOWNS, saloon


def test_no_corner_stands_out_beyond_its_storey():
    """A roof that ends between the axles has its corners where it ends."""
    unknowns = np.random.default_rng(0).standard_normal((64, UNKNOWNS))
    for body in saloon((4.7, 0.2), (1.8, 0.05)).parts(unknowns):
        for part in body:
            ahead, behind = support(part, 1.0, 0.0, 0.0, 0.0), support(part, -1.0, 0.0, 0.0, 0.0)
            assert ahead[0] <= part[FRONT] + 1e-9
            assert behind[0] <= -part[REAR] + 1e-9
