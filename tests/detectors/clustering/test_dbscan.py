import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from toy_lidar import cloud

from roadscope.detectors.clustering import OUTLIER, cluster_dbscan, density_labels


def by_scikit_learn(points, radius, min_points):
    """Search by tree: scikit-learn's brute force rounds distances to points at the radius."""
    if not len(points):
        return np.empty(0, int)
    from sklearn.cluster import DBSCAN

    return DBSCAN(eps=radius, min_samples=min_points, algorithm="kd_tree").fit_predict(points)


# A quarter is exact in floating point: many points lie at the radius itself or on one another.
lattice = st.integers(0, 60).flatmap(
    lambda n: arrays(float, (n, 2), elements=st.integers(0, 16).map(lambda v: v * 0.25))
)


@given(lattice, st.sampled_from([0.25, 0.5, 1.0, 1.25]), st.integers(1, 8))
def test_labels_are_scikit_learns_on_a_lattice(points, radius, min_points):
    expected = by_scikit_learn(points, radius, min_points)
    assert np.array_equal(density_labels(points, radius, min_points), expected)


@given(st.integers(0, 2**32 - 1), st.integers(1, 400), st.floats(0.05, 3), st.integers(1, 12))
def test_labels_are_scikit_learns_in_disorder(seed, count, radius, min_points):
    rng = np.random.default_rng(seed)
    lumps = rng.uniform(-20, 20, (8, 2))
    points = lumps[rng.integers(0, 8, count)] + rng.standard_normal((count, 2))
    points = np.concatenate([points, points[: count // 4]])
    rng.shuffle(points)
    expected = by_scikit_learn(points, radius, min_points)
    assert np.array_equal(density_labels(points, radius, min_points), expected)


@pytest.mark.parametrize("span", [1e-6, 1.0, 1e5])
def test_any_scale(span):
    points = span * np.random.default_rng(3).uniform(-1, 1, (300, 2))
    for radius in (0.03 * span, 0.2 * span):
        expected = by_scikit_learn(points, radius, 4)
        assert np.array_equal(density_labels(points, radius, 4), expected)


def test_far_outlier_does_not_slow_down_or_change():
    points = np.concatenate([np.random.default_rng(0).uniform(0, 2, (50, 2)), [[1e7, -1e7]]])
    assert density_labels(points, 1.0, 3)[-1] == OUTLIER
    assert (density_labels(points, 1.0, 3)[:-1] == 0).all()


def test_two_cars_and_a_lone_return():
    returns = cloud([(25, 0, 4.6, 1.85, 1.5, 0), (24, 7, 4.6, 1.85, 1.5, 0)], ground=False)
    labels = cluster_dbscan(returns)
    assert set(labels[np.abs(returns.points[:, 1]) < 1.5]) == {0}
    assert set(labels[returns.points[:, 1] > 5]) == {1}
    assert (cluster_dbscan(returns.select(np.arange(1))) == OUTLIER).all()
    assert cluster_dbscan(returns.select(np.arange(0))).shape == (0,)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"eps_m": 0.0}, "eps_m must be a positive length in metres, got 0.0"),
        ({"eps_m": float("nan")}, "eps_m must be a positive length"),
        ({"min_points": 0}, "min_points must be at least 1, got 0"),
    ],
)
def test_bad_options_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        cluster_dbscan(cloud([], ground=False), **options)
