import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roadscope.core import wrap_angle
from roadscope.detectors import Cloud
from roadscope.detectors.shape import DEPTH_M, clusters, contours


def make(points, column):
    points = np.column_stack([np.array(points, float), np.ones(len(points))])
    return Cloud(
        points, np.arange(len(points)), np.array(column), np.arange(len(points)), np.zeros(2)
    )


def contours_one_by_one(cloud, labels):
    """Go through clusters and columns in Python."""
    outlines = []
    for label in np.unique(labels[labels >= 0]):
        points = []
        for column in np.unique(cloud.column[labels == label]):
            rows = np.flatnonzero((labels == label) & (cloud.column == column))
            rows = rows[np.argsort(cloud.ranges[rows], kind="stable")]
            rows = rows[cloud.ranges[rows] <= cloud.ranges[rows[0]] + DEPTH_M]
            middle = rows[[(len(rows) - 1) // 2, len(rows) // 2]]
            points.append(cloud.points[middle, :2].mean(axis=0))
        points = np.array(points)
        x, y = (points - cloud.origin).T
        azimuths = wrap_angle(np.arctan2(y, x) - np.arctan2(y.mean(), x.mean()))
        outlines.append(points[np.lexsort((y, x, azimuths))])
    return outlines


@given(st.integers(0, 2**32 - 1), st.integers(0, 80), st.booleans())
def test_equals_going_through_one_by_one(seed, count, swept):
    """On clouds with several bodies in a column, in firing order or in none."""
    rng = np.random.default_rng(seed)
    column = rng.integers(0, 30, count)
    column = np.sort(column) if swept else column
    angles = 3.0 - 0.1 * column + rng.choice([0, 0.01], count)
    reach = rng.choice([8.0, 8.2, 8.5, 9.5, 20.0], count) + 0.01 * rng.standard_normal(count)
    points = reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]) + [1.0, 2.0]
    row = np.arange(count)
    returns = Cloud(
        np.column_stack([points, np.zeros(count)]), row, column, row, np.array([1.0, 2.0])
    )
    labels = rng.integers(-1, 3, count)
    expected = contours_one_by_one(returns, labels)
    outlines = contours(returns, labels)
    assert len(outlines) == len(expected)
    for ours, theirs in zip(outlines, expected, strict=True):
        assert np.array_equal(ours, theirs)
    for cluster, label in zip(
        clusters(returns, labels), np.unique(labels[labels >= 0]), strict=True
    ):
        rows = np.flatnonzero(labels == label)
        rows = rows[np.argsort(column[rows], kind="stable")]
        assert np.array_equal(cluster.points, returns.points[rows])
        assert np.array_equal(cluster.ring, rows)
        assert np.array_equal(cluster.column, column[rows])


def test_one_point_a_column_on_the_nearest_face():
    cloud = make([(10.0, 0), (10.1, 0), (11.5, 0), (10, 1)], [4, 4, 4, 5])
    (outline,) = contours(cloud, np.zeros(4, int))
    assert np.allclose(outline, [(10.05, 0), (10, 1)])


def test_clusters_in_one_column_are_separate_and_outliers_dropped():
    cloud = make([(10.0, 0), (20, 0), (30, 0)], [4, 4, 4])
    first, second = contours(cloud, np.array([1, -1, 0]))
    assert first.tolist() == [[30, 0]]
    assert second.tolist() == [[10, 0]]


def test_order_by_azimuth_across_the_seam():
    angles = np.array([3.0, -3.1, 3.1, -3.0])
    cloud = make(5 * np.column_stack([np.cos(angles), np.sin(angles)]), [0, 1, 2, 3])
    (outline,) = contours(cloud, np.zeros(4, int))
    turned = np.arctan2(outline[:, 1], outline[:, 0]) % (2 * np.pi)
    assert np.allclose(turned, np.array([3.0, 3.1, -3.1, -3.0]) % (2 * np.pi))


def test_nothing():
    assert contours(make([(10.0, 0)], [0]), np.array([-1])) == []
    assert not list(clusters(make([(10.0, 0)], [0]), np.array([-1])))
