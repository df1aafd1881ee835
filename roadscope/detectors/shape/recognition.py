"""Vehicles from straight lines of an outline.

The lines come from an iterative end point fit, IEPF (Lu 2018, section 2.2). The rules by which they
become the faces of a vehicle and give its position are ours; their constants are chosen by hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from roadscope.core import Category
from roadscope.core.jit import compiled
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.cluster import Cluster, diagonal

# --------------------------------------------------------------------------------------------------
# Straight pieces of an outline.


@dataclass(frozen=True, eq=False)
class Segment:
    """Consecutive outline points that one line represents.

    points: (M, 2) float64, metres, in order along the outline.
    """

    points: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def _centred(self) -> np.ndarray:
        return np.asarray(self.points - self.points.sum(axis=0) / len(self.points))

    @cached_property
    def direction(self) -> np.ndarray:
        """(2,) unit vector of the total least squares line, from first to last point."""
        (xx, xy), (_, yy) = self._centred.T @ self._centred
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)
        axis = np.array([np.cos(angle), np.sin(angle)])
        return -axis if axis @ (self.points[-1] - self.points[0]) < 0 else axis

    @cached_property
    def length(self) -> float:
        """Extent of the points along the line in metres."""
        along = self._centred @ self.direction
        return float(along.max() - along.min())

    @cached_property
    def residuals(self) -> np.ndarray:
        """(M,) signed distances of the points from the line in metres."""
        x, y = self.direction
        return np.asarray(self._centred @ np.array([-y, x]))

    @property
    def residual_m(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


# --------------------------------------------------------------------------------------------------
# Where an outline is split into straight pieces, and which pieces make a face.


class Faces(NamedTuple):
    """When pieces of an outline can be the faces of one body.

    gap_m: neighbouring points farther apart than this lie on two bodies. join_m: pieces are one
    face if the root mean square distance of their points from one line is at most this. least_m:
    least diagonal of a body's outline. points: least number of points; those that two pieces share
    count twice. lines: greatest number of lines.
    """

    gap_m: float
    join_m: float
    least_m: float
    points: int
    lines: int


@compiled()
def split_ends(points: np.ndarray, split_m: float) -> np.ndarray:
    """Return the (S, 2) int64 first and last point of each piece of points (N, 2) (eq. 3 and 4).

    A piece is split at the point farthest from its chord, if that is farther than `split_m`; both
    parts share the point. If the ends of the chord are equal, the distance from them counts.
    """
    ends, pending = np.empty((len(points), 2), np.int64), np.empty((len(points), 2), np.int64)
    count, left = 0, 0
    if len(points):
        pending[0, 0], pending[0, 1], left = 0, len(points) - 1, 1
    while left:
        left -= 1
        first, last = pending[left]
        x, y = points[first, 0], points[first, 1]
        dx, dy = points[last, 0] - x, points[last, 1] - y
        length, at, farthest = np.hypot(dx, dy), -1, -1.0
        for i in range(first + 1, last):
            u, v = points[i, 0] - x, points[i, 1] - y
            distance = abs(dx * v - dy * u) / length if length > 0.0 else np.hypot(u, v)
            if distance > farthest:
                at, farthest = i, distance
        if at < 0 or farthest <= split_m:
            ends[count, 0], ends[count, 1] = first, last
            count += 1
            continue
        pending[left, 0], pending[left, 1] = at, last
        pending[left + 1, 0], pending[left + 1, 1] = first, at
        left += 2
    return ends[:count]


@compiled()
def face_ends(points: np.ndarray, ends: np.ndarray, rule: Faces) -> np.ndarray:
    """Return (K, 3) int64: body, first and last point of the lines of each possible body.

    points: (N, 2) metres, of an outline. ends: (S, 2) of its pieces, as from `split_ends`. The
    outline is cut where it jumps. Then neighbouring pieces on one line are joined: they were split
    only because of noise at the end of a chord.
    """
    pieces = _cut(points, ends, rule.gap_m)
    out, count, first = np.empty((len(pieces), 3), np.int64), 0, 0
    while first < len(pieces):
        end = first + 1
        while end < len(pieces) and pieces[end, 0] == pieces[first, 0]:
            end += 1
        if diagonal(points[pieces[first, 1] : pieces[end - 1, 2] + 1]) >= rule.least_m:
            out[count] = pieces[first]
            last = count
            for k in range(first + 1, end):
                if _off_line(points, out[last, 1], pieces[k, 2]) <= rule.join_m:
                    out[last, 2] = pieces[k, 2]
                else:
                    last += 1
                    out[last] = pieces[k]
            lines, total = 0, 0
            for k in range(count, last + 1):
                lines += out[k, 2] > out[k, 1]
                total += out[k, 2] - out[k, 1] + 1
            if 1 <= lines <= rule.lines and total >= rule.points:
                count = last + 1
        first = end
    return out[:count]


@compiled()
def _cut(points: np.ndarray, ends: np.ndarray, gap_m: float) -> np.ndarray:
    """Return (K, 3) chain, first and last point of pieces; a new chain begins at each jump."""
    out = np.empty((len(ends) + len(points), 3), np.int64)
    count, chain = 0, 0
    for s in range(len(ends)):
        first, last = ends[s]
        for i in range(first, last):
            if np.hypot(points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]) > gap_m:
                out[count, 0], out[count, 1], out[count, 2] = chain, first, i
                count, chain, first = count + 1, chain + 1, i + 1
        out[count, 0], out[count, 1], out[count, 2] = chain, first, last
        count += 1
    return out[:count]


@compiled()
def _off_line(points: np.ndarray, first: int, last: int) -> float:
    """Return the root mean square distance of consecutive points from their line, metres."""
    count, x, y = last + 1 - first, 0.0, 0.0
    for i in range(first, last + 1):
        x, y = x + points[i, 0], y + points[i, 1]
    x, y = x / count, y / count
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(first, last + 1):
        dx, dy = points[i, 0] - x, points[i, 1] - y
        xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    cos, sin, total = math.cos(angle), math.sin(angle), 0.0
    for i in range(first, last + 1):
        off = cos * (points[i, 1] - y) - sin * (points[i, 0] - x)
        total += off * off
    return math.sqrt(total / count)


# --------------------------------------------------------------------------------------------------
# Which outlines are vehicles, and the pose and size of each vehicle.

GAP_M = 1.2
"""Neighbouring outline points farther apart lie on two bodies."""
MIN_POINTS = 3
"""Least number of outline points of a vehicle."""
MAX_SEGMENTS = 3
"""Most segments of a vehicle: two faces and the rounded corner between them."""
JOIN_M = 0.15
"""Neighbouring segments are one face when all their points lie this near to one line (root mean
square): range noise, and the rounded corners that end a face."""
CORNER_M = 0.8
"""A piece shorter than this may be a rounded corner, which may have any angle."""
SQUARE_RAD = np.radians(25.0)
"""Greatest departure of two faces from parallel or perpendicular."""
LENGTH_MIN_M, WIDTH_MAX_M, LENGTH_MAX_M = 1.2, 2.8, 18.0
"""Least length of the longer side of a wholly visible body, greatest width of a vehicle, with
mirrors and noise, and greatest length, that of a lorry."""
HALF_FACE_M = 0.92
"""Least visible length of a body of which a part may be hidden: half the width of a typical car."""
FACES = Faces(GAP_M, JOIN_M, HALF_FACE_M, MIN_POINTS, MAX_SEGMENTS)
SIZES = (
    (Category.CAR, 5.3, 2.2, (4.6, 1.85, 1.5)),
    (Category.VAN, 7.5, 2.3, (5.9, 2.05, 2.4)),
    (Category.TRUCK, LENGTH_MAX_M, WIDTH_MAX_M, (10.0, 2.5, 3.4)),
)
"""Category, greatest length, greatest width and typical size in metres, in order of size."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A recognised vehicle.

    centre: x, y in metres, ego frame; size: length, width, height in metres; yaw: radians.
    residual_m: root mean square distance of the outline from its lines.
    points: number of the outline points from which it is recognised.
    fit: log likelihood of the visible extents under the prior of sizes, 0 where it is not computed.
    """

    centre: tuple[float, float]
    size: tuple[float, float, float]
    yaw: float
    category: Category
    residual_m: float
    points: int
    fit: float = 0.0


def vehicles_by_lines(cluster: Cluster, horizon: Horizon, *, split_m: float = 0.3) -> list[Vehicle]:
    """Return the vehicles whose faces are the lines of a cluster's outline (Lu 2018, 2.2)."""
    outline = cluster.outline
    # Parts of it are no larger. Most clusters, such as drops of fog, are rejected here.
    if len(outline) < MIN_POINTS or diagonal(outline) < HALF_FACE_M:
        return []
    return recognise(outline, split_ends(outline, split_m), horizon)


