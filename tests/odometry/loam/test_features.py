"""Which returns of a scan are edges, which are planes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_drive import ToyDrive

from roadscope.odometry.loam import (
    ADJACENT,
    GRAZING,
    JUMP,
    SAME_M,
    FeatureLimits,
    PickRule,
    cluster_roughness,
    extract,
    members,
    picked,
    roughness,
    sectors_of,
    sweep_of,
    unreliable,
)

COLUMNS = 720
AZIMUTHS = np.radians(np.linspace(-90, 90, COLUMNS))


def corner_room(rings=4, noise_m=0.0, seed=0):
    """Rings on walls at x = 10 and y = 6, with a common corner, measured from the origin."""
    reach = np.minimum(
        10 / np.maximum(np.cos(AZIMUTHS), 1e-9), 6 / np.maximum(np.abs(np.sin(AZIMUTHS)), 1e-9)
    )
    reach = reach + noise_m * np.random.default_rng(seed).standard_normal((rings, COLUMNS))
    up = np.tan(np.radians(np.linspace(-4, 4, rings)))[:, None]
    points = np.stack([reach * np.cos(AZIMUTHS), reach * np.sin(AZIMUTHS), reach * up], axis=2)
    ring, column = np.divmod(np.arange(rings * COLUMNS), COLUMNS)
    return as_scanned(points.reshape(-1, 3), ring, column)


def as_scanned(points, ring, column):
    """The dtypes of a scan: kernels compile for no others."""
    return points.astype(np.float32), ring.astype(np.int16), column.astype(np.int32)


def scrambled(rng, points, ring, column):
    order = rng.permutation(len(points))
    return points[order], ring[order], column[order], order


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def roughness_slowly(points, ring, column, neighbours):
    rough = np.full(len(points), np.nan)
    for each in np.unique(ring):
        rows = np.flatnonzero(ring == each)
        rows = rows[np.argsort(column[rows], kind="stable")]
        for k in range(neighbours, len(rows) - neighbours):
            around = points[rows[k - neighbours : k + neighbours + 1]]
            total = np.linalg.norm((around - points[rows[k]]).sum(axis=0))
            rough[rows[k]] = total / (2 * neighbours * np.linalg.norm(points[rows[k]]))
    return rough


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 999), count=st.integers(0, 80), neighbours=st.integers(1, 6))
def test_roughness_equals_that_of_the_slow_twin_in_any_order(seed, count, neighbours):
    rng = np.random.default_rng(seed)
    points, ring, column = as_scanned(
        rng.uniform(-20, 20, (count, 3)), rng.integers(0, 4, count), rng.permutation(count)
    )
    roughness_values = roughness(points, ring, column, neighbours=neighbours)
    assert roughness_values == pytest.approx(
        roughness_slowly(points, ring, column, neighbours), nan_ok=True
    )


def test_literal_roughness_is_the_distance_from_the_clusters_centre(rng):
    points, labels = rng.uniform(-9, 9, (60, 3)), rng.integers(-1, 4, 60)
    roughness_values = cluster_roughness(points, labels)
    for n, (point, label) in enumerate(zip(points, labels, strict=True)):
        own = points[labels == label]
        slow = np.linalg.norm((own - point).sum(axis=0)) / (len(own) * np.linalg.norm(point))
        assert (
            roughness_values[n] == pytest.approx(slow)
            if label >= 0
            else np.isnan(roughness_values[n])
        )


def test_a_corner_is_an_edge_and_walls_are_planes(rng):
    points, ring, column, _ = scrambled(rng, *corner_room(noise_m=2e-3))
    features = extract(points, ring, column, np.zeros(len(points), int))
    corner = np.hypot(features.edges[:, 0] - 10, np.abs(features.edges[:, 1]) - 6)
    assert (np.bincount(features.edge_rings[corner < 0.15], minlength=4) > 0).all()
    assert (corner[: features.sharp] < 0.3).mean() > 0.5
    flat = features.planes[: features.flat]
    on_wall = np.minimum(np.abs(flat[:, 0] - 10), np.abs(np.abs(flat[:, 1]) - 6))
    assert on_wall.max() < 0.02
    assert np.hypot(flat[:, 0] - 10, np.abs(flat[:, 1]) - 6).min() > 0.2
    assert len(features.planes) > features.flat > 40


def test_features_have_the_rows_of_their_returns(rng):
    points, ring, column, _ = scrambled(rng, *corner_room(noise_m=5e-3))
    labels = rng.integers(0, 3, len(points))
    features = extract(points, ring, column, labels)
    for kind in ("edge", "plane"):
        rows = getattr(features, f"{kind}_rows")
        assert len(set(rows.tolist())) == len(rows)
        assert (getattr(features, f"{kind}s") == points[rows]).all()
        assert (getattr(features, f"{kind}_rings") == ring[rows]).all()
        assert (getattr(features, f"{kind}_labels") == labels[rows]).all()
    assert not set(features.edge_rows) & set(features.plane_rows)
    shifted = features.at(points + 1.0)
    assert (shifted.edges == (points + 1.0)[features.edge_rows]).all()
    assert (shifted.planes == (points + 1.0)[features.plane_rows]).all()


def test_limits_hold_for_each_sector_and_for_each_cluster(rng):
    points, ring, column = corner_room(noise_m=0.02)
    limits = FeatureLimits(sharp=1, edges=3, flat=2, planes=5, thin_m=0.0)
    sweep = sweep_of(points, ring, column)
    features = extract(points, ring, column, np.zeros(len(points), int), limits=limits)
    group = sectors_of(sweep, 6)
    assert np.bincount(group[features.edge_rows]).max() <= 3
    assert np.bincount(group[features.edge_rows[: features.sharp]]).max() == 1
    assert np.bincount(group[features.plane_rows[: features.flat]]).max() == 2
    assert np.bincount(group[features.plane_rows]).max() <= 5 + 2
    labels = rng.integers(0, 4, len(points))
    features = extract(points, ring, column, labels, limits=limits, by_cluster=True)
    assert np.bincount(features.edge_labels).max() <= 3
    assert np.bincount(features.plane_labels[: features.flat]).tolist() == [2, 2, 2, 2]


def test_some_returns_give_no_features_and_some_no_edges():
    points, ring, column = corner_room(noise_m=5e-3)
    labels = np.where(points[:, 1] > 0, 0, -1)
    features = extract(points, ring, column, labels)
    assert features.edges[:, 1].min() > 0
    assert features.planes[:, 1].min() > 0
    features = extract(points, ring, column, np.zeros(len(points), int), edge_rows=labels == 0)
    assert features.edges[:, 1].min() > 0
    assert features.planes[:, 1].min() < -5


@pytest.mark.parametrize("count", [0, 1, 3, 11])
def test_few_points_give_few_features(count):
    points, ring, column = (each[:count] for each in corner_room())
    features = extract(points, ring, column, np.zeros(count, int))
    assert features.sharp <= len(features.edges) <= max(count - 10, 0)
    assert features.flat <= len(features.planes) <= max(count - 10, 0)
    none = extract(points, ring, column, np.full(count, -1), by_cluster=True)
    assert len(none.edges) == len(none.planes) == 0
    assert len(cluster_roughness(points, np.full(count, -1))) == count


def test_points_that_are_not_finite_are_no_features():
    points, ring, column = corner_room()
    points[::40] = np.nan
    features = extract(points, ring, column, np.zeros(len(points), int))
    assert np.isfinite(features.planes).all()
    assert np.isfinite(features.edges).all()


def test_returns_beside_an_occlusion_are_unreliable():
    points, ring, column = corner_room(rings=1)
    front = slice(300, 340)
    points[front] *= 0.5
    bad = unreliable(sweep_of(points, ring, column), 5)
    # Of the wall behind, on both sides; of the nearer body, nothing.
    assert np.flatnonzero(bad).tolist() == [*range(294, 300), *range(340, 346)]
    # A gap of columns hides nothing.
    spread_columns = np.where(column >= 300, column + ADJACENT + 1, column)
    spread_columns = np.where(column >= 340, spread_columns + ADJACENT + 1, spread_columns)
    assert not unreliable(sweep_of(points, ring, spread_columns), 5).any()


def test_a_surface_along_the_beam_is_unreliable():
    columns = np.arange(40)
    for steep, expected in ((0.02, True), (2.0, False)):
        reach = 10 * np.exp(columns * 1e-3 / steep)
        points = np.column_stack(
            [reach * np.cos(columns * 1e-3), reach * np.sin(columns * 1e-3), np.zeros(40)]
        )
        cosine = 1 / np.hypot(1, steep)
        assert (cosine > GRAZING) == expected
        bad = unreliable(sweep_of(*as_scanned(points, np.zeros(40), columns)), 0)
        assert bad[1:-1].all() if expected else not bad.any()
    assert np.exp(1e-3 / 0.02) - 1 < JUMP


def slowly_picked(sweep, rough, usable, group, rule):
    most, bound, sign, neighbours = rule
    usable, order, picked_rows = usable.copy(), sweep.order.tolist(), []
    for g in range(int(group.max()) + 1):
        for rank in range(most):
            best = [
                n for n in order if group[n] == g and usable[n] and sign * rough[n] > sign * bound
            ]
            if not best:
                break
            top = max(best, key=lambda n: sign * rough[n])
            picked_rows.append((top, rank))
            for step in (-1, 1):
                k = order.index(top)
                for _ in range(neighbours):
                    k, last = k + step, k
                    if not 0 <= k < len(order) or sweep.ring[order[k]] != sweep.ring[top]:
                        break
                    if np.linalg.norm(sweep.points[order[k]] - sweep.points[order[last]]) > SAME_M:
                        break
                    usable[order[k]] = False
            usable[top] = False
    return picked_rows, usable


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 999), sign=st.sampled_from([1.0, -1.0]))
def test_picks_equal_those_of_the_slow_twin(seed, sign):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(0, 0.25, (60, 3)), axis=0)
    ring, column = np.repeat([0, 1, 2], 20), np.tile(rng.permutation(20), 3)
    sweep = sweep_of(*as_scanned(points, ring, column))
    rough, usable = rng.random(60), rng.random(60) > 0.2
    group = rng.integers(0, 3, 60)
    rule = PickRule(3, 0.5, sign, 2)
    slow, left = slowly_picked(sweep, rough, usable, group, rule)
    rows, ranks = picked(sweep, rough, usable, members(group, sweep.order), rule)
    assert list(zip(rows.tolist(), ranks.tolist(), strict=True)) == slow
    assert (usable == left).all()


def test_members_leave_out_negative_groups():
    group, order = np.array([1, -1, 0, 1, -1]), np.array([4, 3, 2, 1, 0])
    places, starts = members(group, order)
    assert starts.tolist() == [0, 1, 3]
    assert places.tolist() == [2, 1, 4]
    for none in (np.empty(0, int), np.array([-1, -1])):
        places, starts = members(none, np.arange(len(none)))
        assert len(places) == 0
        assert starts.max() == 0


def test_a_street_has_edges_at_its_poles():
    scan = ToyDrive(0.0, 0.0, noise_m=0.005).scan(0)
    standing = scan.points[:, 2] > -1.5
    features = extract(
        scan.points, scan.ring, scan.column, np.zeros(len(scan), int), edge_rows=standing
    )
    assert len(features.edges) > 20
    assert features.edges[:, 2].min() > -1.5
    assert features.planes[:, 2].min() < -1.8
