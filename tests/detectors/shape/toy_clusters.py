"""Clusters of the returns of several beams on an outline, seen from the origin."""

import numpy as np

from roadscope.detectors import Horizon
from roadscope.detectors.shape import Cluster

FREE = Horizon(np.empty(0), np.empty(0), np.radians(0.17), None, np.zeros(2))
"""Nothing stands around."""


def cluster(outline, heights=(0.4, 0.7, 1.0, 1.2, 1.4), noise_m=0.02, seed=0):
    rng = np.random.default_rng(seed)
    outline = outline[np.argsort(np.arctan2(outline[:, 1], outline[:, 0]))]
    count, levels = len(outline), len(heights)
    noisy = np.repeat(outline, levels, axis=0) + noise_m * rng.standard_normal((count * levels, 2))
    points = np.column_stack([noisy, np.tile(heights, count)])
    column, ring = np.repeat(np.arange(count), levels), np.tile(np.arange(levels), count)
    means = noisy.reshape(count, levels, 2).mean(axis=1)
    return Cluster(points, ring, column, means, np.zeros(2))


def rear_and_flank(yaw, centre=(18.0, -4.0), length=4.5, width=1.82):
    """Return the outline of a car ahead: its rear and its left flank."""
    rear = np.column_stack([np.full(20, -length / 2), np.linspace(-width / 2, width / 2, 20)])
    flank = np.column_stack([np.linspace(-length / 2, length / 2, 25), np.full(25, width / 2)])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return np.concatenate([rear, flank[1:]]) @ turn.T + centre
