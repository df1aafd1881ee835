import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from roadscope.detectors.clustering.union import components


@given(st.integers(1, 30), st.lists(st.tuples(st.integers(0, 29), st.integers(0, 29))))
def test_equals_scipy(size, links):
    links = np.array([link for link in links if max(link) < size], int).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(links)), links.T), shape=(size, size))
    expected = connected_components(graph, directed=False)[1]
    assert np.array_equal(components(size, *links.T), expected)


def test_numbered_by_first_appearance():
    labels = components(5, np.array([4, 1]), np.array([2, 3]))
    assert labels.tolist() == [0, 1, 2, 1, 2]
