"""The model of a vehicle's body, with its prior, and the body's outline seen from above."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from roadscope.core.checks import require
from roadscope.core.jit import compiled

MOST_SECTIONS = 8
CORNER_X = tuple(math.cos(math.radians(angle)) for angle in (0.0, 30.0, 60.0, 90.0))
"""A rounded corner consists of three facets, as in the mesh of a simulated car: the x of its four
points at a radius of 1. Their y are the same numbers in reverse order."""
OUTLINE_POINTS = 20
"""Points of a part's outline: four for each corner, and four where the flanks begin to narrow."""
LEAST_SHARE = 0.3
"""No body is shorter or narrower than this share of its mean size."""
GLASS = 6.0
"""Light paint sends back so many times the light of a window: the two surfaces of glass with a
refractive index of 1.5 reflect 4 % each (Fresnel), light paint half of the light."""


STATE = (
    *("x", "y", "yaw", "speed", "turn_rate", "acceleration"),
    *("length", "width", "radius", "nose", "tail"),
)
"""The values of the state of a body in motion. The first six are its motion at a reference time, in
the world frame: x and y of the centre, yaw, speed and acceleration along the heading, and turn
rate; metres, radians, seconds. The others are standard normal variables of its shape: length,
width, corner radius, set-backs of nose and tail."""
X, Y, YAW, SPEED, TURN_RATE, ACCELERATION, LENGTH, WIDTH, RADIUS, NOSE, TAIL = range(len(STATE))
VALUES, MOTION = len(STATE), LENGTH
"""How many values a state has, and how many of them describe the motion."""


class SizePrior(NamedTuple):
    """The normal prior of a length or a width, metres: mean and standard deviation."""

    mean_m: float
    sd_m: float


class BodySection(NamedTuple):
    """A horizontal section of a body: heights above the road and set-backs from the ends, metres.

    nose_sd_m, tail_sd_m: standard deviations of the set-backs. breadth: share of the body's width.
    """

    bottom_m: float
    top_m: float
    tail_m: float = 0.0
    nose_m: float = 0.0
    breadth: float = 1.0
    tail_sd_m: float = 0.0
    nose_sd_m: float = 0.0


class BodyPart(NamedTuple):
    """One section of the body of a state, metres, body frame: x ahead of the centre, y left.

    rear, front: x of the ends. half, tail_half, nose_half: half the width between the axles, at
    the rear end and at the front end. aft, fore: x from which the flanks narrow. radius: of the
    four corners. bottom, top: heights above the road.
    """

    rear: float
    front: float
    half: float
    tail_half: float
    nose_half: float
    aft: float
    fore: float
    radius: float
    bottom: float
    top: float


class BodyShape(NamedTuple):
    """A body model as arrays; fields and order as in `BodyModel`, sections (P, 7)."""

    length_m: np.ndarray
    width_m: np.ndarray
    radius_m: np.ndarray
    axles: np.ndarray
    narrowing: np.ndarray
    sections: np.ndarray


@dataclass(frozen=True)
class BodyModel:
    """A stack of sections with rounded corners, symmetric about its long axis.

    radius_m: least and greatest corner radius. Radii up to the middle are about equally likely, the
        greatest half as likely. A radius is at most half the width of the narrower end.
    axles: rear and front axle, from the centre, as shares of the length.
    narrowing: width at the tail and at the nose as shares of the width between the axles.
    drawn_m: standard deviation, along and across, of the model's surface from the real one. It is
        common to all returns, so the pose is never more certain than that.
    glass_m: lowest and highest height of the windows, metres above the road.
    """

    length_m: SizePrior
    width_m: SizePrior
    radius_m: tuple[float, float] = (0.0, 0.4)
    sections: tuple[BodySection, ...] = (BodySection(0.15, 1.5),)
    axles: tuple[float, float] = (-0.28, 0.3)
    narrowing: tuple[float, float] = (1.0, 1.0)
    drawn_m: float = 0.0
    glass_m: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("length_m", "width_m"):
            size = getattr(self, name)
            is_size = np.shape(size) == (2,) and 0 < size[0] < np.inf and 0 <= size[1] < size[0] / 2
            expected = "(mean, standard deviation) in metres, the mean above twice the deviation"
            require(is_size, self, name, expected, size)
        fits = 0 <= self.radius_m[0] <= self.radius_m[1] < self.width_m[0] / 2
        expected = "(least, greatest) from 0 to half the width"
        require(fits, self, "radius_m", expected, self.radius_m)
        require(0 <= self.drawn_m < np.inf, self, "drawn_m", "zero or more metres", self.drawn_m)
        low, high = self.glass_m or (0.0, 1.0)
        require(0 <= low < high, self, "glass_m", "(from, up to) in metres", self.glass_m)
        count, expected = len(self.sections), f"1 to {MOST_SECTIONS} sections"
        require(1 <= count <= MOST_SECTIONS, self, "sections", expected, count)

    @cached_property
    def shape(self) -> BodyShape:
        """The body as arrays."""
        return BodyShape(*(np.array(getattr(self, name), np.float64) for name in BodyShape._fields))

    @cached_property
    def uncertain(self) -> np.ndarray:
        """Indices in a state of the values of the shape that are not known exactly."""
        spreads = (
            self.length_m[1],
            self.width_m[1],
            self.radius_m[1] - self.radius_m[0],
            max(section.nose_sd_m for section in self.sections),
            max(section.tail_sd_m for section in self.sections),
        )
        return MOTION + np.flatnonzero(np.array(spreads) > 0)

    def sizes(self, state: np.ndarray) -> tuple[float, float]:
        """Return length and width in metres of a state (11,)."""
        means, sds = np.transpose([self.length_m, self.width_m])
        sizes = np.maximum(means + sds * state[[LENGTH, WIDTH]], LEAST_SHARE * means)
        return float(sizes[0]), float(sizes[1])

    def parts(self, state: np.ndarray) -> list[BodyPart]:
        """Return the sections of the body of a state (11,)."""
        state = np.asarray(state, np.float64)
        return [part_of(self.shape, p, state) for p in range(len(self.sections))]


