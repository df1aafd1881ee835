"""Which outlines are vehicles, and where the vehicle is that shows them.

Lu 2018 (section 2.2) refers to Huang et al. 2016 for recognition by the number of segments, the
shape and the size of a cluster, and states no numbers. The ones here are bounds on the bodies of
road vehicles, not fitted to any scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter

import numpy as np

from roadscope.core import Category
from roadscope.detectors.horizon import Horizon
from roadscope.detectors.shape.line_kernels import Faces, face_ends
from roadscope.detectors.shape.segment import Segment

GAP_M = 1.2
"""Neighbouring outline points farther apart lie on two bodies."""
MIN_POINTS = 3
MAX_SEGMENTS = 3
"""Two faces and the rounded corner between them."""
JOIN_M = 0.15
"""Neighbouring segments are one face when all their points lie this near to one line (root mean
square): range noise, and the rounded corners that end a face."""
CORNER_M = 0.8
"""A piece of this length may be a rounded corner and stand at any angle."""
SQUARE_RAD = np.radians(25.0)
"""How far two faces may be from parallel or perpendicular."""
SEEN_MIN_M, WIDTH_MAX_M, LENGTH_MAX_M = 1.2, 2.8, 18.0
"""Least of the longer side of a body seen whole, the widest face with mirrors and noise, and the
longest lorry."""
HALF_FACE_M = 0.92
"""Least that must be seen of a body that may go on unseen: half a usual car's width."""
FACES = Faces(GAP_M, JOIN_M, HALF_FACE_M, MIN_POINTS, MAX_SEGMENTS)
SIZES = (
    (Category.CAR, 5.3, 2.2, (4.6, 1.85, 1.5)),
    (Category.VAN, 7.5, 2.3, (5.9, 2.05, 2.4)),
    (Category.TRUCK, LENGTH_MAX_M, WIDTH_MAX_M, (10.0, 2.5, 3.4)),
)
"""Category, greatest length, greatest width and usual size in metres, in order of size."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """A recognised vehicle.

    centre: x, y in metres, ego frame; size: length, width, height in metres; yaw: radians.
    residual_m: root mean square distance of the outline from its lines.
    points: outline points behind it.
    fit: log likelihood of what is seen under the prior of sizes, 0 where it is not weighed.
    """

    centre: tuple[float, float]
    size: tuple[float, float, float]
    yaw: float
    category: Category
    residual_m: float
    points: int
    fit: float = 0.0


def recognise(outline: np.ndarray, ends: np.ndarray, horizon: Horizon) -> list[Vehicle]:
    """Return the vehicles in the outline of one cluster.

    outline: (N, 2) metres. ends: (S, 2) int64, first and last point of each of its pieces, of
    which neighbours share a point. Where it jumps another body begins.
    """
    rows = face_ends(outline, ends, FACES).tolist()
    chains = (
        [Segment(outline[first : last + 1]) for _, first, last in chain]
        for _, chain in groupby(rows, key=itemgetter(0))
    )
    return [v for v in (_vehicle(chain, horizon) for chain in chains) if v is not None]


def _vehicle(chain: list[Segment], horizon: Horizon) -> Vehicle | None:
    """Complete the body that shows these segments, None when it is no vehicle."""
    lines = [segment for segment in chain if len(segment) > 1]
    points = np.concatenate([segment.points for segment in chain])
    main = max(lines, key=lambda line: line.length)
    if not all(_square(line, main) for line in lines):
        return None
    ends = _open_ends(lines, horizon)
    along = _length_axis(main, points, bool(ends))
    views = [View.of(points, axis, ends, horizon.origin) for axis in (along, _left_of(along))]
    length, width = (view.seen for view in views)
    least = HALF_FACE_M if ends else SEEN_MIN_M
    if max(length, width) < least or length > LENGTH_MAX_M or width > WIDTH_MAX_M:
        return None
    if any(view.open == (True, True) for view in views):
        return None
    category, size = _size(length, width)
    # A face is seen whole or hardly at all; the far part of a flank returns little.
    x = views[0].centre(size[0], whole=False)
    y = views[1].centre(size[1], whole=width > size[1] / 2)
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
class View:
    """How much of a body is seen along one of its axes.

    low, high: where the seen part begins and ends; sensor: where the sensor stands, metres.
    open: whether the body may go on unseen below and above.
    """

    low: float
    high: float
    sensor: float
    open: tuple[bool, bool]

    @staticmethod
    def of(
        points: np.ndarray, axis: np.ndarray, ends: list[np.ndarray], origin: np.ndarray
    ) -> View:
        """Project (N, 2) points on a (2,) unit axis; `ends` are unit vectors out of open ends.

        points and origin (2,), the sensor: metres, one frame.
        """
        across = _left_of(axis)
        ways = [float(end @ axis) for end in ends if abs(end @ axis) >= abs(end @ across)]
        low, high = float((points @ axis).min()), float((points @ axis).max())
        is_open = any(way < 0 for way in ways), any(way > 0 for way in ways)
        return View(low, high, float(origin @ axis), is_open)

    @property
    def seen(self) -> float:
        """Metres."""
        return self.high - self.low

    def centre(self, extent: float, *, whole: bool) -> float:
        """Return the middle of a body of this extent.

        It goes on to where it may. With no such end it is centred on what is seen when that is
        the whole side, and otherwise begins next to the sensor.
        """
        if self.open[0] != self.open[1]:
            return self.high - extent / 2 if self.open[0] else self.low + extent / 2
        if whole or self.low < self.sensor < self.high:
            return (self.low + self.high) / 2
        return self.low + extent / 2 if self.sensor <= self.low else self.high - extent / 2


def _square(line: Segment, main: Segment) -> bool:
    """Whether a line is a corner's rounding or parallel or perpendicular to the main one."""
    off = np.arccos(np.clip(abs(line.direction @ main.direction), 0, 1))
    return line.length < CORNER_M or min(off, np.pi / 2 - off) < SQUARE_RAD


