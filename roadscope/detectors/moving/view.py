"""Range images of scans, freed of the own motion, and what earlier scans saw of a position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import LidarScan, Pose
from roadscope.core.jit import compiled
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# Range images, motion within a sweep, and what earlier scans saw of a place.

OCCUPIED_M = 0.5
"""A return this near in range says that the place was taken: three standard deviations of range
noise on either scan, slanted surfaces, and one second of the odometry's error."""
BEYOND_M = 1.0
"""A return this much farther says that the place was free."""
PASS_M = 0.1
"""Rays that pass this much above or below what is seen of a thing still tell whether it was
there. A guard rail is low and thin: between two beams it is missed, and where a beam meets it
travels along with the sensor, as a vehicle would."""

NOISE_LOOKS, NOISE_ROUNDS = 600, 4
"""Threes of neighbours that tell the range noise, at most so many, and how often those that lie
on an edge are told from the others."""
NOISE_LEAST, NOISE_LEAST_M, NOISE_USUAL_M = 30, 0.005, 0.02
"""Of fewer threes the noise is not told but taken for a usual one; and it is no less than this."""

BODY_M = (0.8, 1.2)
"""Heights at which any vehicle stops a ray."""
BEHIND_M = 5.5
"""What a ray over the bonnet meets this far behind is not the same vehicle."""


class Rays(NamedTuple):
    """What a scan saw, and where its rays went.

    image: (R, C) float32, metres, range by beam and column, nan where nothing came back.
    slopes: (R,) float64, increasing, tangent of each beam's elevation, lidar frame.
    grid: azimuth of column 0 and step, radians, lidar frame.
    column_times_s: (C,) float64, seconds after the stamp.
    twist: (3,) float64, velocity in x and y, m/s, and yaw rate, rad/s, of the ego.
    lidar_from_ego: (4, 4) float64.
    """

    image: np.ndarray
    slopes: np.ndarray
    grid: tuple[float, float]
    column_times_s: np.ndarray
    twist: np.ndarray
    lidar_from_ego: np.ndarray