@compiled(borrowing=True)
def part_of(shape: BodyShape, p: int, state: np.ndarray) -> BodyPart:
    """Return one section of the body of a state (11,)."""
    length = max(
        shape.length_m[0] + shape.length_m[1] * state[LENGTH], LEAST_SHARE * shape.length_m[0]
    )
    width = max(shape.width_m[0] + shape.width_m[1] * state[WIDTH], LEAST_SHARE * shape.width_m[0])
    # Mirrored at the least radius, so that a search is not stopped there.
    share = min(0.5 * abs(1.0 + state[RADIUS]), 1.0)
    radius = shape.radius_m[0] + (shape.radius_m[1] - shape.radius_m[0]) * share
    bottom, top, tail, nose, breadth, tail_sd, nose_sd = shape.sections[p]
    rear = tail + tail_sd * state[TAIL] - 0.5 * length
    front = max(0.5 * length - nose - nose_sd * state[NOSE], rear + 0.3)
    half = 0.5 * breadth * width
    aft, fore = shape.axles[0] * length, shape.axles[1] * length
    # How far an end lies beyond its axle, as a share of the body's overhang.
    behind = min(max((aft - rear) / (0.5 * length + aft), 0.0), 1.0)
    ahead = min(max((front - fore) / (0.5 * length - fore), 0.0), 1.0)
    tail_half = half * (1.0 - (1.0 - shape.narrowing[0]) * behind)
    nose_half = half * (1.0 - (1.0 - shape.narrowing[1]) * ahead)
    radius = min(radius, 0.499 * min(front - rear, 2.0 * min(tail_half, nose_half)))
    # A flank narrows from its axle to the corner. If the corner reaches the axle, it narrows from
    # the middle.
    middle = 0.5 * (front + rear)
    if aft <= rear + radius:
        aft = min(middle, rear + radius) if tail_half == half else middle
    if fore >= front - radius:
        fore = max(middle, front - radius) if nose_half == half else middle
    return BodyPart(rear, front, half, tail_half, nose_half, aft, fore, radius, bottom, top)


class Outlines(NamedTuple):
    """The outlines of P parts seen from above, counter-clockwise, each of 20 points.

    x, y: (P, 20) metres, body frame. inverse: (P, 20) 1 over the distance to the next point, 0 for
    equal points. size: (2,) half the length and half the width, metres.
    """

    x: np.ndarray
    y: np.ndarray
    inverse: np.ndarray
    size: np.ndarray


def new_outlines(parts: int) -> Outlines:
    """Return outlines that are still to be filled in."""
    size = parts, OUTLINE_POINTS
    return Outlines(np.empty(size), np.empty(size), np.empty(size), np.empty(2))


@compiled(borrowing=True)
def fill_outlines(shape: BodyShape, state: np.ndarray, outlines: Outlines) -> None:
    """Fill in the outlines of the body of a state (11,)."""
    x, y, last = outlines.x, outlines.y, OUTLINE_POINTS - 1
    outlines.size[:] = 0.0
    for p in range(len(shape.sections)):
        part = part_of(shape, p, state)
        for i in range(4):
            cosine, sine = CORNER_X[i], CORNER_X[3 - i]
            x[p, i] = part.front - part.radius + part.radius * cosine
            y[p, i] = part.nose_half - part.radius + part.radius * sine
            x[p, 6 + i] = part.rear + part.radius - part.radius * sine
            y[p, 6 + i] = part.tail_half - part.radius + part.radius * cosine
        x[p, 4], y[p, 4], x[p, 5], y[p, 5] = part.fore, part.half, part.aft, part.half
        for i in range(OUTLINE_POINTS // 2):
            x[p, last - i], y[p, last - i] = x[p, i], -y[p, i]
        for i in range(OUTLINE_POINTS):
            after = i + 1 if i < last else 0
            length = math.hypot(x[p, after] - x[p, i], y[p, after] - y[p, i])
            outlines.inverse[p, i] = 1.0 / length if length > 1e-9 else 0.0
        outlines.size[0] = max(outlines.size[0], part.front, -part.rear)
        outlines.size[1] = max(outlines.size[1], part.half)


def saloon(length_m: SizePrior, width_m: SizePrior) -> BodyModel:
    """Return the model of a three-box car: bumpers and doors, bonnet and boot, glass and roof.

    Heights and set-backs are drawn by eye after one mid-size saloon, a Ford Fusion, and rounded.
    Their standard deviations are guesses, also that of 3 cm for the surface of bumpers and flanks.
    """
    return BodyModel(
        length_m,
        width_m,
        sections=(
            BodySection(0.16, 0.75),
            BodySection(0.75, 0.88, 0.02, 0.18, 0.99, 0.015, 0.06),
            BodySection(0.88, 1.00, 0.05, 0.70, 0.97, 0.03, 0.25),
            BodySection(1.00, 1.20, 0.50, 1.45, 0.88, 0.20, 0.25),
            BodySection(1.20, 1.48, 1.10, 1.95, 0.78, 0.30, 0.25),
        ),
        narrowing=(0.97, 0.96),
        drawn_m=0.03,
    )
