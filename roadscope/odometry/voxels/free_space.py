"""Free space: points where earlier beams passed through have moved there.

After Pomerleau et al., "Long-term 3D map maintenance in dynamic environments" (ICRA 2014), with
range images in place of a map of points. The rear of a vehicle ahead of the sensor moves to places
that no beam passed, because the vehicle hid them: it stays at the same range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from roadscope.core.jit import compiled
from roadscope.odometry.cubes import Index
from roadscope.odometry.rigid import inverse

BINS = 480
"""Azimuth bins of 0.75 degrees, wider than the steps of most LiDARs."""
AGES_S = (0.25, 0.8, 2.0)
"""Least ages of the compared images; slow objects need older ones."""
EVERY_S = 0.25
"""Time between two stored images."""
MARGIN_M, MARGIN_SHARE = 0.5, 0.02
"""A beam passed through a place if its return is farther by this distance and share of range."""
BESIDE_RAD = np.deg2rad(0.35)
"""A single beam this close in elevation is sufficient; else both neighbours must have passed."""
UNKNOWN = np.float32(0.0)
"""Range of a bin without a return."""
CERTAIN = 2
"""Votes from which a point counts as moved."""


@dataclass(frozen=True, slots=True, eq=False)
class SweepImage:
    """One sweep as a range image.

    ranges: (R, 480) least range in each bin, metres; 0 without a return.
    elevations: (R,) radians, ascending. sensor_from_map: (4, 4).
    """

    stamp_s: float
    ranges: np.ndarray
    elevations: np.ndarray
    sensor_from_map: np.ndarray


class FreeSpace:
    """Stores range images of the last seconds."""

    def __init__(self) -> None:
        self._images: list[SweepImage] = []

    def due(self, stamp_s: float) -> bool:
        """Return whether it is time to store another image."""
        return not self._images or stamp_s - self._images[-1].stamp_s >= EVERY_S - 1e-3

    def add(self, stamp_s: float, points: np.ndarray, ring: np.ndarray, pose: np.ndarray) -> None:
        """Store the range image of a sweep.

        points: (N, 3) in the sensor's frame at the stamp. pose: (4, 4) `map_from_sensor`.
        """
        ranges, elevations = range_image(points, ring, int(ring.max()) + 1)
        rows = np.flatnonzero(np.isfinite(elevations))
        rows = rows[np.argsort(elevations[rows])]
        image = SweepImage(stamp_s, ranges[rows], elevations[rows], inverse(pose))
        self._images = [
            each for each in self._images if stamp_s - each.stamp_s < AGES_S[-1] + 2 * EVERY_S
        ] + [image]

    def entered(
        self, stamp_s: float, points: np.ndarray, in_sensor_frame: np.ndarray
    ) -> np.ndarray:
        """Return (N,) int64, votes that (N, 3) points, map frame, moved here; `CERTAIN` are enough.

        in_sensor_frame: (N, 3), the same points in the sensor's frame now, or 0 where they
            cannot belong to a vehicle.

        An image whose beams passed through the place gives two votes. An image whose beams ended
        before it gives one vote if it has, in the direction in which the sensor has the point now,
        a return at the same range: such a point may have moved along with the sensor.
        """
        votes = np.zeros(len(points), np.int64)
        for image in self._chosen(stamp_s):
            vote_for_entered(
                points,
                in_sensor_frame,
                image.ranges,
                image.elevations,
                image.sensor_from_map,
                votes,
            )
        return votes

    def _chosen(self, stamp_s: float) -> list[SweepImage]:
        """Return for each age the latest image that is that old."""
        chosen: list[SweepImage] = []
        for age_s in AGES_S:
            old = [each for each in self._images if stamp_s - each.stamp_s >= age_s - 1e-3]
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
def vote_for_entered(
    points: np.ndarray,
    in_sensor_frame: np.ndarray,
    ranges: np.ndarray,
    elevations: np.ndarray,
    sensor_from_map: np.ndarray,
    votes: np.ndarray,
) -> None:
    """Add the votes of one image to (N, 3) points, map frame; see `FreeSpace.entered`."""
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
            and _same_range(ranges, slopes, in_sensor_frame[n], margin)
        ):
            votes[n] += 1


@compiled()
def _clear(ranges: np.ndarray, k: Index, least: float) -> bool:
    """Return whether a ring's returns around a bin are beyond a range, at least two of three."""
    farther = 0
    for d in range(-1, 2):
        reach = ranges[(k + d) % BINS]
        if reach != UNKNOWN:
            if reach < least:
                return False
            farther += 1
    return farther >= 2


@compiled()
def _hidden(ranges: np.ndarray, k: Index, most: float) -> bool:
    """Return whether all beams of a ring around a bin ended before a range."""
    for d in range(-1, 2):
        reach = ranges[(k + d) % BINS]
        if reach == UNKNOWN or reach > most:
            return False
    return True


@compiled()
def _same_range(ranges: np.ndarray, slopes: np.ndarray, point: np.ndarray, margin: float) -> bool:
    """Return whether an image has a return at the range of a point, in its direction."""
    x, y, z = point
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
