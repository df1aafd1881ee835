import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from roadscope.trackers.components import components, sorted_by


@given(st.integers(0, 2**32 - 1))
def test_components_are_scipys(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 8, 2).tolist()
    rows, columns = rng.integers(0, n, (p := rng.integers(0, 9))), rng.integers(0, m, p)
    found, count = components(rows, columns, (n, m))
    pairs = coo_matrix((np.ones(p), (rows, n + columns)), (n + m, n + m))
    _, expected = connected_components(pairs, directed=False)
    paired = np.zeros(n + m, bool)
    paired[rows] = paired[n + columns] = True
    assert ((found >= 0) == paired).all()
    same = found[paired][:, None] == found[paired]
    assert (same == (expected[paired][:, None] == expected[paired])).all()
    # Numbers are given by first row, none left out.
    _, first = np.unique(found[:n][found[:n] >= 0], return_index=True)
    assert len(first) == count
    assert (np.diff(first) > 0).all()


@given(st.lists(st.integers(-1, 4)))
def test_sorted_by_labels(labels):
    labels = np.array(labels, np.int64)
    order, starts = sorted_by(labels, 5)
    for label in range(5):
        found = order[starts[label] : starts[label + 1]]
        assert found.tolist() == np.flatnonzero(labels == label).tolist()
