import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from roadscope.detectors.clustering import single_linkage


def linked_by_tree(points, distance):
    """List all pairs."""
    pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    labels = connected_components(graph, directed=False)[1]
    _, first = np.unique(labels, return_index=True)
    return np.argsort(np.argsort(first))[labels]


def linked_by_brute_force(points, distance):
    """Relax labels over all pairs until nothing changes."""
    labels = np.arange(len(points))
    gaps = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    while True:
        lowest = np.array([labels[row <= distance].min() for row in gaps], int)
        if np.array_equal(lowest, labels):
            return np.unique(labels, return_inverse=True)[1]
        labels = lowest


clouds = st.integers(0, 40).flatmap(
    lambda n: arrays(float, (n, 2), elements=st.integers(0, 60).map(lambda v: v * 0.25))
)


@given(clouds, st.sampled_from([0.25, 0.5, 1.0, 1.3]))
def test_equals_brute_force(points, distance):
    expected = linked_by_brute_force(points, distance)
    assert np.array_equal(single_linkage(points, distance), expected)


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2))
def test_equals_listing_all_pairs(seed, distance):
    points = np.random.default_rng(seed).normal(0, [20, 5], (500, 2))
    assert np.array_equal(single_linkage(points, distance), linked_by_tree(points, distance))


def test_many_equal_points_are_one_cluster():
    assert (single_linkage(np.zeros((5000, 2)), 0.5) == 0).all()
