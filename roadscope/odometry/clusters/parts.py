"""Clusters that no scan angle exceeds: those of two scans cut alike (Zhang 2022, section 2.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.clustering.polar_cells import TURN_ERROR, quick_azimuth
from roadscope.odometry.clusters.segments import Segments

EDGE = 2 * TURN_ERROR
"""Sine of what is too near the edge of a window to be told without its azimuth."""


def parts(segments: Segments, angle_deg: float, before_from_now: np.ndarray) -> Segments:
    """Cut clusters where the angle ends, as seen from the place of the scan before.

    before_from_now: (4, 4), as predicted; the identity for the scan before itself.

    Reading taken: the paper's search angle bounds a cluster, and any return may begin one. So that
    clusters of two scans are of the same pieces of a wall, and their centres stay where they are
    while the sensor moves, the turn is divided into windows of the angle, from straight behind
    on, around one and the same place. A part need not have `min_points`, its cluster has.
    """
    count = int(np.ceil(360.0 / angle_deg - 1e-9))
    labels, sums, sizes = _cut(segments.points, segments.whole, before_from_now, count)
    return replace(segments, labels=labels, centres=sums / sizes[:, None], sizes=sizes)


@compiled()
def _cut(
    points: np.ndarray, whole: np.ndarray, motion: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the part of each point, (N,) int64, numbered as they appear; -1 for outliers.

    And of each part the sum of its points, (K, 3), and how many they are, (K,) int64.
    """
    rooms = (whole.max() + 1) * count if len(whole) else 0
    numbers, found = np.full(rooms, -1), 0
    labels, sums, sizes = np.full(len(whole), -1), np.zeros((rooms, 3)), np.zeros(rooms, np.int64)
    window, first, last = -1, (0.0, 0.0), (0.0, 0.0)
    for n in range(len(whole)):
        if whole[n] < 0:
            continue
        x, y = motion[0, 3], motion[1, 3]
        for i in range(3):
            x += motion[0, i] * points[n, i]
            y += motion[1, i] * points[n, i]
        # Most points are in the window of the one before, which two products tell.
        beside = EDGE * (abs(x) + abs(y))
        if not (first[0] * y - first[1] * x > beside and last[1] * x - last[0] * y > beside):
            window = int((quick_azimuth(x, y) / (2 * np.pi) + 0.5) * count) % count
            first, last = _edge(window, count), _edge(window + 1, count)
        place = whole[n] * count + window
        if numbers[place] < 0:
            numbers[place] = found
            found += 1
        part = numbers[place]
        labels[n] = part
        sizes[part] += 1
        for i in range(3):
            sums[part, i] += points[n, i]
    return labels, sums[:found].copy(), sizes[:found].copy()


@compiled(borrowing=True)
def _edge(window: int, count: int) -> tuple[float, float]:
    """Return the way along which a window begins; nowhere if windows are half a turn or wider."""
    if count <= 2:
        return 0.0, 0.0
    angle = 2 * np.pi * (window / count - 0.5)
    return np.cos(angle), np.sin(angle)
