"""Clusters of more than one body."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import cloud

from roadscope.core import Bounds
from roadscope.detectors import Horizon
from roadscope.detectors.shape import SHAPES, clusters, cut

PAIR = [(16, 1.6, 4.6, 1.85, 1.5, 0), (32, -1.2, 4.6, 1.85, 1.5, 0)]


def merged(boxes):
    """All returns in one cluster, and the horizon."""
    returns = cloud(boxes, ground=False, noise_m=0.02)
    (cluster,) = clusters(returns, np.zeros(len(returns), np.int64))
    return cluster, Horizon.of(returns, np.ones(len(returns), bool), Bounds(-0.96, 0.96))


def test_two_cars_in_one_cluster_are_both_found():
    vehicles = SHAPES["l-shape"](*merged(PAIR))
    assert len(vehicles) == 2
    for vehicle, (x, y, *_) in zip(sorted(vehicles, key=lambda v: -v.centre[1]), PAIR, strict=True):
        assert vehicle.centre == pytest.approx((x, y), abs=0.4)


def test_a_wall_is_not_cut_into_cars():
    wall = [(30, 0, 0.3, 30, 2, 0)]
    assert SHAPES["l-shape"](*merged(wall)) == []


@given(seed=st.integers(0, 10**6), count=st.integers(1, 4))
def test_parts_share_out_the_returns(seed, count):
    rng = np.random.default_rng(seed)
    boxes = [(*rng.uniform((15, -10), (40, 10)), 4.5, 1.8, 1.5, yaw) for yaw in rng.random(count)]
    whole, _ = merged(boxes)
    parts = cut(whole)
    assert len(parts) in (0, 2)
    if parts:
        assert sum(len(p.points) for p in parts) == len(whole.points)
        assert np.array_equal(np.concatenate([p.outline for p in parts]), whole.outline)
