"""Clusters that no scan angle exceeds: those of two scans cut alike (Zhang 2022, section 2.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.clusters.segments import Segments, centres_of


def parts(segments: Segments, angle_deg: float, before_from_now: np.ndarray) -> Segments:
    """Cut clusters where the angle ends, as seen from the place of the scan before.

    before_from_now: (4, 4), as predicted; the identity for the scan before itself.

    Reading taken: the paper's search angle bounds a cluster, and any return may begin one. So that
    clusters of two scans are of the same pieces of a wall, and their centres stay where they are
    while the sensor moves, the turn is divided into windows of the angle, from straight behind
    on, around one and the same place. A part need not have `min_points`, its cluster has.
    """
    count = int(np.ceil(360.0 / angle_deg - 1e-9))
    labels = _cut(segments.points, segments.whole, before_from_now, count)
    centres, sizes = centres_of(segments.points, labels)
    return replace(segments, labels=labels, centres=centres, sizes=sizes)


@compiled()
def _cut(points: np.ndarray, labels: np.ndarray, motion: np.ndarray, count: int) -> np.ndarray:
    """Return the part of each point, (N,) int64, numbered as they appear; -1 for outliers."""
    clusters = labels.max() + 1 if len(labels) else 0
    numbers, found = np.full(max(clusters, 0) * count, -1), 0
    cut = np.full(len(labels), -1)
    for n in range(len(labels)):
        if labels[n] < 0:
            continue
        x, y = motion[0, 3], motion[1, 3]
        for i in range(3):
            x += motion[0, i] * points[n, i]
            y += motion[1, i] * points[n, i]
        share = np.arctan2(y, x) / (2 * np.pi) + 0.5
        place = labels[n] * count + min(int(share * count), count - 1)
        if numbers[place] < 0:
            numbers[place] = found
            found += 1
        cut[n] = numbers[place]
    return cut
