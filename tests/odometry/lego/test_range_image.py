"""Ground and objects in the image of beams and columns."""

import math
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from toy_drive import ToyDrive, emptied

from roadscope.odometry.lego import (
    GROUND,
    LEVEL,
    NONE,
    OBJECT_ANGLE_RAD,
    features_of,
    ground_and_objects,
    ground_of,
    objects_of,
    range_image,
)

BOUNDS_M = (1.0, 120.0)


def random_image(seed):
    """Few beams and columns all round, with gaps, so that all that can touch does."""
    rng = np.random.default_rng(seed)
    ring, column = (a.ravel() for a in np.indices((5, 24)))
    there = rng.random(len(ring)) > 0.2
    ring, column = ring[there], column[there]
    up, around = np.radians(4.0 * ring - 12), np.radians(15.0 * column)
    reach = rng.choice([4.0, 8.0, 30.0], len(ring)) * rng.uniform(0.9, 1.1, len(ring))
    points = reach[:, None] * np.column_stack(
        [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    )
    return range_image(points, ring, column, *BOUNDS_M)


def slow_objects(image, ground, least):
    """Join whatever belongs together until nothing changes."""
    rings, columns = image.rows.shape
    group = {n: n for n in image.rows.ravel().tolist() if n != NONE and not ground[n]}
    changed = True
    while changed:
        changed = False
        for r in range(rings):
            for c in range(columns):
                for up, on in ((1, 0), (0, 1)):
                    if r + up >= rings:
                        continue
                    n, m = int(image.rows[r, c]), int(image.rows[r + up, (c + on) % columns])
                    if n not in group or m not in group or group[n] == group[m]:
                        continue
                    near, far = sorted((image.points[n], image.points[m]), key=np.linalg.norm)
                    angle = np.arccos(
                        (far - near) @ far / np.linalg.norm(far - near) / np.linalg.norm(far)
                    )
                    if angle > OBJECT_ANGLE_RAD:
                        old, new = group[n], group[m]
                        group = {k: new if g == old else g for k, g in group.items()}
                        changed = True
    members = {}
    for n, g in group.items():
        members.setdefault(g, set()).add(n)
    return {frozenset(each) for each in members.values() if len(each) >= least}


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 9999), least=st.integers(1, 6))
def test_objects_equal_those_of_the_slow_twin(seed, least):
    image = random_image(seed)
    ground = np.random.default_rng(seed).random(len(image.points)) < 0.2
    labels = objects_of(image, ground, least)
    objects = {frozenset(np.flatnonzero(labels == k).tolist()) for k in range(labels.max() + 1)}
    assert objects == slow_objects(image, ground, least)
    assert (labels[ground] == NONE).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 9999))
def test_ground_equals_that_of_the_slow_twin(seed):
    image = random_image(seed)
    slow = set()
    for c in range(image.rows.shape[1]):
        column = [n for n in image.rows[:, c].tolist() if n != NONE]
        above = [k for k, n in enumerate(column) if image.points[n, 2] >= 0]
        column = column[: above[0]] if above else column
        for a, b in pairwise(column):
            x, y, z = image.points[b] - image.points[a]
            if abs(z) <= LEVEL * math.hypot(x, y):
                slow |= {a, b}
    assert set(np.flatnonzero(ground_of(image)).tolist()) == slow


def test_the_image_contains_returns_within_bounds():
    points = np.array([[5.0, 0, 0], [0.1, 0, 0], [500, 0, 0], [np.nan, 0, 0], [6, 1, 0]])
    image = range_image(points, np.array([0, 1, 2, 0, 1]), np.array([0, 1, 2, 3, 2]), *BOUNDS_M)
    assert image.rows.shape == (3, 4)
    assert np.argwhere(image.rows != NONE).tolist() == [[0, 0], [1, 2]]
    none = range_image(np.empty((0, 3)), np.empty(0, int), np.empty(0, int), *BOUNDS_M)
    assert len(ground_of(none)) == len(objects_of(none, np.zeros(0, bool), 30)) == 0


def test_a_street_has_ground_and_houses_and_small_things_are_dropped():
    scan = ToyDrive(0.0, 0.0).scan(0)
    labelled_sweep = ground_and_objects(scan)
    height = labelled_sweep.points[:, 2] + 1.9
    ground = labelled_sweep.labels == GROUND
    # Where a house ends the road the slope up to it may be gentle: that is ground to the rule.
    assert (np.abs(height[ground]) < 0.3).mean() > 0.95
    assert (height[~ground] > 0.3).mean() > 0.95
    assert (ground & (np.abs(height) < 0.1)).sum() > 0.95 * (np.abs(height) < 0.1).sum()
    assert (
        len(ground_and_objects(scan, least=400))
        < len(labelled_sweep)
        < len(ground_and_objects(scan, least=1))
    )
    assert np.allclose(labelled_sweep.points, scan.points[labelled_sweep.rows])
    assert len(ground_and_objects(emptied(scan))) == 0


def test_edges_are_of_objects_and_matched_planes_of_the_ground():
    labelled_sweep = ground_and_objects(ToyDrive(0.0, 0.0).scan(0))
    features = features_of(labelled_sweep, labelled_sweep.points)
    assert (features.edge_labels != GROUND).all()
    assert (features.plane_labels[: features.flat] == GROUND).all()
    assert (features.plane_labels[features.flat :] != GROUND).any()
    assert 0 < features.sharp <= 2 * 6 * 16
    assert 0 < features.flat <= 4 * 6 * 16