def _open_ends(lines: list[Segment], horizon: Horizon) -> list[np.ndarray]:
    """Return unit vectors out of those ends of an outline beyond which it may go on unseen."""
    ends = []
    for side, end, ordered in ((-1, 0, lines), (1, -1, lines[::-1])):
        # The direction of a corner's rounding says nothing of the face that it ends.
        face = next((line for line in ordered if line.length >= CORNER_M), ordered[0])
        if horizon.hides_beyond(ordered[0].points[end], side):
            ends.append(side * face.direction)
    return ends


def _length_axis(main: Segment, points: np.ndarray, is_open: bool) -> np.ndarray:
    """Return the unit vector along the vehicle, pointing ahead (x not negative).

    The longest segment is a flank when it is too long for a face, and a face when it is seen
    whole and alone. Otherwise both can be, and traffic is taken to run like the ego rather than
    across its way.
    """
    axis = main.direction
    across = float(np.ptp(points @ _left_of(axis)))
    if main.length <= WIDTH_MAX_M:
        undecided = is_open or across >= SEEN_MIN_M
        if not undecided or abs(axis[0]) < abs(axis[1]):
            axis = _left_of(axis)
    return -axis if axis[0] < 0 or (axis[0] == 0 and axis[1] < 0) else axis


def _left_of(axis: np.ndarray) -> np.ndarray:
    return np.array([-axis[1], axis[0]])


def _size(length: float, width: float) -> tuple[Category, tuple[float, float, float]]:
    """Category and size of the smallest usual body that shows this much."""
    fitting = (row for row in SIZES if length <= row[1] and width <= row[2])
    category, _, _, (usual_length, usual_width, height) = next(fitting, SIZES[-1])
    return category, (max(length, usual_length), max(width, usual_width), height)