def fit_iepf(points: np.ndarray, *, split_m: float = 0.3) -> list[Segment]:
    """Split an outline of (N, 2) points, metres, in order into segments.

    The line through the first and the last point represents all points if none is farther from it
    than `split_m`. Otherwise it is split at the farthest point, which both parts share. 0.3 m is
    three times the range noise of the LUX, so that noise alone splits nothing. Eq. 3-4 write the
    line as kx - y + b = 0, which cannot describe vertical lines. The cross product, used here,
    gives the same distance for every direction.
    """
    ends = split_ends(np.asarray(points, np.float64), split_m).tolist()
    return [Segment(points[first : last + 1]) for first, last in ends]


def recognise(outline: np.ndarray, ends: np.ndarray, horizon: Horizon) -> list[Vehicle]:
    """Return the vehicles in the outline of one cluster.

    outline: (N, 2) metres. ends: (S, 2) int64, first and last point of each of its pieces;
    neighbouring pieces share a point. Where the outline jumps, another body begins.
    """
    rows = face_ends(outline, ends, FACES).tolist()
    chains = (
        [Segment(outline[first : last + 1]) for _, first, last in chain]
        for _, chain in groupby(rows, key=itemgetter(0))
    )
    return [v for v in (_vehicle(chain, horizon) for chain in chains) if v is not None]


