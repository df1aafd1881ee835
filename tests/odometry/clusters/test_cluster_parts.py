"""Clusters that are cut by the search angle."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roadscope.detectors.clustering import quick_azimuth
from roadscope.odometry import exp_se3, inverse
from roadscope.odometry.clusters import Segments, centres_of, match_clusters, parts


def segments(points, labels):
    rows = np.arange(len(points))
    centres, sizes = centres_of(points, labels)
    zeros = np.zeros(len(points))
    return Segments(points, rows, rows, zeros, rows, labels, centres, sizes, labels)


def slow_part_labels(points, labels, motion, angle_deg):
    """One return after the other, as the docstring says."""
    count, numbers, part_labels = int(np.ceil(360 / angle_deg - 1e-9)), {}, []
    for point, label in zip(points, labels, strict=True):
        x, y, _ = motion[:3, :3] @ point + motion[:3, 3]
        window = int((quick_azimuth(x, y) / (2 * np.pi) + 0.5) * count) % count
        key = (label, window)
        part_labels.append(-1 if label < 0 else numbers.setdefault(key, len(numbers)))
    return np.array(part_labels)


@given(st.integers(0, 1000), st.sampled_from([5.0, 7.0, 90.0, 180.0, 360.0]), st.booleans())
def test_parts_are_of_one_cluster_and_one_window(seed, angle_deg, swept):
    rng = np.random.default_rng(seed)
    points, labels = rng.uniform(-9, 9, (300, 3)), rng.integers(-1, 4, 300)
    if swept:
        points = points[np.argsort(np.arctan2(points[:, 1], points[:, 0]))]
    motion = exp_se3(rng.uniform(-1, 1, 6))
    cluster_parts = parts(segments(points, labels), angle_deg, motion)
    assert np.array_equal(cluster_parts.labels, slow_part_labels(points, labels, motion, angle_deg))
    assert cluster_parts.sizes.sum() == (labels >= 0).sum()
    for part, centre in enumerate(cluster_parts.centres):
        assert np.allclose(centre, points[cluster_parts.labels == part].mean(axis=0))


def test_centres_of_parts_of_a_wall_do_not_move_with_the_sensor():
    """The centre of the whole wall moves with the sensor, since its range is limited."""
    wall = np.column_stack([np.linspace(-8, 8, 1601), np.full(1601, 3.0), np.zeros(1601)])
    motion = exp_se3(np.array([1.0, 0, 0, 0, 0, 0.1]))

    def segments_from(place):
        points = wall @ inverse(place)[:3, :3].T + inverse(place)[:3, 3]
        near = np.abs(points @ place[0, :3]) < 6.0
        return segments(points[near], np.zeros(near.sum(), np.int64))

    before, now = segments_from(np.eye(4)), segments_from(motion)
    whole = match_clusters(now.centres, before.centres, motion, 0.1)
    assert whole.dynamic.all()
    cut = parts(now, 5.0, motion), parts(before, 5.0, np.eye(4))
    matches = match_clusters(cut[0].centres, cut[1].centres, motion, 0.1)
    assert len(matches.dynamic) > 20
    # What only one of the scans shows is at the ends.
    assert matches.dynamic.sum() <= 3
    assert np.median(matches.moved_m) < 0.01


def test_an_empty_scan_has_no_parts():
    cluster_parts = parts(segments(np.empty((0, 3)), np.empty(0, np.int64)), 5.0, np.eye(4))
    assert len(cluster_parts.centres) == 0
    outliers = parts(segments(np.ones((3, 3)), np.full(3, -1)), 5.0, np.eye(4))
    assert outliers.labels.tolist() == [-1, -1, -1]
    assert len(outliers.centres) == 0
