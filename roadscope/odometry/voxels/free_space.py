"""Where a LiDAR has looked through: what is seen there later has moved in.

After Pomerleau et al., "Long-term 3D map maintenance in dynamic environments" (ICRA 2014), with
range images in place of a map of points. The back of a vehicle that drives on comes to where nobody
looked through, for it was itself in the way: it is as far away as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import Index
from roadscope.odometry.rigid import inverse

BINS = 480
"""Of the azimuth: three quarters of a degree each, wider than the steps of most LiDARs."""
AGES_S = (0.25, 0.8, 2.0)
"""Looks are compared that are at least so old: what is slow moves in later."""
EVERY_S = 0.25
MARGIN_M, MARGIN_SHARE = 0.5, 0.02
"""A beam looked through a place if it met something at least so much farther away."""
BESIDE_RAD = np.deg2rad(0.35)
"""A beam this close in elevation looked there by itself; else those above and below must have."""
UNKNOWN = np.float32(0.0)
CERTAIN = 2
"""Votes from which a point is held to have moved."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One sweep as a range image.

    ranges: (R, 480) least range in each bin, metres; 0 where nothing came back.
    elevations: (R,) radians, ascending. sensor_from_map: (4, 4).
    """

    stamp_s: float
    ranges: np.ndarray
    elevations: np.ndarray
    sensor_from_map: np.ndarray


class FreeSpace:
    """Keeps looks of the last seconds."""

    def __init__(self) -> None:
        self._looks: list[Look] = []

    def due(self, stamp_s: float) -> bool:
        """Say whether the last look kept is so old that it is time for another."""
        return not self._looks or stamp_s - self._looks[-1].stamp_s >= EVERY_S - 1e-3

    def add(self, stamp_s: float, points: np.ndarray, ring: np.ndarray, pose: np.ndarray) -> None:
        """Keep a sweep.

        points: (N, 3) as seen from the sensor at the stamp. pose: (4, 4) `map_from_sensor`.
        """
        ranges, elevations = range_image(points, ring, int(ring.max()) + 1)
        rows = np.flatnonzero(np.isfinite(elevations))
        rows = rows[np.argsort(elevations[rows])]
        look = Look(stamp_s, ranges[rows], elevations[rows], inverse(pose))
        self._looks = [
            each for each in self._looks if stamp_s - each.stamp_s < AGES_S[-1] + 2 * EVERY_S
        ] + [look]

    def entered(self, stamp_s: float, points: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Return (N,) int64, how surely (N, 3) points, map frame, moved here: from 2 on they did.

        seen: (N, 3), the same as the sensor sees them now, or 0 where they cannot be of a vehicle.
        A look that went through the place counts two. One that ended before it, and met something
        in this direction as far away as now, counts one: that has moved along.
        """
        votes = np.zeros(len(points), np.int64)
        for look in self._chosen(stamp_s):
            image = look.ranges, look.elevations, look.sensor_from_map
            looked_through(points, seen, *image, votes)
        return votes

    def _chosen(self, stamp_s: float) -> list[Look]:
        """Return for each age the latest look that is so old."""
        chosen: list[Look] = []
        for age_s in AGES_S:
            old = [each for each in self._looks if stamp_s - each.stamp_s >= age_s - 1e-3]
            if old and all(old[-1] is not each for each in chosen):
                chosen.append(old[-1])
        return chosen


@compiled()
def range_image(points: np.ndarray, ring: np.ndarray, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Return least ranges, (rings, 480) float32, and mean elevations, (rings,); NaN without any."""
    image = np.full((rings, BINS), UNKNOWN, np.float32)
    sums, counts = np.zeros(rings), np.zeros(rings)
    for n in range(len(points)):
        x, y, z = np.float64(points[n, 0]), np.float64(points[n, 1]), np.float64(points[n, 2])
        flat2 = x * x + y * y
        reach = np.sqrt(flat2 + z * z)
        if not 0.0 < reach < np.inf:
            continue
        r = ring[n]
        k = np.int64((np.arctan2(y, x) + np.pi) * (BINS / (2 * np.pi))) % BINS
        if image[r, k] == UNKNOWN or reach < image[r, k]:
            image[r, k] = reach
        sums[r] += z / np.sqrt(flat2) if flat2 > 0.0 else 0.0
        counts[r] += 1.0
    return image, np.arctan(sums / counts)


@compiled()
def looked_through(
    points: np.ndarray,
    seen: np.ndarray,
    ranges: np.ndarray,
    elevations: np.ndarray,
    sensor_from_map: np.ndarray,
    votes: np.ndarray,
) -> None:
    """Add two to the votes of (N, 3) points that have moved in since a look, one to those along."""
    m, rings = sensor_from_map, len(elevations)
    slopes = np.tan(elevations)
    beside = np.tan(BESIDE_RAD)
    for n in range(len(points)):
        a, b, c = points[n]
        x = m[0, 0] * a + m[0, 1] * b + m[0, 2] * c + m[0, 3]
        y = m[1, 0] * a + m[1, 1] * b + m[1, 2] * c + m[1, 3]
        z = m[2, 0] * a + m[2, 1] * b + m[2, 2] * c + m[2, 3]
        flat = np.sqrt(x * x + y * y)
        if flat < 1.0:
            continue
        slope = z / flat
        above = 0
        while above < rings and slopes[above] < slope:
            above += 1
        low, high = above - 1, above
        if high < rings and slopes[high] - slope < beside:
            low = high
        elif low >= 0 and slope - slopes[low] < beside:
            high = low
        if low < 0 or high >= rings:
            continue
        reach = np.sqrt(flat * flat + z * z)
        margin = MARGIN_M + MARGIN_SHARE * reach
        k = np.int64((np.arctan2(y, x) + np.pi) * (BINS / (2 * np.pi))) % BINS
        least, most = reach + margin, reach - margin
        if _clear(ranges[low], k, least) and (low == high or _clear(ranges[high], k, least)):
            votes[n] += CERTAIN
        elif (
            _hidden(ranges[low], k, most)
            and (low == high or _hidden(ranges[high], k, most))
            and _alike(ranges, slopes, seen[n], margin)
        ):
            votes[n] += 1


@compiled()
def _clear(ranges: np.ndarray, k: Index, least: float) -> bool:
    """Say whether a ring's beams around a bin all met something beyond; two of three must have."""
    met = 0
    for d in range(-1, 2):
        reach = ranges[(k + d) % BINS]
        if reach != UNKNOWN:
            if reach < least:
                return False
            met += 1
    return met >= 2


@compiled()
def _hidden(ranges: np.ndarray, k: Index, most: float) -> bool:
    """Say whether a ring's beams around a bin all ended before a range."""
    for d in range(-1, 2):
        reach = ranges[(k + d) % BINS]
        if reach == UNKNOWN or reach > most:
            return False
    return True


@compiled()
def _alike(ranges: np.ndarray, slopes: np.ndarray, seen: np.ndarray, margin: float) -> bool:
    """Say whether a point is as far away as what a look met in the same direction."""
    x, y, z = seen
    flat = np.sqrt(x * x + y * y)
    if flat < 1.0:
        return False
    ring = int(np.argmin(np.abs(slopes - z / flat)))
    k = np.int64((np.arctan2(y, x) + np.pi) * (BINS / (2 * np.pi))) % BINS
    reach = np.sqrt(flat * flat + z * z)
    alike = False
    for d in range(-1, 2):
        alike |= abs(ranges[ring, (k + d) % BINS] - reach) < margin
    return alike