@compiled()
def tabulate(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return range image, slope by ring, azimuth and time by column; nan where nothing came back.

    points: (N, 3) metres, lidar frame. ring, column: (N,) from 0 up. times_s: (N,) float64,
    seconds after the stamp. Whatever the order of the returns, the result is the same: image
    (R, C) float32, metres; slopes (R,), tangents of elevations; azimuths (C,) radians, lidar
    frame; times (C,) seconds.
    """
    rings, columns = ring.max() + 1, column.max() + 1
    image = np.full((rings, columns), np.float32(np.nan))
    slopes, azimuths = np.full(rings, np.nan), np.full(columns, np.nan)
    starts, lowest = np.full(columns, np.nan), np.full(columns, -1)
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        flat = np.sqrt(x * x + y * y)
        if flat == 0.0:
            continue
        b, c, reach = ring[i], column[i], np.float32(np.sqrt(flat * flat + z * z))
        if not slopes[b] <= z / flat:
            slopes[b] = z / flat
        if not starts[c] <= times_s[i]:
            starts[c] = times_s[i]
        nearer = not image[b, c] <= reach
        if nearer:
            image[b, c] = reach
        # One return a column tells its azimuth; which one must not depend on their order.
        low = lowest[c]
        if low < 0 or b < ring[low] or (b == ring[low] and _before(points, i, low)):
            lowest[c] = i
    for c in range(columns):
        if lowest[c] >= 0:
            azimuths[c] = np.arctan2(
                np.float64(points[lowest[c], 1]), np.float64(points[lowest[c], 0])
            )
    return image, slopes, azimuths, starts


@compiled()
def evenly(columns: np.ndarray, azimuths: np.ndarray) -> tuple[float, float]:
    """Return azimuth of column 0 and the step of evenly spaced columns, radians, lidar frame.

    columns: (K,) int64, rising, K at least 1, some of them. azimuths: (K,) float64, radians,
    where each of those looks. The step is 0 where there is but one.
    """
    if len(columns) < 2:
        return azimuths[0], 0.0
    turns = (azimuths[1:] - azimuths[:-1] + np.pi) % (2 * np.pi) - np.pi
    step = np.median(turns / (columns[1:] - columns[:-1]))
    off = (azimuths - step * columns - azimuths[0] + np.pi) % (2 * np.pi) - np.pi
    return azimuths[0] + np.median(off), step


@compiled()
def range_noise_of(image: np.ndarray) -> float:
    """Return the standard deviation of the range noise, metres, as a range image (R, C) shows it.

    Of three neighbours on a smooth surface the middle one lies half way between the others. Those
    on edges are left out, as lying beyond three standard deviations of the rest.
    """
    bends, count = np.empty(NOISE_LOOKS), 0
    every = 1 + image.size // NOISE_LOOKS
    for k in range(1, image.size - 1, every):
        row, column = k // image.shape[1], k % image.shape[1]
        if 0 < column < image.shape[1] - 1:
            a, b, c = image[row, column - 1], image[row, column], image[row, column + 1]
            bend = abs(np.float64(a) - 2.0 * np.float64(b) + np.float64(c))
            bends[count] = bend
            count += not np.isnan(bend)
    if count < NOISE_LEAST:
        return NOISE_USUAL_M
    bends = np.sort(bends[:count])
    # Of a normal distribution half lies within so many standard deviations, and of the part
    # within three of them the mean square is so much of all of it.
    deviation = bends[count // 4] / 0.3186
    for _ in range(NOISE_ROUNDS):
        near = bends[: max(np.searchsorted(bends, 3.0 * deviation), 1)]
        deviation = np.sqrt((near * near).mean() / 0.9733)
    return float(max(deviation / np.sqrt(6.0), NOISE_LEAST_M))


@compiled()
def imaged(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[float, float], np.ndarray]:
    """Return the image by rising slope and column, slopes, azimuth and step, and column times.

    Arguments as in `tabulate`, with rings and columns from any number up. Columns without a
    return get the time that lies evenly between their neighbours'.
    """
    image, slopes, azimuths, column_times_s = tabulate(
        points, ring - ring.min(), column - column.min(), times_s
    )
    met = np.isfinite(slopes)
    rows = np.argsort(np.where(met, slopes, np.inf), kind="mergesort")[: met.sum()]
    seen = np.flatnonzero(np.isfinite(azimuths))
    every = np.arange(len(azimuths))
    times = np.interp(every, seen, column_times_s[seen])
    return image[rows], slopes[rows], evenly(seen, azimuths[seen]), times


@compiled()
def _before(points: np.ndarray, i: int, k: int) -> bool:
    """Whether row i comes before row k by x, then y, then z."""
    for axis in range(3):
        if points[i, axis] != points[k, axis]:
            return bool(points[i, axis] < points[k, axis])
    return False


@compiled()
def thinned(points: np.ndarray, cell_m: float, slab_m: float) -> np.ndarray:
    """Return rows of one place a voxel of (N, 3) points, the first by x, y, z, sorted by voxel.

    cell_m, slab_m: sides of a voxel in x and y, and in z, the unit of the points.
    """
    keys = _voxels(points, cell_m, slab_m)
    slots = np.full(_room(len(points)), -1)
    for i in range(len(points)):
        slot = _slot(slots, keys, keys[i])
        if slots[slot] < 0 or _before(points, i, slots[slot]):
            slots[slot] = i
    rows = slots[slots >= 0]
    return rows[np.argsort(keys[rows])]


@compiled()
def voxel_of(points: np.ndarray, chosen: np.ndarray, cell_m: float, slab_m: float) -> np.ndarray:
    """Return (N,) int64, for each point, which of the chosen rows has its voxel.

    points: (N, 3). chosen: (V,) int64, what `thinned` returns for them; so are the sides.
    """
    keys = _voxels(points, cell_m, slab_m)
    slots, place = np.full(_room(len(points)), -1), np.empty(len(points), np.int64)
    for k in range(len(chosen)):
        slots[_slot(slots, keys, keys[chosen[k]])] = chosen[k]
        place[chosen[k]] = k
    out = np.empty(len(points), np.int64)
    for i in range(len(points)):
        out[i] = place[slots[_slot(slots, keys, keys[i])]]
    return out


@compiled()
def _voxels(points: np.ndarray, cell_m: float, slab_m: float) -> np.ndarray:
    """Return a number for the voxel of each place."""
    keys = np.empty(len(points), np.int64)
    for i in range(len(points)):
        a, b = np.floor(points[i, 0] / cell_m), np.floor(points[i, 1] / cell_m)
        c = np.floor(points[i, 2] / slab_m)
        keys[i] = ((np.int64(a) + 0x10000) << 32) + ((np.int64(b) + 0x10000) << 12) + np.int64(c)
    return keys


@compiled()
def _room(count: int) -> int:
    """Return a power of two at least twice a count: what a table needs to find things quickly."""
    size = 1
    while size < 2 * count:
        size *= 2
    return size


@compiled()
def _slot(slots: np.ndarray, keys: np.ndarray, key: int) -> int:
    """Return where in a table of rows the row with a key is, or belongs."""
    last = len(slots) - 1
    slot = (key * 0x9E3779B97F4A7C1 >> 20) & last
    while slots[slot] >= 0 and keys[slots[slot]] != key:
        slot = (slot + 1) & last
    return int(slot)


@compiled()
def spans(points: np.ndarray, cell_m: float) -> np.ndarray:
    """Return (N, 2) lowest and highest z among the places (N, 3) in the cells around each.

    points, cell_m: metres, N at least 1. A place's own cell and the eight beside it count.
    """
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    wide = int((points[:, 0].max() - low_x) / cell_m) + 3
    deep = int((points[:, 1].max() - low_y) / cell_m) + 3
    low, high = np.full((wide, deep), np.inf), np.full((wide, deep), -np.inf)
    for i in range(len(points)):
        a, b = int((points[i, 0] - low_x) / cell_m) + 1, int((points[i, 1] - low_y) / cell_m) + 1
        low[a, b] = min(low[a, b], points[i, 2])
        high[a, b] = max(high[a, b], points[i, 2])
    out = np.empty((len(points), 2))
    for i in range(len(points)):
        a, b = int((points[i, 0] - low_x) / cell_m) + 1, int((points[i, 1] - low_y) / cell_m) + 1
        out[i, 0] = low[a - 1 : a + 2, b - 1 : b + 2].min()
        out[i, 1] = high[a - 1 : a + 2, b - 1 : b + 2].max()
    return out


@compiled()
def unskew(points: np.ndarray, times_s: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """Carry (N, 3) points from the ego frame at their own times to the one at the stamp.

    points: metres. times_s: (N,) seconds after the stamp. twist: (3,) velocity in x and y, m/s,
    and yaw rate, rad/s, of the ego.
    """
    out = np.empty_like(points)
    for i in range(len(points)):
        t = times_s[i]
        cos, sin = np.cos(twist[2] * t), np.sin(twist[2] * t)
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = cos * x - sin * y + twist[0] * t
        out[i, 1] = sin * x + cos * y + twist[1] * t
        out[i, 2] = points[i, 2]
    return out


@compiled()
def carried(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return (N, 3) points mapped by a (4, 4) transform, the same bits as `Pose.apply`."""
    out = np.empty((len(points), 3))
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        for k in range(3):
            out[i, k] = x * matrix[k, 0] + y * matrix[k, 1] + z * matrix[k, 2] + matrix[k, 3]
    return out


@compiled()
def sensor_at(lidar_from_ego: np.ndarray, twist: np.ndarray, time_s: float) -> np.ndarray:
    """Return where the sensor was some seconds after the stamp, (2,) metres, ego frame then."""
    m, mount = lidar_from_ego, np.empty((1, 3))
    for k in range(3):
        mount[0, k] = -(m[0, k] * m[0, 3] + m[1, k] * m[1, 3] + m[2, k] * m[2, 3])
    return unskew(mount, np.full(1, time_s), twist)[0, :2]


@compiled()
def look_back(points: np.ndarray, heights: np.ndarray, rays: Rays, counts: np.ndarray) -> None:
    """Count up, in place, which places (N, 3) a scan saw free, and which it saw taken.

    points: metres, the scan's ego frame. heights: (N, 2) metres, from where to where the thing
    at the place is seen to reach. counts: (2, N) int64, free and taken.
    """
    image, slopes = rays.image, rays.slopes
    for i in range(len(points)):
        column, flat, reach, slope = _cast(points[i], rays)
        if column < 0:
            continue
        free_rays, taken, above = 0, False, np.searchsorted(slopes, slope)
        for row in range(max(int(above) - 1, 0), min(int(above) + 1, len(slopes))):
            height = points[i, 2] + (slopes[row] - slope) * flat
            tells = heights[i, 0] - PASS_M < height < heights[i, 1] + PASS_M
            for beside in range(max(column - 1, 0), min(column + 2, image.shape[1])):
                seen = image[row, beside]
                if abs(seen - reach) < OCCUPIED_M:
                    taken = True
                elif tells:
                    # No return is a ray that met nothing within its reach.
                    beyond = np.isnan(seen) or seen > reach + BEYOND_M
                    free_rays += 1 if beyond else -99
        counts[0, i] += 1 if free_rays >= 3 and not taken else 0
        counts[1, i] += 1 if taken else 0


@compiled()
def seen_through(points: np.ndarray, rays: Rays) -> np.ndarray:
    """Return (N,) whether a ray crosses a place at `BODY_M` above the road and goes on.

    points: (N, 3) metres, the scan's ego frame.
    """
    image, slopes = rays.image, rays.slopes
    through = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        column, flat, reach, slope = _cast(points[i], rays)
        if column < 0:
            continue
        for row in range(len(slopes)):
            height = points[i, 2] + (slopes[row] - slope) * flat
            if BODY_M[0] < height < BODY_M[1]:
                seen = image[row, column]
                through[i] |= np.isnan(seen) or seen > reach + BEHIND_M
    return through


@compiled(borrowing=True)
def _cast(point: np.ndarray, rays: Rays) -> tuple[int, float, float, float]:
    """Return column, distance, range and slope of the ray to a place; column -1 if there is none.

    The sensor moves while it turns: where it was depends on the column, which depends on that.
    """
    azimuth, step = rays.grid
    twist, m, time = rays.twist, rays.lidar_from_ego, 0.0
    turn, column, flat, w = 2 * np.pi / abs(step), -1, 0.0, 0.0
    for _ in range(2):
        cos, sin = np.cos(twist[2] * time), np.sin(twist[2] * time)
        dx, dy = point[0] - twist[0] * time, point[1] - twist[1] * time
        x, y, z = cos * dx + sin * dy, cos * dy - sin * dx, point[2]
        u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
        v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
        w = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        flat = np.sqrt(u * u + v * v)
        place = (np.arctan2(v, u) - azimuth) / step
        place -= turn * np.floor((place + 0.5) / turn)
        column = int(np.floor(place + 0.5))
        # Negative where a view has no columns, or one: their step is 0 and no place lies in any.
        if not 0 <= column < len(rays.column_times_s) or flat == 0.0:
            return -1, 0.0, 0.0, 0.0
        time = rays.column_times_s[column]
    return column, flat, np.sqrt(flat * flat + w * w), w / flat


# --------------------------------------------------------------------------------------------------
# One scan as later ones look back at it: a range image, and points freed of the own motion.


@dataclass(frozen=True, slots=True, eq=False)
class View(Record):
    """What a scan saw, and where its rays went.

    points: (N, 3) float64, metres, ego frame at the stamp: each is carried there from its own
        time by the sensor's motion, so what stands still is where it stands.
    times_s: (N,) float64, seconds after the stamp.
    image: (R, C) float32, metres, range of the nearest return by beam and column; nan for none.
    slopes: (R,) float64, increasing, tangent of each beam's elevation.
    azimuth, step: radians of the first column and from column to column, in the lidar frame.
    column_times_s: (C,) float64, seconds after the stamp.
    twist: (3,) float64, velocity in x and y, m/s, and yaw rate, rad/s, of the ego.
    lidar_from_ego: (4, 4) float64.
    """

    points: np.ndarray
    times_s: np.ndarray
    image: np.ndarray
    slopes: np.ndarray
    azimuth: float
    step: float
    column_times_s: np.ndarray
    twist: np.ndarray
    lidar_from_ego: np.ndarray

    @staticmethod
    def of(scan: LidarScan, ego_from_lidar: Pose, twist: np.ndarray) -> View:
        """Take a scan and the own motion during it.

        twist: (3,) velocity in x and y, m/s, and yaw rate, rad/s, of the ego, its own frame.
        """
        times_s = scan.time_offset_s.astype(np.float64)
        points = unskew(carried(scan.points, ego_from_lidar.matrix), times_s, twist)
        lidar_from_ego = inverse_of(ego_from_lidar)
        # A return at the sensor itself has no direction; some drivers put there what never came.
        if not scan.points[:, :2].any():
            image, none = np.empty((0, 0), np.float32), np.empty(0)
            nowhere, never = points[:0], times_s[:0]
            return View(nowhere, never, image, none, 0.0, 0.0, none, twist, lidar_from_ego)
        image, slopes, grid, column_times_s = imaged(scan.points, scan.ring, scan.column, times_s)
        return View(points, times_s, image, slopes, *grid, column_times_s, twist, lidar_from_ego)

    @property
    def rays(self) -> Rays:
        """What kernels ask of a view."""
        return Rays(
            self.image,
            self.slopes,
            (self.azimuth, self.step),
            self.column_times_s,
            self.twist,
            self.lidar_from_ego,
        )

    def origin(self, time_s: float = 0.0) -> np.ndarray:
        """Return where the sensor was some seconds after the stamp.

        (2,) metres, ego frame at the stamp.
        """
        return np.asarray(sensor_at(self.lidar_from_ego, self.twist, time_s))


def inverse_of(pose: Pose) -> np.ndarray:
    """Return the (4, 4) matrix of a pose's inverse."""
    matrix, rotation = np.eye(4), pose.matrix[:3, :3].T
    matrix[:3, :3] = rotation
    matrix[:3, 3] = -rotation @ pose.matrix[:3, 3]
    return matrix
