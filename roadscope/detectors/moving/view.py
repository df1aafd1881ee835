"""Scans of the last second, corrected for the ego's motion, and which places they show free."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from roadscope.core import Frame, LidarScan, Pose
from roadscope.core.jit import compiled
from roadscope.core.record import Record

# --------------------------------------------------------------------------------------------------
# One scan: a range image, and points corrected for the ego's motion.


class PolarImage(NamedTuple):
    """The range image of a scan and the directions of its rays, for kernels.

    ranges: (R, C) float32, metres, by beam and column, nan without a return.
    slopes: (R,) float64, increasing, tangent of each beam's elevation, lidar frame.
    azimuth, step: of column 0 and from column to column, radians, lidar frame.
    column_times_s: (C,) float64, seconds after the stamp.
    twist: (3,) float64, velocity in x and y, m/s, and yaw rate, rad/s, of the ego.
    lidar_from_ego: (4, 4) float64.
    """

    ranges: np.ndarray
    slopes: np.ndarray
    azimuth: float
    step: float
    column_times_s: np.ndarray
    twist: np.ndarray
    lidar_from_ego: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class View(Record):
    """The points of a scan, its range image and the directions of its rays.

    points: (N, 3) float64, metres, ego frame at the stamp, corrected for the sensor's motion during
        the sweep, so that points of static objects are where these stand.
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
        """Return the view of a scan, given the ego's motion during it.

        twist: (3,) velocity in x and y, m/s, and yaw rate, rad/s, of the ego, its own frame.
        """
        times_s = scan.time_offset_s.astype(np.float64)
        points = deskewed(scan.points, ego_from_lidar.matrix, times_s, twist)
        lidar_from_ego = ego_from_lidar.inverse().matrix
        # Some recordings have rays without a return at the sensor, where they have no direction.
        if not scan.points[:, :2].any():
            image, empty = np.empty((0, 0), np.float32), np.empty(0)
            return View(
                points[:0], times_s[:0], image, empty, 0.0, 0.0, empty, twist, lidar_from_ego
            )
        rays = imaged(scan.points, scan.ring, scan.column, times_s)
        return View(points, times_s, *rays, twist, lidar_from_ego)

    @property
    def range_image(self) -> PolarImage:
        """The part of a view that kernels need."""
        return PolarImage(
            self.image,
            self.slopes,
            self.azimuth,
            self.step,
            self.column_times_s,
            self.twist,
            self.lidar_from_ego,
        )

    def origin(self, time_s: float = 0.0) -> np.ndarray:
        """Return the sensor's position `time_s` after the stamp, (2,) metres, ego frame at it."""
        m = self.lidar_from_ego
        x, y = (-(m[0, k] * m[0, 3] + m[1, k] * m[1, 3] + m[2, k] * m[2, 3]) for k in range(2))
        forward, left, turn = self.twist.tolist()
        cos, sin = math.cos(turn * time_s), math.sin(turn * time_s)
        return np.array([cos * x - sin * y + forward * time_s, sin * x + cos * y + left * time_s])


def imaged(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, float, np.ndarray]:
    """Return the fields of a `View` from `image` to `column_times_s`.

    Arguments as in `tabulate`, but rings and columns may begin with any number. The times of
    columns without a return are interpolated.
    """
    image, slopes, azimuths, column_times_s = tabulate(
        points, ring - ring.min(), column - column.min(), times_s
    )
    known = np.isfinite(slopes)
    rows = np.argsort(np.where(known, slopes, np.inf), kind="stable")[: known.sum()]
    columns = np.flatnonzero(np.isfinite(azimuths))
    azimuth, step = evenly(columns, azimuths[columns])
    times = np.interp(np.arange(len(azimuths)), columns, column_times_s[columns])
    return image[rows], slopes[rows], azimuth, step, times


