"""Room for many states of a body side by side, one a lane: compiled loops over lanes.

All lanes of a value lie next to each other and all values in one array, a fixed way apart: so the
compiler sees that none overlaps another, and works on several lanes at a time. Every lane gets
the same bits as a state alone does, but for the last ones where it turns; of parts it gets those of
`body_model.fill_parts`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from roadscope.core.jit import compiled
from roadscope.detectors.pose.body_kernels import (
    AFT,
    AFT_REACH,
    AFT_X,
    AFT_Y,
    BOTTOM,
    COLUMNS,
    FORE,
    FORE_REACH,
    FORE_X,
    FORE_Y,
    FRONT,
    HALF,
    NOSE,
    POSE,
    RADIUS,
    REAR,
    TAIL,
    TOP,
    place_after,
)

LANES, EVEN = 40, 4
"""Most lanes at a time, and what their number is rounded up to."""
X, Y, YAW, SPEED, TURN, ACCELERATION = (k * LANES for k in range(6))
LENGTH_OFF, WIDTH_OFF, CURVED, NOSE_OFF, TAIL_OFF = (k * LANES for k in range(6, 11))
AT_X, AT_Y, COS, SIN, START_X, START_Y, WAY_X, WAY_Y = (k * LANES for k in range(11, 19))
INSIDE, TOUCH, NEAR, LEVEL, COSINE = (k * LANES for k in range(19, 24))
LENGTH, WIDTH, YAW_COS, YAW_SIN = (k * LANES for k in range(24, 28))
BACK, AHEAD, ASIDE = (k * LANES for k in range(28, 31))
"""Where values begin: the 11 of a state, its place, a ray as the body sees it, where the ray
passes and enters a part, what is made of a state, and how far the body reaches behind, ahead and
aside."""
PARTS, PART = 31 * LANES, COLUMNS * LANES
"""Where the first part begins, and how far the next one is."""
FAR = 0.25
"""Half an angle, radians, up to which these terms of a series are exact."""
SINES = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(6))
COSINES = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(7))
"""Series of the sine of an angle over the angle, and of the cosine, in the angle's square."""


class Drawn(NamedTuple):
    """A body as kernels draw it; the fields are those of a `BodyModel`, as arrays.

    sizes: (2, 2) mean and standard deviation of length and width, metres. storeys: (P, 7).
    shape: least and greatest radius, axles, narrowing.
    """

    sizes: np.ndarray
    storeys: np.ndarray
    shape: tuple[float, float, float, float, float, float]


@compiled()
def new_room(parts: int) -> np.ndarray:
    """Return room for a body of so many parts."""
    return np.zeros(PARTS + parts * PART)


@compiled(borrowing=True)
def even(count: int) -> int:
    """Return a count of lanes, rounded up."""
    return (count + EVEN - 1) // EVEN * EVEN


@compiled(borrowing=True)
def lay(vectors: np.ndarray, free: np.ndarray, fixed: np.ndarray, room: np.ndarray) -> None:
    """Write (K, D) vectors into lanes, K at most `LANES`; left lanes hold the last one again.

    free: (D,) indices of the vector's values among the 11. fixed: (11,) the others.
    """
    lanes, last = even(len(vectors)), len(vectors) - 1
    for value in range(len(fixed)):
        row = room[value * LANES : value * LANES + lanes]
        row[:] = fixed[value]
    for d in range(len(free)):
        row = room[free[d] * LANES : free[d] * LANES + lanes]
        for lane in range(lanes):
            row[lane] = vectors[min(lane, last), d]


@compiled(borrowing=True)
def stand(lanes: int, room: np.ndarray) -> bool:
    """Fill in place, cosine and sine at the reference time; tell whether any lane turns."""
    turns = False
    for lane in range(lanes):
        yaw = room[YAW + lane]
        room[AT_X + lane], room[AT_Y + lane] = room[X + lane], room[Y + lane]
        cos, sin = math.cos(yaw), math.sin(yaw)
        room[COS + lane], room[SIN + lane] = cos, sin
        room[YAW_COS + lane], room[YAW_SIN + lane] = cos, sin
        turns |= room[TURN + lane] != 0.0
    return turns


@compiled(borrowing=True)
def go(time: float, turns: bool, lanes: int, room: np.ndarray) -> None:
    """Fill in where each lane's body is after a time, as `place_after` does."""
    if turns:
        _turn(time, lanes, room)
        return
    for lane in range(lanes):
        way = (room[SPEED + lane] + 0.5 * room[ACCELERATION + lane] * time) * time
        room[AT_X + lane] = room[X + lane] + way * room[COS + lane]
        room[AT_Y + lane] = room[Y + lane] + way * room[SIN + lane]


@compiled(borrowing=True)
def _turn(time: float, lanes: int, room: np.ndarray) -> None:
    far = 0
    for lane in range(lanes):
        half = 0.5 * room[TURN + lane] * time
        far |= abs(half) > FAR
        sine, cosine = _small(half * half)
        way = (room[SPEED + lane] + 0.5 * room[ACCELERATION + lane] * time) * time
        cos, sin = room[YAW_COS + lane], room[YAW_SIN + lane]
        chord, sine = way * sine, half * sine
        midway_cos, midway_sin = cos * cosine - sin * sine, sin * cosine + cos * sine
        room[AT_X + lane] = room[X + lane] + chord * midway_cos
        room[AT_Y + lane] = room[Y + lane] + chord * midway_sin
        room[COS + lane] = midway_cos * cosine - midway_sin * sine
        room[SIN + lane] = midway_sin * cosine + midway_cos * sine
    if far:
        _turn_far(time, lanes, room)


