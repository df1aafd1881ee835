"""What every clustering promises, whatever it is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import CALIBRATION, scan, scan_of

from roadscope.core import Pose
from roadscope.detectors import Cloud
from roadscope.detectors.clustering import CLUSTERINGS

POSE = CALIBRATION.pose("lux")
CARS = [(22, 1, 4.6, 1.85, 1.5, 0.1), (35, 4, 4.6, 1.85, 1.5, 0), (22, -6, 4.6, 1.85, 1.5, 1.57)]
BY_CELLS_OF_THE_EGO_FRAME = {"pag", "pag-range"}

every = pytest.mark.parametrize("cluster", CLUSTERINGS.values(), ids=list(CLUSTERINGS))


@every
def test_labels_count_from_zero_and_outliers_are_negative(cluster):
    labels = cluster(Cloud.of(scan(CARS, noise_m=0.03), POSE))
    assert labels.dtype == np.int64
    cluster_labels = np.unique(labels[labels >= 0])
    assert len(cluster_labels) > 0
    assert np.array_equal(cluster_labels, np.arange(len(cluster_labels)))


@every
@given(seed=st.integers(0, 2**32 - 1))
def test_order_of_the_returns_changes_nothing(cluster, seed):
    sweep = scan(CARS, noise_m=0.03)
    order = np.random.default_rng(seed).permutation(len(sweep))
    straight, shuffled = Cloud.of(sweep, POSE), Cloud.of(sweep.select(order), POSE)
    assert np.array_equal(order[shuffled.rows], straight.rows)
    assert np.array_equal(cluster(shuffled), cluster(straight))


@every
@given(angle=st.floats(-3, 3), x=st.floats(-30, 30))
def test_grouping_moves_with_the_scene(cluster, angle, x):
    sweep = scan(CARS, noise_m=0.03, ground=False)
    if cluster in [CLUSTERINGS[name] for name in BY_CELLS_OF_THE_EGO_FRAME]:
        angle = 0.0
    moved = Cloud.of(sweep, Pose.planar(x, -2.0, angle, 0.55))
    assert np.array_equal(cluster(moved), cluster(Cloud.of(sweep, POSE)))


@every
@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_returns(cluster, count):
    sweep = scan(CARS[:1], ground=False).select(np.arange(count))
    assert cluster(Cloud.of(sweep, POSE)).shape == (count,)


@every
def test_copies_share_a_label(cluster):
    sweep = scan(CARS[:1], ground=False)
    doubled = Cloud.of(sweep.select(np.repeat(np.arange(len(sweep)), 2)), POSE)
    labels = cluster(doubled)
    assert np.array_equal(labels[::2], labels[1::2])


@every
def test_returns_on_a_line(cluster):
    points = np.column_stack([np.full(40, 12.0), np.linspace(-2, 2, 40), np.zeros(40)])
    line = scan_of(points, column=np.arange(40)[::-1])
    assert cluster(Cloud.of(line, POSE)).shape == (40,)