@compiled()
def tabulate(
    points: np.ndarray, ring: np.ndarray, column: np.ndarray, times_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return range image, slope by ring, azimuth and time by column; nan without a return.

    points: (N, 3) metres, lidar frame. ring, column: (N,) from 0 up. times_s: (N,) float64,
    seconds after the stamp. Returns the image (R, C) float32, metres; slopes (R,), tangents of
    elevations; azimuths (C,) radians, lidar frame; times (C,) seconds. They do not depend on the
    order of the returns.
    """
    rings, columns = ring.max() + 1, column.max() + 1
    image = np.full((rings, columns), np.float32(np.nan))
    slopes, azimuths = np.full(rings, np.nan), np.full(columns, np.nan)
    column_times_s, lowest = np.full(columns, np.nan), np.full(columns, -1)
    for i in range(len(points)):
        x, y, z = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        flat = np.sqrt(x * x + y * y)
        if flat == 0.0:
            continue
        b, c, reach = ring[i], column[i], np.float32(np.sqrt(flat * flat + z * z))
        if not slopes[b] <= z / flat:
            slopes[b] = z / flat
        if not column_times_s[c] <= times_s[i]:
            column_times_s[c] = times_s[i]
        if not image[b, c] <= reach:
            image[b, c] = reach
        # The return of the lowest beam gives a column's azimuth, whatever the order of returns.
        low = lowest[c]
        if low < 0 or b < ring[low] or (b == ring[low] and _is_before(points, i, low)):
            lowest[c] = i
    for c in range(columns):
        if lowest[c] >= 0:
            azimuths[c] = np.arctan2(
                np.float64(points[lowest[c], 1]), np.float64(points[lowest[c], 0])
            )
    return image, slopes, azimuths, column_times_s


@compiled()
def _is_before(points: np.ndarray, i: int, k: int) -> bool:
    """Return whether row i comes before row k by x, then y, then z."""
    for axis in range(3):
        if points[i, axis] != points[k, axis]:
            return bool(points[i, axis] < points[k, axis])
    return False


def evenly(columns: np.ndarray, azimuths: np.ndarray) -> tuple[float, float]:
    """Return azimuth of column 0 and the step of evenly spaced columns, radians, lidar frame.

    columns: (K,) int64, rising, K at least 1: the columns with a return. azimuths: (K,) float64,
    radians, of these columns. With a single column the step is 0.
    """
    first = float(azimuths[0])
    if len(columns) < 2:
        return first, 0.0
    turns = (azimuths[1:] - azimuths[:-1] + np.pi) % (2 * np.pi) - np.pi
    step = float(np.median(turns / (columns[1:] - columns[:-1])))
    off = (azimuths - step * columns - first + np.pi) % (2 * np.pi) - np.pi
    return first + float(np.median(off)), step


NOISE_SAMPLES, NOISE_ROUNDS = 600, 4
"""The range noise is estimated from at most so many triples of neighbours; triples on edges are
removed in so many rounds."""
NOISE_LEAST, NOISE_LEAST_M, NOISE_USUAL_M = 30, 0.005, 0.02
"""With fewer triples than `NOISE_LEAST` the noise is assumed to be `NOISE_USUAL_M`; an estimate is
at least `NOISE_LEAST_M`."""


@compiled()
def range_noise_of(image: np.ndarray) -> float:
    """Return the standard deviation of the range noise, metres, from a range image (R, C).

    Of three neighbours on a smooth surface the middle one lies half way between the others. Triples
    on edges are left out: they lie beyond three standard deviations of the rest.
    """
    bends, count = np.empty(NOISE_SAMPLES), 0
    every = 1 + image.size // NOISE_SAMPLES
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
    # A quarter of a normal distribution lies within 0.3186 standard deviations of its mean. Of the
    # part within three of them the mean square is 0.9733 of the variance.
    deviation = bends[count // 4] / 0.3186
    for _ in range(NOISE_ROUNDS):
        near = bends[: max(np.searchsorted(bends, 3.0 * deviation), 1)]
        deviation = np.sqrt((near * near).mean() / 0.9733)
    return float(max(deviation / np.sqrt(6.0), NOISE_LEAST_M))


@compiled()
def deskewed(
    points: np.ndarray, ego_from_lidar: np.ndarray, times_s: np.ndarray, twist: np.ndarray
) -> np.ndarray:
    """Return (N, 3) points of the lidar frame in the ego frame at the stamp.

    points: metres. ego_from_lidar: (4, 4). times_s: (N,) seconds after the stamp at which each was
    measured. twist: (3,) velocity in x and y, m/s, and yaw rate, rad/s, of the ego.
    """
    m, out = ego_from_lidar, np.empty((len(points), 3))
    for i in range(len(points)):
        u, v, w = np.float64(points[i, 0]), np.float64(points[i, 1]), np.float64(points[i, 2])
        x = u * m[0, 0] + v * m[0, 1] + w * m[0, 2] + m[0, 3]
        y = u * m[1, 0] + v * m[1, 1] + w * m[1, 2] + m[1, 3]
        t = times_s[i]
        cos, sin = np.cos(twist[2] * t), np.sin(twist[2] * t)
        out[i, 0] = cos * x - sin * y + twist[0] * t
        out[i, 1] = sin * x + cos * y + twist[1] * t
        out[i, 2] = u * m[2, 0] + v * m[2, 1] + w * m[2, 2] + m[2, 3]
    return out


def carried(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Return (N, 3) points mapped by a (4, 4) transform, the same bits as `Pose.apply`."""
    x, y, z = points.T
    return np.stack([x * a + y * b + z * c + d for a, b, c, d in matrix[:3]], axis=1)


# --------------------------------------------------------------------------------------------------
# Whether scans show places free or occupied.

OCCUPIED_M = 0.5
"""If the range of a return differs from that of a place by less than this, the place was occupied.
It allows for three standard deviations of range noise in both scans, for slanted surfaces, and for
one second of odometry error."""
BEYOND_M = 1.0
"""If the range of a return is this much greater, the place was free. Chosen by hand."""
PASS_M = 0.1
"""Rays that pass at most this much above or below the visible part of an object show whether it was
there. More would be wrong for a guard rail, which is low and thin: rays between two beams miss it,
and the place where a beam hits it moves along with the sensor, as a vehicle would."""
BODY_LOW_M, BODY_HIGH_M = 0.8, 1.2
"""Heights above the road at which any vehicle stops a ray. Chosen by hand."""
BEHIND_M = 5.5
"""A return this far behind a place is not of the same vehicle, even if the ray passed over its
bonnet. Chosen by hand."""


@compiled()
def thinned(points: np.ndarray, cell_m: float, slab_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return one row for each voxel of (N, 3) points, (V,), and the voxel of each point, (N,).

    The row is that of the voxel's first point by x, y, z. Voxels are sorted by x, y, z too.
    points, cell_m, slab_m: metres; a voxel has the side cell_m in x and y, and slab_m in z.
    """
    size = 1
    while size < 2 * len(points):
        size *= 2
    # A table of rows, twice as large as needed so that the row of a voxel is found quickly.
    table, keys = np.full(size, -1), np.empty(len(points), np.int64)
    slots = np.empty(len(points), np.int64)
    for i in range(len(points)):
        a, b = np.floor(points[i, 0] / cell_m), np.floor(points[i, 1] / cell_m)
        c = np.floor(points[i, 2] / slab_m)
        key = ((np.int64(a) + 0x10000) << 32) + ((np.int64(b) + 0x10000) << 12) + np.int64(c)
        slot = (key * 0x9E3779B97F4A7C1 >> 20) & (size - 1)
        while table[slot] >= 0 and keys[table[slot]] != key:
            slot = (slot + 1) & (size - 1)
        keys[i], slots[i] = key, slot
        if table[slot] < 0 or _is_before(points, i, table[slot]):
            table[slot] = i
    rows = table[table >= 0]
    rows = rows[np.argsort(keys[rows])]
    for k in range(len(rows)):
        table[slots[rows[k]]] = k
    return rows, table[slots]


@compiled()
def height_spans(points: np.ndarray, cell_m: float) -> np.ndarray:
    """Return for each of (N, 3) points the lowest and highest z of the points around it, (N, 2).

    points, cell_m: metres, N at least 1. A point's own cell and the eight beside it count.
    """
    low_x, low_y = points[:, 0].min(), points[:, 1].min()
    # One more cell on each side, so that every point has eight cells beside its own.
    nx = int((points[:, 0].max() - low_x) / cell_m) + 3
    ny = int((points[:, 1].max() - low_y) / cell_m) + 3
    low, high = np.full((nx, ny), np.inf), np.full((nx, ny), -np.inf)
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
def count_free_and_occupied(
    points: np.ndarray, heights: np.ndarray, image: PolarImage, counts: np.ndarray
) -> None:
    """Count, in place, for each of (N, 3) places whether a scan shows it free or occupied.

    points: metres, the scan's ego frame. heights: (N, 2) metres, lowest and highest return of the
    object at the place. counts: (2, N) int64, how many scans showed it free, and occupied.
    """
    ranges, slopes = image.ranges, image.slopes
    for i in range(len(points)):
        column, flat, reach, slope = _ray_to(points[i], image)
        if column < 0:
            continue
        free_rays, occupied, above = 0, False, np.searchsorted(slopes, slope)
        for row in range(max(int(above) - 1, 0), min(int(above) + 1, len(slopes))):
            height = points[i, 2] + (slopes[row] - slope) * flat
            relevant = heights[i, 0] - PASS_M < height < heights[i, 1] + PASS_M
            for beside in range(max(column - 1, 0), min(column + 2, ranges.shape[1])):
                measured = ranges[row, beside]
                if abs(measured - reach) < OCCUPIED_M:
                    occupied = True
                elif relevant:
                    # Without a return the ray hit nothing within its reach. If a nearer return may
                    # hide the place, it does not count as free.
                    beyond = np.isnan(measured) or measured > reach + BEYOND_M
                    free_rays += 1 if beyond else -99
        counts[0, i] += 1 if free_rays >= 3 and not occupied else 0
        counts[1, i] += 1 if occupied else 0


@compiled()
def is_seen_through(points: np.ndarray, image: PolarImage) -> np.ndarray:
    """Return (N,) whether a ray passes a place at the height of a body and hits nothing there.

    points: (N, 3) metres, the scan's ego frame. No vehicle stands at such a place.
    """
    ranges, slopes = image.ranges, image.slopes
    through = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        column, flat, reach, slope = _ray_to(points[i], image)
        if column < 0:
            continue
        for row in range(len(slopes)):
            height = points[i, 2] + (slopes[row] - slope) * flat
            if BODY_LOW_M < height < BODY_HIGH_M:
                measured = ranges[row, column]
                through[i] |= np.isnan(measured) or measured > reach + BEHIND_M
    return through


@compiled(borrowing=True)
def _ray_to(point: np.ndarray, image: PolarImage) -> tuple[int, float, float, float]:
    """Return column, distance, range and slope of the ray to a place; column -1 if there is none.

    The sensor moves while it turns: its position depends on the column, and the column on its
    position. So the column is computed twice.
    """
    twist, m, time = image.twist, image.lidar_from_ego, 0.0
    turn, column, flat, w = 2 * np.pi / abs(image.step), -1, 0.0, 0.0
    for _ in range(2):
        cos, sin = np.cos(twist[2] * time), np.sin(twist[2] * time)
        dx, dy = point[0] - twist[0] * time, point[1] - twist[1] * time
        x, y, z = cos * dx + sin * dy, cos * dy - sin * dx, point[2]
        u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
        v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
        w = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        flat = np.sqrt(u * u + v * v)
        place = (np.arctan2(v, u) - image.azimuth) / image.step
        place -= turn * np.floor((place + 0.5) / turn)
        column = int(np.floor(place + 0.5))
        # A view with no column or a single one has a step of 0: no place lies in any column.
        if not 0 <= column < len(image.column_times_s) or flat == 0.0:
            return -1, 0.0, 0.0, 0.0
        time = image.column_times_s[column]
    return column, flat, np.sqrt(flat * flat + w * w), w / flat


# --------------------------------------------------------------------------------------------------
# The scans of the last second, each with the transform from the ego frame now to that of its stamp.

AGES_S = (0.1, 0.2, 0.3, 0.5, 0.7, 1.0)
"""Ages of the earlier scans that are used: a slow car leaves its place late, a fast one is soon far
away. Chosen by hand."""
SLACK_S = 0.05
"""Greatest difference of a scan's age from one of `AGES_S`."""


@dataclass(frozen=True, slots=True, eq=False)
class EarlierView:
    """An earlier scan, its stamp, and the transform from the ego frame now into its own.

    then_from_now: (4, 4) float64.
    """

    view: View
    stamp_s: float
    then_from_now: np.ndarray


class Memory:
    """Stores the scans of the last second, and the estimated pose of the ego at each.

    In a frame without an estimate of the ego's motion the sensor is taken to have stood still since
    the last frame, as a sensor by the road does. On a moving sensor without odometry the roadside
    then appears to move. The first frame of a drive has no estimate either: its scan is corrected
    again when the motion to the second frame is known.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all scans; the drive's coordinate frame begins at the next ego pose."""
        self.now: View | None = None
        self.stamp_s = float("nan")
        self.drive_from_ego = Pose.identity()
        self._earlier: list[tuple[float, View, Pose]] = []
        self._first: tuple[LidarScan, Pose] | None = None

    def add(self, frame: Frame) -> None:
        """Take the next frame; its scan becomes `now`, None if it has none."""
        if frame.stamp_s <= self.stamp_s:
            self.reset()
        motion = frame.previous_from_ego
        twist = _twist(motion, frame.stamp_s - self.stamp_s)
        self._store(twist)
        self.stamp_s, self.now = frame.stamp_s, None
        if motion is not None:
            self.drive_from_ego = self.drive_from_ego @ motion
        if frame.lidar is not None:
            mount = frame.calibration.pose(frame.lidar.sensor)
            self.now = View.of(frame.lidar, mount, twist)
            self._first = (frame.lidar, mount) if motion is None and not self._earlier else None

    def earlier_views(self) -> list[EarlierView]:
        """Return the earlier scans nearest to `AGES_S`, the youngest first."""
        ages_s = np.array([self.stamp_s - stamp_s for stamp_s, _, _ in self._earlier])
        if not len(ages_s):
            return []
        nearest = [int(np.abs(ages_s - age_s).argmin()) for age_s in AGES_S]
        rows = [r for r, a in zip(nearest, AGES_S, strict=True) if abs(ages_s[r] - a) < SLACK_S]
        if not rows:
            return []
        earlier = [self._earlier[row] for row in dict.fromkeys(rows)]
        drive_from_then = [pose.matrix for _, _, pose in earlier]
        transforms = np.linalg.inv(drive_from_then) @ self.drive_from_ego.matrix
        return [
            EarlierView(view, stamp_s, then_from_now)
            for (stamp_s, view, _), then_from_now in zip(earlier, transforms, strict=True)
        ]

    def _store(self, twist: np.ndarray) -> None:
        """Add the last scan to the earlier ones, and drop those that are too old."""
        if self.now is None:
            return
        now = self.now if self._first is None else View.of(*self._first, twist)
        self._earlier.insert(0, (self.stamp_s, now, self.drive_from_ego))
        oldest_s = self.stamp_s - AGES_S[-1] - SLACK_S
        self._earlier = [earlier for earlier in self._earlier if earlier[0] >= oldest_s]


def _twist(previous_from_now: Pose | None, elapsed_s: float) -> np.ndarray:
    """Return velocity and yaw rate, (3,), of a motion at constant rates."""
    if previous_from_now is None or not elapsed_s > 0:
        return np.zeros(3)
    turn = previous_from_now.yaw
    x, y = previous_from_now.translation[:2]
    cos, sin = np.cos(turn / 2), np.sin(turn / 2)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn]) / elapsed_s