@compiled(borrowing=True, forceinline=True)
def _small(square: float) -> tuple[float, float]:
    """Return the sine of a small angle over the angle, and the cosine, given its square: series."""
    sine, cosine = SINES[5], COSINES[6]
    for k in range(4, -1, -1):
        sine = SINES[k] + square * sine
    for k in range(5, -1, -1):
        cosine = COSINES[k] + square * cosine
    return sine, cosine


@compiled(borrowing=True)
def _turn_far(time: float, lanes: int, room: np.ndarray) -> None:
    """Do for lanes that turn by a large angle what `_turn` does for the others."""
    state = room[NEAR : NEAR + POSE]
    for lane in range(lanes):
        if abs(0.5 * room[TURN + lane] * time) > FAR:
            for value in range(POSE):
                state[value] = room[value * LANES + lane]
            place = place_after(state, time)
            room[AT_X + lane], room[AT_Y + lane], room[COS + lane], room[SIN + lane] = place


@compiled(borrowing=True)
def draw(body: Drawn, lanes: int, room: np.ndarray) -> None:
    """Fill in the parts of each lane's body, and how far it reaches."""
    sizes = body.sizes
    least_x, least_y = 0.3 * sizes[0, 0], 0.3 * sizes[1, 0]
    for lane in range(lanes):
        length = sizes[0, 0] + sizes[0, 1] * room[LENGTH_OFF + lane]
        width = sizes[1, 0] + sizes[1, 1] * room[WIDTH_OFF + lane]
        room[LENGTH + lane] = length if length > least_x else least_x
        room[WIDTH + lane] = width if width > least_y else least_y
        room[BACK + lane], room[AHEAD + lane], room[ASIDE + lane] = np.inf, -np.inf, 0.0
    for p in range(len(body.storeys)):
        _storey(body.storeys[p], body.shape, lanes, room, PARTS + p * PART)
        _flanks(lanes, room, PARTS + p * PART)


@compiled(borrowing=True)
def _storey(
    storey: np.ndarray,
    shape: tuple[float, float, float, float, float, float],
    lanes: int,
    room: np.ndarray,
    base: int,
) -> None:
    bottom, top, tail, nose, breadth, tail_sd, nose_sd = storey
    least, most, aft_share, fore_share, at_tail, at_nose = shape
    part = room[base : base + PART]
    for lane in range(lanes):
        length = room[LENGTH + lane]
        share = 0.5 * abs(1.0 + room[CURVED + lane])
        radius = least + (most - least) * (1.0 if share > 1.0 else share)
        aft, fore = aft_share * length, fore_share * length
        rear = tail + tail_sd * room[TAIL_OFF + lane] - 0.5 * length
        front = 0.5 * length - nose - nose_sd * room[NOSE_OFF + lane]
        front = rear + 0.3 if rear + 0.3 > front else front
        half = 0.5 * breadth * room[WIDTH + lane]
        behind = _clipped((aft - rear) / (0.5 * length + aft))
        ahead = _clipped((front - fore) / (0.5 * length - fore))
        tail_half = half * (1.0 - (1.0 - at_tail) * behind)
        nose_half = half * (1.0 - (1.0 - at_nose) * ahead)
        ends = 2.0 * (nose_half if nose_half < tail_half else tail_half)
        space = 0.499 * (ends if ends < front - rear else front - rear)
        part[REAR * LANES + lane], part[FRONT * LANES + lane] = rear, front
        part[HALF * LANES + lane] = half
        part[TAIL * LANES + lane], part[NOSE * LANES + lane] = tail_half, nose_half
        radius = space if space < radius else radius
        part[RADIUS * LANES + lane] = radius
        part[AFT * LANES + lane] = rear + radius if rear + radius > aft else aft
        part[FORE * LANES + lane] = front - radius if front - radius < fore else fore
        part[BOTTOM * LANES + lane], part[TOP * LANES + lane] = bottom, top
        back, ahead_m, aside = room[BACK + lane], room[AHEAD + lane], room[ASIDE + lane]
        room[BACK + lane] = rear if rear < back else back
        room[AHEAD + lane] = front if front > ahead_m else ahead_m
        room[ASIDE + lane] = half if half > aside else aside


@compiled(borrowing=True, forceinline=True)
def _clipped(share: float) -> float:
    share = share if share > 0.0 else 0.0
    return share if share < 1.0 else 1.0


@compiled(borrowing=True)
def _flanks(lanes: int, room: np.ndarray, base: int) -> None:
    """Fill in normals and reach of a part's flanks, which have narrowed where corners begin."""
    part = room[base : base + PART]
    for lane in range(lanes):
        half, curved = part[HALF * LANES + lane], part[RADIUS * LANES + lane]
        fore, aft = part[FORE * LANES + lane], part[AFT * LANES + lane]
        less = half - part[NOSE * LANES + lane]
        over = part[FRONT * LANES + lane] - curved - fore
        x, y, reach = _flank(less, over, fore, half)
        part[FORE_X * LANES + lane], part[FORE_Y * LANES + lane] = x, y
        part[FORE_REACH * LANES + lane] = reach
        less = part[TAIL * LANES + lane] - half
        over = aft - (part[REAR * LANES + lane] + curved)
        x, y, reach = _flank(less, over, aft, half)
        part[AFT_X * LANES + lane], part[AFT_Y * LANES + lane] = x, y
        part[AFT_REACH * LANES + lane] = reach


@compiled(borrowing=True, forceinline=True)
def _flank(less: float, over: float, x: float, half: float) -> tuple[float, float, float]:
    straight = over <= 0.0
    length = 1.0 if straight else math.sqrt(less * less + over * over)
    nx, ny = less / length, over / length
    reach = nx * x + ny * half
    return 0.0 if straight else nx, 1.0 if straight else ny, half if straight else reach
