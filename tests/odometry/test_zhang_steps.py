"""Steps of Zhang 2022's chain: equations by hand, and properties."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_drive import driven

from roadscope.core import construct
from roadscope.odometry import (
    LARGEST_DYNAMIC_SHARE,
    DynamicThreshold,
    ZhangOdometry,
    ZhangSettings,
    exp_se3,
    sensor_height,
)
from roadscope.odometry.clusters import (
    NO_PARTNER,
    REACH_M,
    Clustering,
    ClusterMatch,
    Segments,
    centres_of,
    match_clusters,
    segments_of,
)
from roadscope.odometry.loam import (
    FeatureMatch,
    ImuPrediction,
    deskewed_between,
    misfit_of,
    with_prediction,
)

AHEAD = exp_se3(np.array([1.0, 0, 0, 0, 0, 0]))
GUARDED = ZhangSettings(guarded=True, threshold=DynamicThreshold(dimensions=2, sampled=0.01))


def test_centres_are_means():
    points = np.array([[0.0, 0, 0], [2, 0, 0], [5, 5, 5], [9, 9, 9]])
    centres, sizes = centres_of(points, np.array([0, 0, 1, -1]))
    assert centres.tolist() == [[1, 0, 0], [5, 5, 5]]
    assert sizes.tolist() == [2, 1]


def test_a_cluster_that_moved_and_one_without_partner_are_dynamic():
    before = np.array([[5.0, 0, 0], [0, 5, 0]])
    now = np.array([[4.0, 0, 0], [-1, 5.4, 0], [20, 0, 0]])
    matches = match_clusters(now, before, AHEAD, 0.3)
    assert matches.partners.tolist() == [0, 1, NO_PARTNER]
    assert matches.moved_m[:2] == pytest.approx([0.0, 0.4])
    assert matches.dynamic.tolist() == [False, True, True]


def test_a_displacement_has_three_dimensions_as_in_equation_4_or_two():
    now, before = np.array([[1.0, 2.0, 0.5]]), np.array([[1.0, 2.3, 0.1]])
    assert match_clusters(now, before, np.eye(4), 0.4).moved_m == pytest.approx([0.5])
    seen_from_above = match_clusters(now, before, np.eye(4), 0.4, dimensions=2)
    assert seen_from_above.moved_m == pytest.approx([0.3])
    assert not seen_from_above.dynamic.any()


def test_epsilon_as_printed_links_only_points_within_2_cm():
    scan = driven(1, columns=1800)[1][0][0]
    taken, printed = (segments_of(scan, Clustering(spacings=k)) for k in (2.0, 0.0))
    assert len(printed.sizes) < len(taken.sizes)


def test_partners_are_one_to_one_and_the_nearest_pair_comes_first():
    before = np.array([[0.0, 0, 0]])
    matches = match_clusters(np.array([[0.5, 0, 0], [0.1, 0, 0]]), before, np.eye(4), 1.0)
    assert matches.partners.tolist() == [NO_PARTNER, 0]
    assert match_clusters(np.empty((0, 3)), before, np.eye(4), 1.0).dynamic.shape == (0,)


@given(st.integers(0, 1000))
def test_partners_equal_those_of_the_slow_twin(seed):
    """The nearest of all pairs first, then of the remaining ones, while any is within reach."""
    rng = np.random.default_rng(seed)
    before, now = (rng.integers(-6, 6, (n, 3)).astype(float) for n in (9, 7))
    now[0] = np.nan if seed % 2 else now[0]
    moved = now @ AHEAD[:3, :3].T + AHEAD[:3, 3]
    distances_m = np.linalg.norm(moved[:, None] - before, axis=2)
    distances_m[np.isnan(distances_m)] = np.inf
    partners = np.full(7, NO_PARTNER)
    while np.isfinite(distances_m).any() and distances_m.min() <= REACH_M:
        row, column = np.unravel_index(np.argmin(distances_m), distances_m.shape)
        partners[row] = column
        distances_m[row], distances_m[:, column] = np.inf, np.inf
    assert np.array_equal(match_clusters(now, before, AHEAD, 0.1).partners, partners)


@given(st.integers(0, 1000))
def test_matching_does_not_depend_on_the_frame(seed):
    """Of all level ones: how far a centre moved is counted over the ground."""
    rng = np.random.default_rng(seed)
    before, now = rng.uniform(-9, 9, (6, 3)), rng.uniform(-9, 9, (5, 3))
    turned = exp_se3(rng.uniform(-1, 1, 6) * [1, 1, 1, 0, 0, 1])
    carried = before @ turned[:3, :3].T + turned[:3, 3]
    one, other = (
        match_clusters(now, before, AHEAD, 1.0),
        match_clusters(now, carried, turned @ AHEAD, 1.0),
    )
    assert np.array_equal(one.partners, other.partners)
    assert one.moved_m == pytest.approx(other.moved_m)


@given(st.integers(0, 1000))
def test_deskewing_applies_the_share_of_turn_and_displacement(seed):
    rng = np.random.default_rng(seed)
    points, motion = rng.uniform(-9, 9, (4, 3)), exp_se3(rng.uniform(-0.5, 0.5, 6))
    still = deskewed_between(points, np.zeros(4), motion, 0.1)
    assert still == pytest.approx(points)
    whole = deskewed_between(points, np.full(4, 0.1), motion, 0.1)
    displacement = motion[:3, :3].T @ motion[:3, 3]
    assert whole == pytest.approx(points @ motion[:3, :3].T + displacement)


def test_imu_predicts_a_bend_at_known_speed():
    drive, inputs = driven(4)
    imu = ImuPrediction(None)
    for _, samples in inputs:
        imu.add(samples)
    imu.velocity = drive.twist[:3]
    start_s, end_s = inputs[1][0].stamp_s, inputs[2][0].stamp_s
    predicted = imu.motion(start_s, end_s)
    assert predicted[:3, :3] == pytest.approx(exp_se3(drive.twist * 0.1)[:3, :3], abs=1e-6)
    # The pull of the bend is taken for a part of gravity at the start: v w t^2 / 2.
    assert predicted[:3, 3] == pytest.approx(exp_se3(drive.twist * 0.1)[:3, 3], abs=0.005)


def test_without_samples_the_velocity_is_constant():
    imu = ImuPrediction(None)
    imu.velocity = np.array([3.0, 0, 0])
    assert imu.motion(0.0, 0.1)[:3, 3] == pytest.approx([0.3, 0, 0])


def test_sensor_height_of_a_level_ground():
    rng = np.random.default_rng(0)
    ground = np.column_stack([rng.uniform(-15, 15, (500, 2)), rng.normal(-1.9, 0.01, 500)])
    assert sensor_height(ground) == pytest.approx(1.9, abs=0.01)
    assert np.isnan(sensor_height(ground + np.array([0, 0, 5])))


def match_of(deviations_m, displacement):
    information = np.diag([50 / np.square(d) for d in deviations_m] + [1e6] * 3)
    motion = np.eye(4)
    motion[:3, 3] = displacement
    return FeatureMatch(motion, information, 0.01, 100)


def test_unobservable_directions_stay_as_predicted():
    feature_match = match_of((0.01, 0.02, 1.0), (1.0, 0.2, 3.0))
    assert with_prediction(AHEAD, feature_match)[:3, 3] == pytest.approx([1.0, 0.2, 0.0])
    assert misfit_of(feature_match) == ""
    assert "in one direction" in misfit_of(match_of((1.0, 0.02, 0.02), (1.0, 0, 0)))


def test_segments_stand_above_the_ground_and_are_large():
    scan = driven(1)[1][0][0]
    above_ground = segments_of(scan, Clustering())
    assert above_ground.points[:, 2].min() > -1.9 + 0.1
    assert above_ground.sizes.min() >= 30
    assert np.array_equal(
        above_ground.points, scan.points[above_ground.rows].astype(float)
    ) or np.allclose(above_ground.points, scan.points[above_ground.rows], atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"roughness": "box"}, "roughness is 'ring' or 'cluster', got 'box'"),
        ({"map_every": -1}, "map_every must be 0 or more, got -1"),
        ({"dimensions": 1}, "dimensions is 2 or 3, got 1"),
        ({"loop": True}, "loop asks for map_every of 1 or more"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        construct(ZhangOdometry, settings)


@pytest.fixture
def moving_start():
    """An odometry after six scans of a drive at 8 m/s, the drive, and all its inputs."""
    drive, inputs = driven(10, columns=1800)
    odometry = ZhangOdometry(GUARDED)
    for each in inputs[:6]:
        odometry.update(*each)
    return odometry, drive, inputs


def away(estimate, drive, scan):
    """Horizontal error: a scan without ground has little information about height."""
    off = estimate.start_from_lidar.matrix - drive.pose(scan.stamp_s)
    return np.abs(off[:2, 3]).max()


@pytest.mark.slow
def test_a_start_at_speed_does_not_make_everything_dynamic():
    """At 8 m/s all that stands has moved 0.8 m by the second scan."""
    drive, inputs = driven(6, columns=1800)
    odometry = ZhangOdometry(GUARDED)
    estimates = [odometry.update(*each) for each in inputs]
    assert max(away(t, drive, s) for t, (s, _) in zip(estimates, inputs, strict=True)) < 0.1


def test_static_clusters_are_not_dynamic(moving_start):
    """It is, where clusters are cut as each scan sees them, or features keep old numbers."""
    odometry, drive, inputs = moving_start
    estimates = [odometry.update(*each) for each in inputs[6:]]
    assert max(t.dynamic.mean() for t in estimates) < 0.1
    assert away(estimates[-1], drive, inputs[-1][0]) < 0.1
    before = odometry._before
    own = odometry.cut(before.segments, np.eye(4))
    assert np.array_equal(before.segments.labels, own.labels)
    assert np.array_equal(before.features.edge_labels, own.labels[before.features.edge_rows])
    assert np.array_equal(before.features.plane_labels, own.labels[before.features.plane_rows])


@pytest.mark.parametrize("away_share", [0.9, 1.1])
def test_nothing_is_dropped_if_too_many_clusters_are_dynamic(moving_start, away_share):
    """The prediction is then wrong rather than the street."""
    odometry, _, _ = moving_start
    before = odometry._before
    count = len(before.segments.sizes)
    sizes, dynamic = (
        np.ones(count, np.int64),
        np.arange(count) < away_share * LARGEST_DYNAMIC_SHARE * count,
    )
    clusters = ClusterMatch(np.arange(count), np.zeros(count), dynamic)
    _, dropped = odometry._matched(before.features, clusters, sizes, np.eye(4))
    assert dropped.tolist() == (dynamic if away_share < 1 else np.zeros(count, bool)).tolist()


def test_a_wrong_speed_is_corrected(moving_start):
    odometry, drive, inputs = moving_start
    odometry._imu.velocity = odometry._imu.velocity + np.array([0.0, 4.0, 0.0])
    estimates = [odometry.update(*each) for each in inputs[6:]]
    assert not estimates[0].dynamic.any()
    assert away(estimates[-1], drive, inputs[-1][0]) < 0.6
    assert odometry._imu.velocity[1] == pytest.approx(0.0, abs=0.3)


def test_columns_of_a_degree_have_too_few_features():
    odometry = ZhangOdometry()
    estimates = [odometry.update(*each) for each in driven(10)[1]]
    assert sum(not each.ok for each in estimates) >= 5


@pytest.mark.parametrize(("sampled", "dynamic"), [(0.01, False), (0.0, True)])
def test_the_threshold_of_dynamic_clusters_grows_with_range(sampled, dynamic):
    """By 0.3 m at 40 m, where beams of a VLP-16 are 0.14 m apart, or 1.4 m."""

    def cluster_at(shift_m):
        row = np.zeros(1, np.int64)
        there = np.array([[40.0, shift_m, 0.0]])
        return Segments(there, row, row, np.zeros(1), row, row, there, row + 1, row)

    rule = ZhangOdometry(ZhangSettings(threshold=DynamicThreshold(sampled=sampled)))
    matches = rule.compared(cluster_at(0.3), cluster_at(0.0), np.eye(4), 0.1)
    assert matches.dynamic.tolist() == [dynamic]


def test_a_map_uses_every_nth_scan_and_zero_uses_none():
    plain, mapped = ZhangOdometry(), ZhangOdometry(ZhangSettings(map_every=2))
    for each in driven(8, columns=1800)[1]:
        one, other = plain.update(*each), mapped.update(*each)
    assert np.array_equal(plain._mapping.map_from_start, np.eye(4))
    assert not plain._mapping.keyframes
    # Of seven scans that have steps the first makes a keyframe, and every second one after it.
    assert len(mapped._mapping.keyframes) == 4
    assert not np.array_equal(one.start_from_lidar.matrix, other.start_from_lidar.matrix)


@pytest.mark.parametrize(
    ("settings", "is_equal"),
    [
        (ZhangSettings(map_every=5), True),
        (ZhangSettings(map_every=5, loop=True), True),
        (ZhangSettings(clustering=Clustering(spacings=0.0)), False),
        (ZhangSettings(roughness="cluster"), False),
        (GUARDED, False),
    ],
)
def test_methods_with_other_maps_make_the_same_matches(settings, is_equal):
    assert (ZhangOdometry(settings).matching == ZhangOdometry().matching) == is_equal