def _vehicle(chain: list[Segment], horizon: Horizon) -> Vehicle | None:
    """Return the vehicle whose faces these segments are, None if it is no vehicle."""
    lines = [segment for segment in chain if len(segment) > 1]
    points = np.concatenate([segment.points for segment in chain])
    main = max(lines, key=lambda line: line.length)
    if not all(_square(line, main) for line in lines):
        return None
    ends = _open_ends(lines, horizon)
    along = _length_axis(main, points, bool(ends))
    axes = (along, _left_of(along))
    sides = [SideExtent.of(points, axis, ends, horizon.origin) for axis in axes]
    length, width = (side.visible_m for side in sides)
    least = HALF_FACE_M if ends else LENGTH_MIN_M
    if max(length, width) < least or length > LENGTH_MAX_M or width > WIDTH_MAX_M:
        return None
    if any(side.open == (True, True) for side in sides):
        return None
    category, size = _size(length, width)
    # A front or rear is either wholly visible or hardly at all; the far part of a flank may have no
    # returns.
    x = sides[0].centre(size[0], whole=False)
    y = sides[1].centre(size[1], whole=width > size[1] / 2)
    centre = x * along + y * _left_of(along)
    residuals = np.concatenate([line.residuals for line in lines])
    return Vehicle(
        (float(centre[0]), float(centre[1])),
        size,
        float(np.arctan2(along[1], along[0])),
        category,
        float(np.sqrt(np.mean(residuals**2))),
        len(points),
    )


