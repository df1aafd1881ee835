"""PAG against the formula of the paper, term by term."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roadscope.detectors.clustering import OUTLIER, density_threshold, label_cells, pag_labels


def threshold_by_eq_2(largest: int, total: int, grid_num: int) -> float:
    """Eq. 2 with its sequences written out."""
    N = math.isqrt(largest)
    A = [float(largest)]
    for _ in range(N - 1):
        A.append(A[-1] - N)
    B = [(A[m] + A[m + 1]) / 2 for m in range(N - 1)]
    return (sum(B) / (N - 1)) / (sum(A) / N) * total / grid_num


@given(st.integers(4, 5000), st.integers(1, 10000), st.integers(1, 400))
def test_threshold_is_eq_2(largest, total, grid_num):
    expected = threshold_by_eq_2(largest, total, grid_num)
    assert density_threshold(total, grid_num) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("largest", [1, 2, 3])
def test_eq_2_has_no_value_for_one_level(largest):
    with pytest.raises(ZeroDivisionError):
        threshold_by_eq_2(largest, 10, 5)
    assert density_threshold(10, 5) == 2


def labels_by_flooding(counts: np.ndarray) -> np.ndarray:
    """Cluster cells one by one as section 2.1 says."""
    K, occupied = len(counts), counts > 0
    threshold = counts.sum() / occupied.sum()

    def around(cell):
        i, j = cell
        return [
            (a, b)
            for a in range(max(i - 1, 0), min(i + 2, K))
            for b in range(max(j - 1, 0), min(j + 2, K))
        ]

    dense = {c for c in np.ndindex(K, K) if counts[c] > threshold}
    kept_cells = {c for c in np.ndindex(K, K) if occupied[c] and any(n in dense for n in around(c))}
    labels, cluster_count = np.full((K, K), OUTLIER), 0
    for cell in sorted(kept_cells):
        if labels[cell] != OUTLIER:
            continue
        stack = [cell]
        while stack:
            here = stack.pop()
            labels[here] = cluster_count
            stack += [n for n in around(here) if n in kept_cells and labels[n] == OUTLIER]
        cluster_count += 1
    return labels


@given(st.lists(st.sampled_from([0, 0, 0, 1, 2, 5, 9]), min_size=36, max_size=36).filter(any))
def test_cells_join_as_in_the_paper(values):
    counts = np.array(values, float).reshape(6, 6)
    assert np.array_equal(label_cells(counts, counts > 0), labels_by_flooding(counts))


def test_dense_group_stays_and_scattered_points_go():
    rng = np.random.default_rng(0)
    body = rng.uniform(0, 1, (80, 2)) + 50
    scattered = rng.uniform(0, 100, (20, 2))
    scattered = scattered[np.abs(scattered - 50).max(axis=1) > 25]
    labels = pag_labels(np.concatenate([body, scattered]), np.ones(80 + len(scattered)))
    assert (labels[:80] == 0).all()
    assert (labels[80:] == OUTLIER).all()


@pytest.mark.parametrize(
    "points", [np.empty((0, 2)), np.zeros((1, 2)), np.zeros((9, 2)), np.arange(18).reshape(9, 2)]
)
def test_degenerate_clouds(points):
    labels = pag_labels(points.astype(float), np.ones(len(points)))
    assert labels.shape == (len(points),)
    assert labels.dtype == np.int64
    # No cell holds more than the mean, so none is dense.
    assert (labels == OUTLIER).all()


def test_weight_makes_the_far_body_dense():
    near, far = np.full((30, 2), 10.0), np.full((6, 2), 50.0)
    noise = np.array([[10.0, 50.0], [50.0, 10.0], [30.0, 30.0]])
    points = np.concatenate([near, far, noise])
    assert (pag_labels(points, np.ones(len(points)))[30:36] == OUTLIER).all()
    assert (pag_labels(points, points[:, 0] ** 2)[30:36] >= 0).all()
