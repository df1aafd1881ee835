"""The nearest point on a ring, found from its azimuth."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled

NONE = -1
HAIR = 1e-12
"""Added to angles within which something may be nearer, radians, for rounding."""


class RingTable(NamedTuple):
    """Points ring by ring, by azimuth within a ring.

    points: (N, 3) metres. azimuths: (N,) rad. labels: (N,). starts: (R + 1,) where rings start.
    lows, highs: (R,) least and greatest elevation of a ring, rad.
    """

    points: np.ndarray
    azimuths: np.ndarray
    labels: np.ndarray
    starts: np.ndarray
    lows: np.ndarray
    highs: np.ndarray


def ring_table(points: np.ndarray, rings: np.ndarray, labels: np.ndarray) -> RingTable:
    """Return (N, 3) points with (N,) ring and label as a table."""
    azimuths = np.arctan2(points[:, 1], points[:, 0])
    order = np.lexsort((azimuths, rings))
    points, azimuths = np.ascontiguousarray(points[order]), azimuths[order]
    count = int(rings.max(initial=-1)) + 1
    starts = np.concatenate([[0], np.cumsum(np.bincount(rings, minlength=count))])
    elevations = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    lows, highs = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(lows, rings[order], elevations)
    np.maximum.at(highs, rings[order], elevations)
    return RingTable(points, azimuths, labels[order], starts, lows, highs)


@compiled()
def nearest(
    table: RingTable, place: np.ndarray, label: int, rings: tuple[int, int, int], most: float
) -> tuple[int, int]:
    """Return index and ring of the nearest point; -1 if none is nearer than `most`, squared.

    label: the point's; negative for any. rings: search from the first outwards, so far at most
        and no nearer to it than the last.
    """
    home, farthest, least = rings
    flat2 = place[0] * place[0] + place[1] * place[1]
    reach2 = flat2 + place[2] * place[2]
    elevation, azimuth = np.arctan2(place[2], np.sqrt(flat2)), np.arctan2(place[1], place[0])
    steepest = _angle_within(most, reach2)
    count, found, where = len(table.lows), NONE, NONE
    for step in range(least, farthest + 1):
        for way in (-1, 1):
            ring = home + way * step
            if ring < 0 or ring >= count or (step == 0 and way == 1):
                continue
            if max(table.lows[ring] - elevation, elevation - table.highs[ring]) > steepest:
                continue
            index, nearer = nearest_on(table, ring, (place, azimuth), label, (most, NONE))
            if index != NONE:
                found, where, most = index, ring, nearer
                steepest = _angle_within(most, reach2)
    return found, where


@compiled()
def nearest_on(
    table: RingTable, ring: int, target: tuple[np.ndarray, float], label: int,
    bound: tuple[float, int],
) -> tuple[int, float]:  # fmt: skip
    """Return index and squared distance of the nearest point of a ring.

    target: (3,) metres, and its azimuth. bound: squared distance it must be under, and an index
    that is passed over.
    """
    (place, azimuth), (most, skip) = target, bound
    first, last = table.starts[ring], table.starts[ring + 1]
    flat2 = place[0] * place[0] + place[1] * place[1]
    middle = first + np.searchsorted(table.azimuths[first:last], azimuth)
    found, widest = NONE, _angle_within(most, flat2)
    for way in (-1, 1):
        k = middle if way == 1 else middle - 1
        for _ in range(last - first):
            k = last - 1 if k < first else (first if k >= last else k)
            turn = way * (table.azimuths[k] - azimuth)
            turn += 2 * np.pi if turn < 0 else 0.0
            if turn > np.pi or turn > widest:
                break
            if k != skip and (label < 0 or table.labels[k] == label):
                dx = table.points[k, 0] - place[0]
                dy = table.points[k, 1] - place[1]
                dz = table.points[k, 2] - place[2]
                squared = dx * dx + dy * dy + dz * dz
                if squared < most:
                    found, most = k, squared
                    widest = _angle_within(most, flat2)
            k += way
    return found, most


@compiled()
def _angle_within(most: float, square: float) -> float:
    """Return how far beside a place, rad, a beam may pass that is nearer to it than a distance.

    most: that distance, squared. square: the place's own from the sensor, squared.
    """
    if most >= square:
        return np.inf
    return float(np.arcsin(np.sqrt(most / square)) + HAIR)
