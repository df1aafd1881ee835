"""Moving vehicles from a scan (Zhang 2017, section 1): temporal cue, geometric cue, box model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from roadscope.core.jit import compiled
from roadscope.core.record import Record
from roadscope.detectors.moving.box_search import boxes_in, gathered, met_at, shared_out
from roadscope.detectors.moving.memory import Look
from roadscope.detectors.moving.view import (
    View,
    carried,
    look_back,
    seen_through,
    spans,
    thinned,
    voxel_of,
)
from roadscope.detectors.shape.bodies import LONGEST_M, WIDEST_M

# --------------------------------------------------------------------------------------------------
# The rest of a body of which a part was seen to move.

LINK_M = 1.0
"""Parts of one body come this near to each other; cars in a queue keep farther apart."""
CAR_M = (5.6, 2.7)
"""A car with noise at either end."""
TALL_M = 1.75
"""What is longer is higher than a car."""


@compiled()
def bodies(
    points: np.ndarray, boxes: np.ndarray, origin: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which body each point belongs to, (N,), -1 for none, and each body's box, (K,).

    points: (N, 3) metres. boxes (B, 8), origin and sides: of `box_kernels`, best box first. What
    is mostly of a body that was found already is found once.
    """
    owner, found, count = np.full(len(points), -1), np.empty(len(boxes), np.int64), 0
    for b in range(len(boxes)):
        part = gathered(points, boxes[b], origin, sides)
        free = part[owner[part] < 0]
        if 2 * len(free) <= len(part):
            continue
        for row in whole_body(points, free):
            if owner[row] < 0:
                owner[row] = count
        found[count] = b
        count += 1
    return owner, found[:count]


