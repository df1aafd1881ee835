from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from toy_lidar import cloud

from roadscope.core import wrap_angle
from roadscope.detectors import Cloud
from roadscope.detectors.clustering import INCIDENCE_RAD, MAX_STEPS, cluster_breakpoint, reach


def linked_one_by_one(returns, noise_m):
    """Go through beams and columns in Python."""
    azimuths, ranges, pairs, measured = returns.azimuths, returns.ranges, [], []
    for beam in np.unique(returns.ring):
        rows = np.flatnonzero(returns.ring == beam)
        rows = rows[np.argsort(azimuths[rows], kind="stable")]
        for a, b in zip(rows, np.roll(rows, -1), strict=True):
            step, column_gap = abs(wrap_angle(azimuths[b] - azimuths[a])), returns.column[b]
            column_gap = abs(column_gap - returns.column[a])
            measured += [step / column_gap] if column_gap else []
            pairs.append((a, b, step))
    step = np.median(measured) if measured else 0.0
    for column in np.unique(returns.column):
        rows = np.flatnonzero(returns.column == column)
        rows = rows[np.argsort(returns.ring[rows], kind="stable")]
        pairs += [(a, b, step) for a, b in pairwise(rows)]
    labels = np.arange(len(returns))
    for a, b, turn in pairs:
        gap = np.hypot(*(returns.points[a] - returns.points[b])[:2])
        limit = reach(np.minimum(ranges[a], ranges[b]), np.array(turn)) + 3 * noise_m
        if gap <= limit and turn < MAX_STEPS * step:
            labels[labels == labels[b]] = labels[a]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


@given(st.integers(0, 2**32 - 1), st.integers(2, 60), st.sampled_from([1, -1]))
def test_equals_going_through_one_by_one(seed, count, direction):
    """Sensors that turn in either direction, around the whole circle."""
    rng = np.random.default_rng(seed)
    ring, column = rng.integers(0, 3, count), np.sort(rng.integers(0, 72, count))
    azimuth = direction * (np.radians(5) * column - np.pi) + 0.01 * rng.standard_normal(count)
    distance = rng.choice([5.0, 5.2, 9.0], count)
    x, y = distance * np.cos(azimuth), distance * np.sin(azimuth)
    points = np.column_stack([x, y, np.zeros(count)])
    returns = Cloud(points, ring, column, np.arange(count), np.zeros(2))
    labels = cluster_breakpoint(returns, range_noise_m=0.05)
    assert np.array_equal(labels, linked_one_by_one(returns, 0.05))


def test_reach_is_the_spacing_at_the_smallest_incidence():
    """Two beams a step apart on a wall at 10 deg incidence: its hits have exactly that spacing."""
    step = np.radians(0.25)
    first = np.array([20.0, 0.0])
    wall = np.array([np.cos(INCIDENCE_RAD), np.sin(INCIDENCE_RAD)])
    beam = np.array([np.cos(step), np.sin(step)])
    along, _ = np.linalg.solve(np.column_stack([wall, -beam]), -first)
    assert reach(np.array([20.0]), np.array([step]))[0] == pytest.approx(abs(along), rel=1e-9)


def test_two_vehicles_are_two_clusters_and_all_layers_one():
    returns = cloud([(25, 0, 4.6, 1.85, 1.5, 0), (24, 7, 4.6, 1.85, 1.5, 0)], ground=False)
    labels = cluster_breakpoint(returns)
    near = np.abs(returns.points[:, 1]) < 1.5
    assert len(np.unique(labels[near])) == 1
    assert len(np.unique(labels[~near])) == 1
    assert labels.max() == 1


def test_depth_jump_within_a_beam_separates():
    returns = cloud([(25, 0, 4.6, 1.85, 1.5, 0), (45, 2, 4.6, 4, 1.5, 0)], ground=False)
    far = returns.points[:, 0] > 30
    labels = cluster_breakpoint(returns)
    assert not set(labels[far]) & set(labels[~far])


def test_seam_behind_the_sensor_is_no_break():
    azimuths = np.radians(np.arange(-180, 180, 0.5))
    returns = cloud([(-15, 0, 2, 4, 1.5, 0)], ground=False, azimuths=azimuths)
    assert (cluster_breakpoint(returns) == 0).all()
