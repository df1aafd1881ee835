import numpy as np

from roadscope.detectors.cloud import Cloud
from roadscope.detectors.shape.contour import contours


def make(points, column):
    points = np.column_stack([np.array(points, float), np.ones(len(points))])
    return Cloud(
        points, np.arange(len(points)), np.array(column), np.arange(len(points)), np.zeros(2)
    )


def test_one_point_a_column_on_the_nearest_face():
    cloud = make([(10.0, 0), (10.1, 0), (11.5, 0), (10, 1)], [4, 4, 4, 5])
    (outline,) = contours(cloud, np.zeros(4, int))
    assert np.allclose(outline, [(10.05, 0), (10, 1)])


def test_clusters_apart_in_one_column_and_outliers_dropped():
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