@compiled()
def whole_body(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    """Return the rows of the body that a part belongs to; the part's where that is no vehicle.

    points: (N, 3) metres, z from the ground. part: (K,) int64, rows of it. A slow vehicle still
    stands where its rear half was seen a second ago, and a lorry fills several boxes.
    """
    grown = linked(points, part, LINK_M, LONGEST_M)
    return grown if _fits(points[grown]) else part


@compiled()
def _fits(points: np.ndarray) -> bool:
    """Whether a vehicle along the longest way through (N, 3) points would hold them."""
    x, y = points[:, 0] - points[:, 0].mean(), points[:, 1] - points[:, 1].mean()
    axis = 0.5 * np.arctan2(2.0 * (x * y).sum(), (x * x).sum() - (y * y).sum())
    along, across = np.cos(axis) * x + np.sin(axis) * y, np.cos(axis) * y - np.sin(axis) * x
    length, width = along.max() - along.min(), across.max() - across.min()
    if points[:, 2].max() < TALL_M:
        return bool(length <= CAR_M[0] and width <= CAR_M[1])
    return bool(length <= LONGEST_M and width <= WIDEST_M)


@compiled()
def linked(points: np.ndarray, part: np.ndarray, link_m: float, reach_m: float) -> np.ndarray:
    """Return, rising, the rows (M,) int64 that hang together with a part.

    points: (N, 3) metres, any frame. part: (K,) int64, rows of it, K at least 1. Seen from above,
    each is within `link_m` of another one, and those beside the part are less than `reach_m` away
    in x and in y from its first row.
    """
    x, y = points[part[0], 0], points[part[0], 1]
    near = np.empty(len(points), np.int64)
    count = 0
    for row in range(len(points)):
        if abs(points[row, 0] - x) < reach_m and abs(points[row, 1] - y) < reach_m:
            near[count] = row
            count += 1
    near = near[:count]
    inside, queue = np.zeros(len(points), np.bool_), np.empty(len(points), np.int64)
    done, size = 0, len(part)
    queue[:size] = part
    for row in part:
        inside[row] = True
    while done < size:
        row = queue[done]
        done += 1
        for other in near:
            dx, dy = points[other, 0] - points[row, 0], points[other, 1] - points[row, 1]
            if not inside[other] and dx * dx + dy * dy <= link_m * link_m:
                inside[other] = True
                queue[size] = other
                size += 1
    return np.flatnonzero(inside)


# --------------------------------------------------------------------------------------------------
# Moving vehicles out of a scan (Zhang 2017, section 1): temporal cue, geometric cue, box model.

LOW_M, HIGH_M = 0.3, 2.8
"""Heights above the road at which things are looked at: clear of the ground, below bridges and
most of a crown."""
SILL_M = 0.15
"""A vehicle's returns are taken from here on: far away its lower half is met by one beam."""
REACH_M = 120.0
CELL_M = 0.25
SIDES_M = np.array([2.7, 1.3, 0.75, 0.75])
"""Half length and half width of the box, and its collar at the ends and at the flanks: a car
whose place in the box is unknown by half a stride and its heading by half a turn."""
SLAB_M = 0.3
"""Height of the voxels of which one return each is looked at: a near flank has thousands."""
NEIGHBOUR_M = 0.6
"""Returns up to twice as far away are seen of the same thing."""
MIN_LOOKS = 2
MIN_POINTS = 3
CHANCE = 1
"""One ray that passed where something thin stands says little: so many are not counted."""
LEAST = 3.0
"""Evidence that makes a vehicle: three returns where the road was seen free."""
LIMIT = 3.0
"""Most that one cell weighs, for or against."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate(Record):
    """Returns of one moving vehicle.

    points: (N, 3) float64, metres, ego frame at the scan's stamp, sorted. The sensor's motion
        during the sweep is taken out, the vehicle's own is not.
    rows: (N,) int64, which return of the scan each one is.
    times_s: (N,) float64, seconds after the stamp. time_s: their median.
    origin: (2,) float64, metres, where the sensor was then.
    box: (3,) float64, x, y in metres and yaw of the box that found it.
    evidence: of motion, summed over the cells of the box.
    """

    points: np.ndarray
    rows: np.ndarray
    times_s: np.ndarray
    time_s: float
    origin: np.ndarray
    box: np.ndarray
    evidence: float


def extract(now: View, back: Sequence[Look]) -> list[Candidate]:
    """Return what moves in a scan, given earlier ones; nothing while there are too few.

    Places are metres in the scan's ego frame at its stamp.
    """
    rows = np.flatnonzero(_between(now, SILL_M))
    points = now.points[rows]
    if len(back) < MIN_LOOKS or not (points[:, 2] > LOW_M).any():
        return []
    voxels = thinned(points, CELL_M, SLAB_M)
    thin = points[voxels]
    upright = thin[thin[:, 2] > LOW_M]
    weights = motion(upright, back)
    through = seen_through(upright, now.rays)
    weights[through] = np.minimum(weights[through], 0.0)
    if not (weights > 0).any():
        return []
    boxes = boxes_in(upright, weights, now.origin(), SIDES_M, (CELL_M, LIMIT, LEAST))
    owner, found_by = bodies(thin, boxes, now.origin(), SIDES_M)
    held = owner[voxel_of(points, voxels, CELL_M, SLAB_M)]
    return _candidates(now, (rows, held), boxes[found_by])


def motion(points: np.ndarray, back: Sequence[Look]) -> np.ndarray:
    """Return (N,) evidence that each of the places (N, 3), ego frame now, holds something moving.

    Temporal cue: where an earlier scan saw something too it is background, where it saw through
    the place what stands there now has come. One that could not see the place says nothing; what
    none has seen taken is a little suspect. Between -3.5 and 5.
    """
    counts, heights = np.zeros((2, len(points)), np.int64), spans(points, NEIGHBOUR_M)
    for look in back:
        look_back(carried(points, look.then_from_now), heights, look.view.rays, counts)
    free, taken = np.maximum(counts - [[CHANCE], [0]], 0) / len(back)
    return np.where(free > 0, 1.0 + 5.0 * free - 4.5 * taken, np.where(taken > 0, -4.5 * taken, 1))


def _between(view: View, low_m: float) -> np.ndarray:
    """Geometric cue: (N,) returns at a vehicle's height."""
    x, y, z = view.points.T
    near = (np.abs(x) < REACH_M) & (np.abs(y) < REACH_M)
    return np.asarray((z > low_m) & (z < HIGH_M) & near)


def _candidates(
    now: View, held: tuple[np.ndarray, np.ndarray], boxes: np.ndarray
) -> list[Candidate]:
    """Return the vehicles of boxes (B, 8), without those that have too few returns.

    held: (K,) rows of returns, and which box's vehicle each belongs to, -1 for none.
    """
    starts, rows, points, times_s = shared_out(now.points, now.times_s, *held, len(boxes))
    met_s, origins = met_at(times_s, starts, now.lidar_from_ego, now.twist)
    ends, met = starts.tolist(), met_s.tolist()
    return [
        Candidate(
            points[i:j],
            rows[i:j],
            times_s[i:j],
            met[b],
            origins[b],
            boxes[b, :3],
            float(boxes[b, 3]),
        )
        for b, (i, j) in enumerate(pairwise(ends))
        if j - i >= MIN_POINTS
    ]