@dataclass(frozen=True, slots=True)
class SideExtent:
    """The visible extent of a body along one of its axes.

    low, high: coordinates of the outline's ends along the axis. sensor: that of the sensor. All are
    in metres. open: whether a part of the body may be hidden beyond the low and the high end.
    """

    low: float
    high: float
    sensor: float
    open: tuple[bool, bool]

    @staticmethod
    def of(
        points: np.ndarray, axis: np.ndarray, ends: list[np.ndarray], origin: np.ndarray
    ) -> SideExtent:
        """Return the extent of (N, 2) points along a (2,) unit axis.

        ends: unit vectors that point out of the open ends of the outline. points and origin (2,),
        the sensor: metres, in one frame.
        """
        across = _left_of(axis)
        along = [float(end @ axis) for end in ends if abs(end @ axis) >= abs(end @ across)]
        low, high = float((points @ axis).min()), float((points @ axis).max())
        is_open = any(step < 0 for step in along), any(step > 0 for step in along)
        return SideExtent(low, high, float(origin @ axis), is_open)

    @property
    def visible_m(self) -> float:
        """Length of the side that has returns, metres."""
        return self.high - self.low

    def centre(self, extent: float, *, whole: bool) -> float:
        """Return the coordinate of the centre of a body of this extent, metres.

        With one open end the hidden part is beyond it. Otherwise the body is centred on its visible
        part if that is the whole side; if not, it begins at the end next to the sensor.

        whole: whether the visible part is the whole side.
        """
        if self.open[0] != self.open[1]:
            return self.high - extent / 2 if self.open[0] else self.low + extent / 2
        if whole or self.low < self.sensor < self.high:
            return (self.low + self.high) / 2
        return self.low + extent / 2 if self.sensor <= self.low else self.high - extent / 2


def _square(line: Segment, main: Segment) -> bool:
    """Return whether a line is short, or nearly parallel or perpendicular to the main one."""
    off = np.arccos(np.clip(abs(line.direction @ main.direction), 0, 1))
    return line.length < CORNER_M or min(off, np.pi / 2 - off) < SQUARE_RAD


def _open_ends(lines: list[Segment], horizon: Horizon) -> list[np.ndarray]:
    """Return unit vectors that point out of the open ends, beyond which more may be hidden."""
    ends = []
    for side, end, ordered in ((-1, 0, lines), (1, -1, lines[::-1])):
        # A rounded corner does not have the direction of the face at whose end it is.
        face = next((line for line in ordered if line.length >= CORNER_M), ordered[0])
        if horizon.hides_beyond(ordered[0].points[end], side):
            ends.append(side * face.direction)
    return ends


def _length_axis(main: Segment, points: np.ndarray, is_open: bool) -> np.ndarray:
    """Return the unit vector along the vehicle, pointing ahead (x not negative).

    The longest segment is a flank if it is too long for a front or rear. It is a front or rear if
    it is wholly visible and alone. Otherwise both are possible, and the vehicle is assumed to head
    along the ego's axis rather than across it.
    """
    axis = main.direction
    across = float(np.ptp(points @ _left_of(axis)))
    if main.length <= WIDTH_MAX_M:
        undecided = is_open or across >= LENGTH_MIN_M
        if not undecided or abs(axis[0]) < abs(axis[1]):
            axis = _left_of(axis)
    return -axis if axis[0] < 0 or (axis[0] == 0 and axis[1] < 0) else axis


def _left_of(axis: np.ndarray) -> np.ndarray:
    """Return a (2,) axis turned by 90 degrees to the left."""
    return np.array([-axis[1], axis[0]])


def _size(length: float, width: float) -> tuple[Category, tuple[float, float, float]]:
    """Return category and size of the smallest typical body with this visible extent, metres."""
    fitting = (row for row in SIZES if length <= row[1] and width <= row[2])
    category, _, _, (usual_length, usual_width, height) = next(fitting, SIZES[-1])
    return category, (max(length, usual_length), max(width, usual_width), height)
